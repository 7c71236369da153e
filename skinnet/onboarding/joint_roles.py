"""Roles of the joints of a model: which ones a controller moves, and why it leaves the others."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.robot_tree import ancestors, joints_of
from skinnet.covering.felt_solids import felt_geoms
from skinnet.onboarding.geom_points import world_points_m

__all__ = ["JointRole", "Role", "joint_roles", "robot_roots"]

Model: TypeAlias = mujoco.MjModel
Floats = NDArray[np.float64]
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_ONE_DOF = (_HINGE, _SLIDE)
_FLOOR_M = 0.01
"""Height above the lowest point of the robot up to which a wheel stands on the floor (assumed)."""
_ROUND = 0.05
"""Difference of the radius of a wheel over its circumference, as a fraction of it (assumed)."""
_SECTORS = 12
_MAX_AXLE_SLOPE = 0.34
"""Sine of the greatest angle, 20°, of an axle to the floor (assumed)."""


class Role(Enum):
    """Role of a joint in a deployment."""

    CONTROLLED = "controlled"
    FOLLOWER = "follower"
    LOOP = "loop"
    WHEEL = "wheel"
    BASE = "base"
    FREE = "free"
    BALL = "ball"
    OBJECT = "object"


@dataclass(frozen=True)
class JointRole:
    """Role of one joint.

    Attributes:
        joint_id: Id of the joint.
        role: Its role.
        reason: Why it has this role; empty for a controlled one.
    """

    joint_id: int
    role: Role
    reason: str = ""


def joint_roles(mj: Model) -> list[JointRole]:
    """Find the role of each joint of a model, in the order of the model."""
    roots = robot_roots(mj)
    followers, in_loop = _followers(mj), _loop_joints(mj) - _actuated_joints(mj)
    base = {joint for root in roots for joint in _planar_base(mj, root)}
    wheels = _wheels(mj, roots, excluded=base)
    roles = []
    for joint in range(mj.njnt):
        kind, owner = int(mj.jnt_type[joint]), mj.body(int(mj.body_rootid[mj.jnt_bodyid[joint]])).name
        if int(mj.body_rootid[mj.jnt_bodyid[joint]]) not in roots:
            roles.append(JointRole(joint, Role.OBJECT, f"{owner} is an object, not the robot"))
        elif kind == _FREE:
            roles.append(JointRole(joint, Role.FREE, "the base floats: held by fixed_base"))
        elif kind not in _ONE_DOF:
            roles.append(JointRole(joint, Role.BALL, "a ball joint has three DoFs and no servo here"))
        elif joint in followers:
            roles.append(JointRole(joint, Role.FOLLOWER, followers[joint]))
        elif joint in base:
            roles.append(JointRole(joint, Role.BASE, "moves the whole robot over the floor"))
        elif joint in wheels:
            roles.append(JointRole(joint, Role.WHEEL, wheels[joint]))
        elif joint in in_loop:
            roles.append(
                JointRole(joint, Role.LOOP, "moved by a closed loop, without an actuator of its own")
            )
        else:
            roles.append(JointRole(joint, Role.CONTROLLED))
    return roles


def robot_roots(mj: Model) -> list[int]:
    """Bodies on the world that belong to the robot: those above a hinge or slide joint, ascending."""
    one_dof = np.isin(mj.jnt_type, _ONE_DOF)
    return sorted({int(mj.body_rootid[body]) for body in mj.jnt_bodyid[one_dof]})


def _actuated_joints(mj: Model) -> set[int]:
    """Joints that an actuator of the file moves, by itself or by a tendon over them."""
    found: set[int] = set()
    for kind, target in zip(mj.actuator_trntype.tolist(), mj.actuator_trnid[:, 0].tolist(), strict=True):
        if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            found.add(target)
        elif kind == mujoco.mjtTrn.mjTRN_TENDON:
            first = int(mj.tendon_adr[target])
            wraps = range(first, first + int(mj.tendon_num[target]))
            found |= {int(mj.wrap_objid[w]) for w in wraps if mj.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT}
    return found


def _followers(mj: Model) -> dict[int, str]:
    """Joints that an equality of the file ties to another, or holds in place."""
    found = {}
    for equality in range(mj.neq):
        if mj.eq_type[equality] != mujoco.mjtEq.mjEQ_JOINT or not mj.eq_active0[equality]:
            continue
        leader = int(mj.eq_obj2id[equality])
        found[int(mj.eq_obj1id[equality])] = (
            f'follows "{mj.joint(leader).name}"' if leader >= 0 else "held by an equality of the file"
        )
    return found


def _loop_joints(mj: Model) -> set[int]:
    """Joints between two bodies of the robot that `connect` or `weld` ties together."""
    found: set[int] = set()
    for equality in range(mj.neq):
        kind = int(mj.eq_type[equality])  # no NumPy integer equals a member of an enumeration
        if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD) or not mj.eq_active0[equality]:
            continue
        ends = [int(mj.eq_obj1id[equality]), int(mj.eq_obj2id[equality])]
        if mj.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
            ends = [int(mj.site_bodyid[site]) for site in ends]
        if any(mj.body_mocapid[body] >= 0 for body in ends):
            continue
        one, other = (set(ancestors(mj, body)) for body in ends)
        found |= {joint for body in sorted(one ^ other) for joint in joints_of(mj, body)}
    return found


def _planar_base(mj: Model, root: int) -> list[int]:
    """Joints of a base that drives about: from the world on, a slide without limits and what follows it."""
    found: list[int] = []
    body: int | None = root
    while body is not None:
        for joint in joints_of(mj, body):
            if int(mj.jnt_type[joint]) not in _ONE_DOF or mj.jnt_limited[joint]:
                return found
            if not found and mj.jnt_type[joint] != _SLIDE:
                return found
            found.append(joint)
        below = _children(mj, body)
        body = below[0] if len(below) == 1 else None
    return found


def _wheels(mj: Model, roots: Sequence[int], excluded: set[int]) -> dict[int, str]:
    """Wheels: level hinges without limits that end a chain, round about their axis, on the floor.

    A caster is a hinge without limits that carries nothing but wheels.
    """
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    candidates = [
        joint
        for joint in range(mj.njnt)
        if mj.jnt_type[joint] == _HINGE
        and not mj.jnt_limited[joint]
        and joint not in excluded
        and int(mj.body_rootid[mj.jnt_bodyid[joint]]) in roots
    ]
    if not candidates:
        return {}
    robot = [body for body in range(1, mj.nbody) if int(mj.body_rootid[body]) in roots]
    points_m = world_points_m(mj, data, felt_geoms(mj, robot))
    if not len(points_m):
        return {}
    floor_m = float(points_m[:, 2].min()) + _FLOOR_M
    wheels: dict[int, str] = {}
    for joint in reversed(candidates):
        body = int(mj.jnt_bodyid[joint])
        below = _subtree(mj, body)
        inner = [j for b in below for j in joints_of(mj, b) if j != joint]
        if inner:
            if all(j in wheels for j in inner):
                wheels[joint] = "a caster: carries only wheels"
            continue
        points_m = world_points_m(mj, data, felt_geoms(mj, below))
        is_level = abs(data.xaxis[joint][2]) <= _MAX_AXLE_SLOPE
        if (
            is_level
            and len(points_m)
            and points_m[:, 2].min() <= floor_m
            and _is_round(mj, data, joint, points_m)
        ):
            wheels[joint] = "a wheel: no limits, round about its axis, on the floor"
    return wheels


def _is_round(mj: Model, data: mujoco.MjData, joint: int, points_m: Floats) -> bool:
    """True if points reach equally far from the axis of a joint all around."""
    axis = data.xaxis[joint]
    off_m = points_m - data.xanchor[joint]
    across_m = off_m - np.outer((off_m * axis).sum(axis=1), axis)
    radius_m = np.sqrt((across_m * across_m).sum(axis=1))
    x = np.cross(axis, [0.0, 0.0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0.0, 0.0])
    y = np.cross(axis, x)
    angle = np.arctan2((across_m * y).sum(axis=1), (across_m * x).sum(axis=1))
    sector = np.minimum(((angle / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int), _SECTORS - 1)
    reach_m = np.array([radius_m[sector == k].max(initial=0.0) for k in range(_SECTORS)])
    return bool(reach_m.max() - reach_m.min() <= _ROUND * reach_m.max())


def _children(mj: Model, body: int) -> list[int]:
    return [b for b in range(1, mj.nbody) if int(mj.body_parentid[b]) == body]


def _subtree(mj: Model, body: int) -> list[int]:
    return [b for b in range(body, mj.nbody) if body in ancestors(mj, b)]
