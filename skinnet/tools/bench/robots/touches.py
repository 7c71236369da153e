"""Touches of a robot with known forces: what its cells feel, and whether the robot moves away.

The force is that which the teacher's finger was asked for; the cells' forces are added up over the whole
skin. A robot evades if the cell that was touched has moved inwards, as the joints' positions say.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.cell_kinematics import SkinState, cell_jacobian
from skinnet.body.simulation import BodySimulation
from skinnet.body.teacher.evasion import ideal_sensory_motor_map
from skinnet.deployment import Deployment

__all__ = ["choose_cells", "felt_forces"]

Floats = NDArray[np.float64]

_STAGE = "touch"
_HOLD_S = 0.4
_TOUCH_S = 3.0
"""Time between the starts of two touches: approach from 20 mm, hold, withdrawal."""
_SETTLED = 0.5
"""Fraction of the hold after which forces count."""


def choose_cells(deployment: Deployment, base: Path, count: int) -> list[str]:
    """Choose about `count` cells, spread evenly over all that can move along their normal."""
    body = BodySimulation(_without_touches(deployment), base)
    rows = np.arange(len(body.surface.body_id))
    skin = SkinState(body.model, body.data, body.surface)
    moves = np.flatnonzero(ideal_sensory_motor_map(cell_jacobian(skin, rows)).any(axis=1))
    names = [f"{patch.name}/{cell}" for patch in deployment.patches for cell in range(patch.n_cells)]
    chosen = moves[np.unique(np.linspace(0, len(moves) - 1, count).round().astype(int))] if len(moves) else []
    return [names[row] for row in chosen]
