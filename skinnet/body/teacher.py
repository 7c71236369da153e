"""The teacher: a finger that touches cells as the deployment's script says."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.foundation import Foundation
from skinnet.body.surface import element_centre_m
from skinnet.body.truth import TouchTruth
from skinnet.clock import NS_PER_S
from skinnet.deployment.schema import CellSpec, TeacherSpec, TouchSpec
from skinnet.errors import DeploymentError

__all__ = ["Phase", "Teacher"]

Floats = NDArray[np.float64]

_PARKED_M = (0.0, 0.0, 100.0)
_GAIN_M_S = 0.08
"""Speed of the finger for a force error of the whole wanted force: integral control by the depth. A ball
in foam feels F ∝ depth², hence a time constant of depth / (2 × gain): 30 ms at 5 mm (assumed)."""
_SETTLED = 0.02
"""A force counts as reached within this share of it."""


class Phase(Enum):
    """What the finger does."""

    PARKED = "parked"
    APPROACH = "approach"
    HOLD = "hold"
    WITHDRAW = "withdraw"


@dataclass(frozen=True)
class _Aim:
    """Where a touch goes: a point on the face of a cell, in the frame of the body that carries it."""

    body: int
    row: int
    point_m: Floats
    normal: Floats


@dataclass
class _Touch:
    """The touch that is under way; the line is the way of the finger, outwards, world."""

    spec: TouchSpec
    aim: _Aim
    truth: TouchTruth
    height_m: float
    line: tuple[Floats, Floats]


class Teacher:
    """The finger's script, followed step by step.

    A touch begins `start_s` after its stage did, or when the finger is free again after an earlier one. When
    another stage begins, the finger withdraws and what was left of the old stage never happens. A touch
    by force holds the force on the force cell that it aims at, or the whole force on the finger when it
    aims at the middle of a cell.

    Attributes:
        phase: What the finger does.
        truth: What the touches so far really were; the last one may still last.
    """

    def __init__(
        self,
        data: mujoco.MjData,
        finger: int,
        foundation: Foundation,
        spec: TeacherSpec,
        cells: Mapping[str, slice],
        cell_spec: CellSpec,
    ) -> None:
        """Parks the finger.

        Args:
            data: State of the simulation.
            finger: Body id of the finger.
            foundation: The foam that feels it.
            spec: The script.
            cells: Rows of each patch's cells, by the name of the patch.
            cell_spec: Geometry of a cell.

        Raises:
            DeploymentError: a touch aims at a cell that does not exist.
        """
        self.phase = Phase.PARKED
        self.truth: list[TouchTruth] = []
        self._data = data
        self._finger = finger
        self._mocap = int(data.model.body_mocapid[finger])
        self._foundation = foundation
        self._spec = spec
        self._aims = [_aim(i, touch, foundation, cells, cell_spec) for i, touch in enumerate(spec.touches)]
        self._queue: deque[int] = deque()
        self._stage = ""
        self._stage_ns = 0
        self._touch: _Touch | None = None
        self._velocity_m_s = np.zeros(3)
        data.mocap_pos[self._mocap] = _PARKED_M

    def begin_stage(self, name: str, t_ns: int) -> None:
        """The program's stage `name` began at `t_ns`."""
        touches = self._spec.touches
        mine = [index for index, touch in enumerate(touches) if touch.stage == name]
        self._queue = deque(sorted(mine, key=lambda index: (touches[index].start_s, index)))
        self._stage, self._stage_ns = name, t_ns
        if self.phase in (Phase.APPROACH, Phase.HOLD):
            self.phase = Phase.WITHDRAW

    def tell_velocity(self) -> None:
        """Tells MuJoCo how fast the finger moves: to MuJoCo a mocap body stands still wherever it is put."""
        if self._touch is not None:
            self._data.cvel[self._finger, 3:] = self._velocity_m_s

    def step(self, t_ns: int, step_ns: int) -> None:
        """Moves the finger to where it is at `t_ns + step_ns`, from poses and forces at `t_ns`."""
        touch = self._touch or self._begin(t_ns)
        if touch is None:
            return
        step_s = step_ns / NS_PER_S
        felt_n = self._felt_n(touch)
        finger_n = float(self._foundation.pressed.on_body_n[self._finger]) + self._shell_n()
        touch.truth.observe(t_ns, step_s, finger_n, felt_n, self.phase is Phase.HOLD)
        if self.phase is Phase.WITHDRAW:
            touch.height_m += touch.spec.speed_m_s * step_s
            if touch.height_m >= touch.spec.approach_m:
                self._end(touch, t_ns)
                return
        else:
            self._advance(touch, felt_n, t_ns, step_s)
        self._place(touch, step_s)

    def _begin(self, t_ns: int) -> _Touch | None:
        """Starts the next touch if it is due."""
        if not self._queue:
            return None
        index = self._queue[0]
        spec, aim = self._spec.touches[index], self._aims[index]
        if t_ns < self._stage_ns + round(spec.start_s * NS_PER_S):
            return None
        self._queue.popleft()
        truth = TouchTruth(touch=index, cell=spec.cell, stage=self._stage, begin_ns=t_ns)
        self._touch = _Touch(spec, aim, truth, spec.approach_m, self._line(aim))
        self.truth.append(truth)
        self.phase = Phase.APPROACH
        self._put(self._touch)
        return self._touch

    def _advance(self, touch: _Touch, felt_n: float, t_ns: int, step_s: float) -> None:
        """One step of approach or hold."""
        spec, deepest_m = touch.spec, -self._foundation.foam.thickness_m
        if spec.force_n is not None:
            error = 1.0 - felt_n / spec.force_n
            inward_m_s = min(max(_GAIN_M_S * error, -spec.speed_m_s), spec.speed_m_s)
            touch.height_m = max(touch.height_m - inward_m_s * step_s, deepest_m)
            there = abs(error) <= _SETTLED or touch.height_m <= deepest_m
        else:
            assert spec.depth_m is not None
            touch.height_m = max(touch.height_m - spec.speed_m_s * step_s, -spec.depth_m)
            there = touch.height_m <= -spec.depth_m
        truth = touch.truth
        if self.phase is Phase.APPROACH and there:
            truth.hold_ns, self.phase = t_ns, Phase.HOLD
        if truth.hold_ns is not None and t_ns >= truth.hold_ns + round(spec.hold_s * NS_PER_S):
            self.phase = Phase.WITHDRAW

    def _end(self, touch: _Touch, t_ns: int) -> None:
        touch.truth.end_ns = t_ns
        self.phase = Phase.PARKED
        self._touch = None
        self._data.mocap_pos[self._mocap] = _PARKED_M

    def _felt_n(self, touch: _Touch) -> float:
        """Normal force [N] on what the touch aims at."""
        pressed = self._foundation.pressed
        if touch.spec.force_cell is None:
            return float(pressed.on_body_n[self._finger])
        return float(pressed.force_n[touch.aim.row, touch.spec.force_cell])

    def _shell_n(self) -> float:
        """Normal force [N] of the finger's rigid contacts: with the shell under fully pressed foam."""
        data = self._data
        wrench = np.zeros(6)
        total_n = 0.0
        for index in range(data.ncon):
            if self._finger in data.model.geom_bodyid[data.contact[index].geom]:
                mujoco.mj_contactForce(data.model, data, index, wrench)
                total_n += float(wrench[0])
        return total_n

    def _line(self, aim: _Aim) -> tuple[Floats, Floats]:
        """Point aimed at and outward normal, world, at the present pose of the cell."""
        R_world_body = self._data.xmat[aim.body].reshape(3, 3)
        return self._data.xpos[aim.body] + R_world_body @ aim.point_m, R_world_body @ aim.normal

    def _place(self, touch: _Touch, step_s: float) -> None:
        """Moves the finger to its height; a touch by force follows the cell."""
        if touch.spec.force_n is not None:
            touch.line = self._line(touch.aim)
        before_m = self._data.mocap_pos[self._mocap].copy()
        self._put(touch)
        self._velocity_m_s = (self._data.mocap_pos[self._mocap] - before_m) / step_s

    def _put(self, touch: _Touch) -> None:
        point_m, normal = touch.line
        self._data.mocap_pos[self._mocap] = point_m + (touch.height_m + self._spec.tip_radius_m) * normal
        mujoco.mju_quatZ2Vec(self._data.mocap_quat[self._mocap], normal)


def _aim(
    index: int, touch: TouchSpec, foundation: Foundation, cells: Mapping[str, slice], cell_spec: CellSpec
) -> _Aim:
    key = f'teacher.touches[{index}].cell = "{touch.cell}"'
    patch, _, number = touch.cell.rpartition("/")
    rows = cells.get(patch)
    if rows is None:
        raise DeploymentError(f"{key}: unknown patch; there are {', '.join(cells)}")
    row = rows.start + int(number)
    if row >= rows.stop:
        raise DeploymentError(f"{key}: {patch} has cells 0 to {rows.stop - rows.start - 1}")
    across_m = np.zeros(2)
    if touch.force_cell is not None:
        across_m = element_centre_m(touch.force_cell, cell_spec.force_cell_radius_m)
    surface = foundation.surface
    R_body_cell = surface.R_body_cell[row]
    on_face_m = R_body_cell @ np.array([*across_m, foundation.foam.thickness_m])
    return _Aim(int(surface.body[row]), row, surface.position_m[row] + on_face_m, R_body_cell[:, 2])
