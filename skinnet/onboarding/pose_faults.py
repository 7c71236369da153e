"""Judgement of a pose: axes along gravity, links that touch, joints without room for a step."""

import copy
import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.home_posture import MAX_GAP
from skinnet.body.joint_motion import close_equalities
from skinnet.body.robot_tree import contact_distances_m, sine_to_gravity
from skinnet.onboarding.joint_roles import Role, robot_roots
from skinnet.onboarding.robot_survey import RobotSurvey
from skinnet.random_streams import StreamName, generator

__all__ = ["PoseFaults", "PoseJudge"]

Floats = NDArray[np.float64]

_BLIND_RAD = math.asin(0.1)
"""Angle of an axis to gravity, 5.7°, below which a turn of 0.1 rad changes gravity by less than 0.01 g."""
_WANTED_RAD = math.radians(20.0)
"""Angle of an axis to gravity beyond which nothing is gained (assumed)."""
_ROOM = 0.15
"""Room for a step on both sides of a position [rad or m]: a step of 0.1 and some way to stop (assumed)."""
_CLEARANCE_M = 0.025
"""Clearance of links that is wanted: a foam of 12 mm on both (assumed)."""
_BLIND_COST, _TOUCH_COST, _NEAR_COST, _FAR_COST = 2.0, 4.0, 1.5, 0.05
"""Costs in units of an axis along gravity: blind, links that touch, links that are near, away from the start
by all of its range (assumed)."""
_OPEN_COST = 10.0
_SAMPLES = 12
"""Poses in all of which two links must touch to count as inseparable."""


@dataclass(frozen=True)
class PoseFaults:
    """Faults of a pose.

    Attributes:
        blind: Joints whose motion turns no cell against gravity, by id, with the reason.
        touching: Pairs of links that touch.
        cramped: Joints whose limits leave no room for a step, by id, with the reason.
        outside: True if a position is beyond a limit.
        avoidable: Those of them that another pose could mend, as text.
    """

    blind: dict[int, str]
    touching: tuple[str, ...]
    cramped: dict[int, str]
    outside: bool
    avoidable: tuple[str, ...]


