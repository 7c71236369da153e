"""The body with its cells coloured by what they felt, at the moment of the strongest touch."""

from pathlib import Path

import numpy as np

from skinnet.body.render import picture
from skinnet.deployment import Deployment
from skinnet.deployment.schema import BOARDS
from skinnet.part import Part

__all__ = ["draw_picture"]

_FULL_COLOUR_KPA = 12.0
"""A pressure in the middle of a hold is shown in full colour."""
_FULL_COLOUR = 0.3
"""A reading of high force is shown in full colour."""


def draw_picture(deployment: Deployment, base: Path, parts: dict[str, Part], out: Path) -> str | None:
    """Writes `body.png`; returns why not where the machine cannot render."""
    values = [0.0] * sum(patch.n_cells for patch in deployment.patches)
    position: list[float] | None = None
    controller, body = parts.get("controller"), parts.get("body")
    if controller is not None and body is not None and len(controller.arrays.get("touch_t_ns", ())):
        touch = controller.arrays["touch"].astype(np.float64).max(axis=2)
        moment = int(np.argmax(touch.sum(axis=1)))
        values = np.minimum(touch[moment] / _FULL_COLOUR, 1.0).tolist()
        index = int(np.searchsorted(body.arrays["joint_t_ns"], controller.arrays["touch_t_ns"][moment]))
        position = body.arrays["joint_rad"][min(index, len(body.arrays["joint_rad"]) - 1)].tolist()
    pose: list[float] | None = None
    if deployment.nursing is not None and body is not None and BOARDS in parts:
        values += np.clip(parts[BOARDS].arrays["pattern_kpa"][-1] / _FULL_COLOUR_KPA, 0.0, 1.0).tolist()
        position = body.arrays["joint_rad"][-1].tolist()
        if len(body.arrays.get("object_pose", ())):
            pose = body.arrays["object_pose"][-1].tolist()
    path, reason = picture(deployment, base, out / "body.png", values, position, pose)
    return None if path is not None else reason
