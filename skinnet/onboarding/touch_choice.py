"""Choice of the cells that a teacher touches: where the finger reaches, and where the robot can evade."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import BodyModel, load_model
from skinnet.deployment import Deployment
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.pinned_linalg import matmul
from skinnet.skin.placement import place_patch

__all__ = ["TouchedCell", "choose_touches"]

Floats = NDArray[np.float64]

_CORRIDOR_M = 0.12
"""Free length above the foam that finger and approach need (assumed)."""
_MIN_EVASION_M = 0.1
"""Least velocity of a cell along its normal for joint velocities of unit length [m/rad] (assumed)."""
_RIM = 6
"""Rays around the middle of the corridor."""


@dataclass(frozen=True)
class TouchedCell:
    """Cell for a touch.

    Attributes:
        cell: Name of the cell.
        body: Body that carries it.
        evasion_m: Velocity along its normal for joint velocities of unit length [m/rad].
    """

    cell: str
    body: str
    evasion_m: float


def choose_touches(
    deployment: Deployment, base_dir: Path, patches: Sequence[PatchSpec], count: int
) -> list[TouchedCell]:
    """Choose at most `count` cells at home, on different bodies, those with most joints before them first.

    Args:
        deployment: The robot.
        base_dir: Folder that its files are relative to.
        patches: Its skin.
        count: Greatest number of cells.
    """
    model = load_model(deployment, base_dir, with_environment=False)
    data = mujoco.MjData(model.mj)
    data.qpos[:] = model.home_qpos
    mujoco.mj_kinematics(model.mj, data)
    mujoco.mj_comPos(model.mj, data)
    best: dict[str, TouchedCell] = {}
    for patch in patches:
        found = _best_cell(deployment, model, data, patch)
        if found is not None and found.evasion_m > best.get(patch.body, found).evasion_m - 1e-9:
            best[patch.body] = found
    return sorted(best.values(), key=lambda touch: (-_depth(model, touch.body), touch.cell))[:count]


def _best_cell(
    deployment: Deployment, model: BodyModel, data: mujoco.MjData, patch: PatchSpec
) -> TouchedCell | None:
    """Cell of a patch with the greatest evasion of those that the finger reaches; None without one."""
    mj, placed = model.mj, place_patch(patch, deployment.cells)
    body = mj.body(patch.body).id
    R = data.xmat[body].reshape(3, 3)
    position_m = matmul(placed.position_m, R.T) + data.xpos[body]
    normal = matmul(placed.R_body_cell[:, :, 2], R.T)
    linear, evasions_m = np.empty((3, mj.nv)), np.empty(placed.n_cells)
    for cell in range(placed.n_cells):
        mujoco.mj_jac(mj, data, linear, None, position_m[cell], body)
        along = (linear[:, model.dof_address] * normal[cell][:, None]).sum(axis=0)
        evasions_m[cell] = math.sqrt(float((along * along).sum()))
    face_m = position_m + deployment.body.foam.thickness_m * normal
    for cell in np.argsort(-np.round(evasions_m, 4), kind="stable").tolist():
        if evasions_m[cell] < _MIN_EVASION_M:
            return None
        if _is_free(model, data, face_m[cell], normal[cell], deployment.teacher.tip_radius_m):
            return TouchedCell(f"{patch.name}/{cell}", patch.body, round(float(evasions_m[cell]), 3))
    return None


def _is_free(model: BodyModel, data: mujoco.MjData, face_m: Floats, normal: Floats, radius_m: float) -> bool:
    """True if nothing stands in the corridor of the finger above a cell."""
    x = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= math.sqrt(float((x * x).sum()))
    y = np.cross(normal, x)
    turns = np.linspace(0.0, 2.0 * math.pi, _RIM, endpoint=False)
    rim_m = 2.0 * radius_m * (np.cos(turns)[:, None] * x + np.sin(turns)[:, None] * y)
    for offset_m in (np.zeros(3), *rim_m):
        found = np.array([-1], dtype=np.int32)
        way_m = mujoco.mj_ray(
            model.mj, data, face_m + offset_m, normal, None, True, model.finger_body_id, found
        )
        if 0.0 <= way_m < _CORRIDOR_M:
            return False
    return True


def _depth(model: BodyModel, body: str) -> int:
    """Number of controlled joints that move a body."""
    mj, moving = model.mj, {int(b) for b in model.mj.jnt_bodyid[model.joint_id]}
    above, current = 0, int(mj.body(body).id)
    while current > 0:
        above += current in moving
        current = int(mj.body_parentid[current])
    return above
