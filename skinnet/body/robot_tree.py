"""Kinematic tree of the robot in its model: its bodies and joints, apart from objects and furniture.

And what is asked of a pose of it: axes along gravity, bodies in contact.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model_file import ONE_DOF, gravity_m_s2
from skinnet.body.simulation import BodySimulation

__all__ = [
    "RobotTree",
    "ancestors",
    "contact_distances_m",
    "joints_of",
    "robot_tree",
    "sine_to_gravity",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_NO_GRAVITY_M_S2 = 1e-9


@dataclass(frozen=True)
class RobotTree:
    """Bodies and joints of the robot: of all trees with a controlled joint, or with skin.

    Attributes:
        body_id: (b,) ids of its bodies, ascending.
        free_joint_id: (f,) ids of its free joints, which carry a base.
        passive_joint_id: (u,) ids of its hinge and slide joints without a servo.
    """

    body_id: Indices
    free_joint_id: Indices
    passive_joint_id: Indices


def robot_tree(body: BodySimulation) -> RobotTree:
    """Robot tree of a simulation."""
    mj, model = body.model.mj, body.model
    servos = np.concatenate([model.actuator_id, model.sway_actuator_id])
    own = mj.jnt_bodyid[mj.actuator_trnid[servos, 0]]
    roots = np.setdiff1d(mj.body_rootid[np.concatenate([own, body.surface.patch_body_id])], [0])
    bodies = np.flatnonzero(np.isin(mj.body_rootid, roots))
    joints = np.flatnonzero(np.isin(mj.jnt_bodyid, bodies))
    kind = mj.jnt_type[joints]
    moved = mj.actuator_trnid[mj.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT, 0]
    coupled = mj.eq_obj1id[(mj.eq_type == mujoco.mjtEq.mjEQ_JOINT) & mj.eq_active0]
    return RobotTree(
        body_id=bodies,
        free_joint_id=joints[kind == mujoco.mjtJoint.mjJNT_FREE],
        passive_joint_id=joints[np.isin(kind, ONE_DOF) & ~np.isin(joints, [*moved, *coupled])],
    )


def ancestors(mj: mujoco.MjModel, body: int) -> list[int]:
    """Body `body` and all above it, without the world."""
    found = []
    while body > 0:
        found.append(body)
        body = int(mj.body_parentid[body])
    return found


def joints_of(mj: mujoco.MjModel, body: int) -> range:
    """Ids of the joints between a body and its parent."""
    first = int(mj.body_jntadr[body])
    return range(first, first + int(mj.body_jntnum[body]))


def contact_distances_m(mj: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[int, int], float]:
    """Distances [m] of pairs of bodies, of ascending ids, at their deepest contact; flexes are left out."""
    found: dict[tuple[int, int], float] = {}
    for pair, distance_m in zip(data.contact.geom.tolist(), data.contact.dist.tolist(), strict=True):
        if min(pair) >= 0:  # a flex has -1 for its geom
            one, other = sorted(int(mj.geom_bodyid[geom]) for geom in pair)
            found[one, other] = min(found.get((one, other), distance_m), distance_m)
    return found


def sine_to_gravity(mj: mujoco.MjModel, axes: Floats) -> Floats | None:
    """Sines (n,) of the angles of unit vectors (n, 3), world, to gravity's line; None without gravity."""
    acts_m_s2 = gravity_m_s2(mj)
    size_m_s2 = float(np.sqrt((acts_m_s2 * acts_m_s2).sum()))
    if size_m_s2 < _NO_GRAVITY_M_S2:
        return None
    across = np.cross(axes, acts_m_s2 / size_m_s2)
    sine: Floats = np.sqrt((across * across).sum(axis=1))
    return sine