class PoseJudge:
    """Judge of the poses of one robot, with its base held where the file draws it.

    Attributes:
        joint_id: (D,) ids of the controlled joints.
        qpos_address: (D,) their addresses.
        reference: (D,) their positions as the file draws the robot.
        low: (D,) least position that leaves room for a step.
        high: (D,) greatest.
    """

    def __init__(self, survey: RobotSurvey) -> None:
        self._survey = survey
        mj = self._mj = copy.copy(survey.mj)
        mj.geom_margin[:] = _CLEARANCE_M
        mj.pair_margin[:] = _CLEARANCE_M
        self._data = mujoco.MjData(mj)
        self.joint_id = np.array(survey.joints(Role.CONTROLLED), dtype=np.int64)
        self.qpos_address = mj.jnt_qposadr[self.joint_id]
        self.reference: Floats = mj.qpos0[self.qpos_address].copy()
        limited = mj.jnt_limited[self.joint_id].astype(bool)
        self._range = np.where(limited[:, None], mj.jnt_range[self.joint_id], [-math.inf, math.inf])
        self._is_hinge = mj.jnt_type[self.joint_id] == mujoco.mjtJoint.mjJNT_HINGE
        self._span = np.where(limited, self._range[:, 1] - self._range[:, 0], 2.0 * math.pi)
        low = np.where(limited, self._range[:, 0], self.reference - math.pi)
        high = np.where(limited, self._range[:, 1], self.reference + math.pi)
        room = np.minimum(_ROOM, 0.5 * self._span)
        self.low: Floats = low + np.where(limited, room, 0.0)
        self.high: Floats = high - np.where(limited, room, 0.0)
        following = np.isin(mj.dof_jntid, survey.joints(Role.FOLLOWER, Role.LOOP, Role.BALL, Role.WHEEL))
        self._held = np.flatnonzero(~following)
        self._gap = 0.0
        self._is_robot = np.isin(mj.body_rootid, robot_roots(mj))
        self._is_moved = np.array([bool(survey.joints_above(body)) for body in range(mj.nbody)])
        self._free_axis = self._axes_that_turn()
        self._inseparable = self._always_touching()

    def clipped(self, position: Floats) -> Floats:
        """Position (D,) within limits and with room for steps."""
        clipped: Floats = np.clip(position, self.low, self.high).round(3)
        return clipped

    def positions(self, position: Floats) -> dict[int, float]:
        """Positions (D,) by the ids of their joints."""
        return dict(zip(self.joint_id.tolist(), position.tolist(), strict=True))

    def cost(self, position: Floats, start: Floats) -> float:
        """Cost of a pose: what is wrong with it, and a little for its distance from `start`."""
        self._set(position)
        total = float((((position - start) / self._span) ** 2).sum()) * _FAR_COST
        total += _OPEN_COST * (self._gap > MAX_GAP)
        angles = self._angles_rad()
        if angles is not None:
            total += float(np.maximum(0.0, 1.0 - angles / _WANTED_RAD).sum())
            total += _BLIND_COST * float((angles < 1.2 * _BLIND_RAD).sum())
        for pair, distance_m in self._near_pairs().items():
            if pair in self._inseparable:
                continue
            total += _TOUCH_COST if distance_m <= 0.0 else _NEAR_COST * (1.0 - distance_m / _CLEARANCE_M)
        return total

    def faults(self, position: Floats) -> PoseFaults:
        """Faults of a pose."""
        self._set(position)
        name = self._survey.joint_name
        blind, avoidable = self._blind()
        pairs = [pair for pair, distance_m in self._near_pairs().items() if distance_m <= 0.0]
        touching = [self._pair_text(pair) for pair in pairs]
        if self._gap > MAX_GAP:
            avoidable.append("equality constraints of the model are not met")
        avoidable += [f"{self._pair_text(pair)} touch" for pair in pairs if pair not in self._inseparable]
        cramped, outside = {}, False
        for row, joint in enumerate(self.joint_id.tolist()):
            low, high = self._range[row]
            if not low - 1e-9 <= position[row] <= high + 1e-9:
                outside = True
                avoidable.append(f'"{name(joint)}" is outside its limits')
            elif high - low < 2.0 * _ROOM:
                cramped[joint] = f"its range of {high - low:.3g} leaves no room for a step of 0.1"
            elif not low + _ROOM - 1e-3 <= position[row] <= high - _ROOM + 1e-3:
                avoidable.append(f'"{name(joint)}" is within {_ROOM:g} of a limit')
        return PoseFaults(blind, tuple(touching), cramped, outside, tuple(avoidable))

    def _blind(self) -> tuple[dict[int, str], list[str]]:
        """Joints that turn no cell against gravity, and those of them that another pose could mend."""
        angles_rad = self._angles_rad()
        blind, avoidable, hinge = {}, [], 0
        for row, joint in enumerate(self.joint_id.tolist()):
            if not self._is_hinge[row]:
                blind[joint] = "a slide turns no cell against gravity"
                continue
            if angles_rad is None:
                blind[joint] = "the model has no gravity"
            elif angles_rad[hinge] < _BLIND_RAD:
                turns = self._free_axis[row]
                angle = f"{math.degrees(angles_rad[hinge]):.1f}°"
                blind[joint] = (
                    f"its axis is {angle} off gravity, and no better pose was found"
                    if turns
                    else "its axis stands along gravity in every pose"
                )
                if turns:
                    avoidable.append(f'the axis of "{self._survey.joint_name(joint)}" is {angle} off gravity')
            hinge += 1
        return blind, avoidable

    def _set(self, position: Floats) -> None:
        mj, data = self._mj, self._data
        data.qpos[:] = mj.qpos0
        data.qpos[self.qpos_address] = position
        qpos = data.qpos.copy()
        self._gap = close_equalities(mj, qpos, self._held)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(mj, data)

    def _angles_rad(self) -> Floats | None:
        """Angles (h,) of the axes of controlled hinges to the line of gravity [rad]; None without gravity."""
        sine = sine_to_gravity(self._mj, self._data.xaxis[self.joint_id[self._is_hinge]])
        return None if sine is None else np.asarray(np.arcsin(np.minimum(sine, 1.0)))

    def _axes_that_turn(self) -> NDArray[np.bool_]:
        """Controlled joints (D,) that are hinges whose angle to gravity depends on the pose."""
        offsets = np.array([0.37, 0.61, 0.83])
        turns = np.zeros(len(self.joint_id), dtype=np.bool_)
        self._set(self.reference)
        first = self._angles_rad()
        for k in range(len(offsets)):
            self._set(self.reference + offsets[(np.arange(len(self.joint_id)) + k) % len(offsets)])
            angles = self._angles_rad()
            if first is not None and angles is not None:
                turns[self._is_hinge] |= np.abs(angles - first) > 1e-6
        return turns

    def _always_touching(self) -> set[tuple[int, int]]:
        """Pairs of bodies that touch in all of several poses: the file draws them one into the other."""
        random = generator(0, StreamName.HOME_POSE)
        found: set[tuple[int, int]] | None = None
        for _ in range(_SAMPLES):
            self._set(self.low + random.random(len(self.joint_id)) * (self.high - self.low))
            touching = {pair for pair, distance_m in self._near_pairs().items() if distance_m <= 0.0}
            found = touching if found is None else found & touching
        return found or set()

    def _pair_text(self, pair: tuple[int, int]) -> str:
        return " and ".join(f'"{self._mj.body(body).name}"' for body in pair)

    def _near_pairs(self) -> dict[tuple[int, int], float]:
        """Pairs of bodies, one of them moved, that are nearer than the clearance, with their distance [m]."""
        mj, data = self._mj, self._data
        mujoco.mj_collision(mj, data)
        return {
            pair: distance_m
            for pair, distance_m in sorted(contact_distances_m(mj, data).items())
            if distance_m < _CLEARANCE_M and self._is_robot[[*pair]].any() and self._is_moved[[*pair]].any()
        }
