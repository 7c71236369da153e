"""Picture of the body with its cells coloured by their readings, at the strongest touch."""

from pathlib import Path
from typing import Any

import numpy as np

from skinnet.body.rendering import render_body
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.runtime.process_result import ProcessResult

__all__ = ["draw_body"]

_FULL_COLOUR_KPA = 12.0
"""Pressure shown in full colour [kPa], typical of a hold."""
_FULL_COLOUR = 0.3
"""Force reading shown in full colour, that of a high force."""


def draw_body(deployment: Deployment, base: Path, results: dict[str, ProcessResult], out: Path) -> str | None:
    """Render the body to `body.png`; return the reason if the computer cannot render."""
    values = [0.0] * sum(patch.n_cells for patch in deployment.patches)
    position: list[float] | None = None
    pose: list[float] | None = None
    stand_top_m: float | None = None
    controller, body = results.get("controller"), results.get("body")
    if controller is not None and body is not None and len(controller.arrays.get("tactile_input_t_ns", ())):
        touch = controller.arrays["tactile_input"].astype(np.float64).max(axis=2)
        moment = int(np.argmax(touch.sum(axis=1)))
        values = np.minimum(touch[moment] / _FULL_COLOUR, 1.0).tolist()
        t_ns = int(controller.arrays["tactile_input_t_ns"][moment])
        position = _value_at(body, "joint_t_ns", "joint_rad", t_ns)
        pose = _value_at(body, "object_t_ns", "object_pose", t_ns)
        stand_top_m = _value_at(body, "stand_t_ns", "stand_top_m", t_ns)
    if deployment.nursing is not None and body is not None and BOARD_PROCESS in results:
        values += np.clip(
            results[BOARD_PROCESS].arrays["pattern_kpa"][-1] / _FULL_COLOUR_KPA, 0.0, 1.0
        ).tolist()
        position = body.arrays["joint_rad"][-1].tolist()
        pose = body.arrays["object_pose"][-1].tolist() if len(body.arrays.get("object_pose", ())) else None
    path, reason = render_body(deployment, base, out / "body.png", values, position, pose, stand_top_m)
    return None if path is not None else reason


def _value_at(body: ProcessResult, times: str, name: str, t_ns: int) -> Any:
    """Value of the body's array `name` at `t_ns`; None if there is no such array."""
    if not len(body.arrays.get(name, ())):
        return None
    values = body.arrays[name]
    return values[min(int(np.searchsorted(body.arrays[times], t_ns)), len(values) - 1)].tolist()
