"""Choice of the cells that a teacher touches: where the finger reaches, and where the robot can evade."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import BodyModel, load_model
from skinnet.body.robot_tree import ancestors
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
    """Choose at most `count` cells at home, in turn on all bodies, those with most joints before them first.

    Of each body the cell with the greatest evasion comes first, and then always the one that is farthest from
    all that were taken.

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
    by_body: dict[str, list[_Candidate]] = {}
    for patch in patches:
        by_body.setdefault(patch.body, []).extend(_candidates(deployment, model, data, patch))
    bodies = sorted(
        (body for body in by_body if by_body[body]), key=lambda body: (-_depth(model, body), body)
    )
    queues = [_spread(model, data, by_body[body], count, deployment.teacher.tip_radius_m) for body in bodies]
    turns = zip_longest(*queues)
    return [each.touched for turn in turns for each in turn if each is not None][:count]


class _Candidate(NamedTuple):
    touched: TouchedCell
    face_m: Floats
    normal: Floats


def _candidates(
    deployment: Deployment, model: BodyModel, data: mujoco.MjData, patch: PatchSpec
) -> list[_Candidate]:
    """Cells of a patch that can evade, with the middle of their face [m] and their normal, world."""
    mj, placed = model.mj, place_patch(patch, deployment.cells)
    body = mj.body(patch.body).id
    R = data.xmat[body].reshape(3, 3)
    position_m = matmul(placed.position_m, R.T) + data.xpos[body]
    normal = matmul(placed.R_body_cell[:, :, 2], R.T)
    face_m = position_m + deployment.body.foam.thickness_m * normal
    linear, found = np.empty((3, mj.nv)), []
    for cell in range(placed.n_cells):
        mujoco.mj_jac(mj, data, linear, None, position_m[cell], body)
        along = (linear[:, model.dof_address] * normal[cell][:, None]).sum(axis=0)
        evasion_m = round(math.sqrt(float((along * along).sum())), 3)
        if evasion_m >= _MIN_EVASION_M:
            touched = TouchedCell(f"{patch.name}/{cell}", patch.body, evasion_m)
            found.append(_Candidate(touched, face_m[cell], normal[cell]))
    return found


def _spread(
    model: BodyModel, data: mujoco.MjData, candidates: list[_Candidate], count: int, radius_m: float
) -> list[_Candidate]:
    """At most `count` of the candidates that the finger reaches, each far from those before it."""
    points_m = np.array([each.face_m for each in candidates])
    away_m = np.array([1e-3 * each.touched.evasion_m for each in candidates])  # the first by its evasion
    chosen: list[_Candidate] = []
    while len(chosen) < count and away_m.max() > 0.0:
        i = int(np.argmax(np.round(away_m, 9)))
        away_m[i] = 0.0
        if not _is_free(model, data, candidates[i].face_m, candidates[i].normal, radius_m):
            continue
        distance_m = np.sqrt(((points_m - points_m[i]) ** 2).sum(axis=1))
        away_m = np.where(away_m > 0.0, distance_m if not chosen else np.minimum(away_m, distance_m), 0.0)
        chosen.append(candidates[i])
    return chosen


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
    return sum(above in moving for above in ancestors(mj, int(mj.body(body).id)))
