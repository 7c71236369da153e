"""Joint actuation: velocity commands to position servos, the robot's control interface [M14, II.B].

A velocity command moves the targets of the position servos; it holds until the next one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import BodyModel
from skinnet.body.servos import equilibrium_targets_rad
from skinnet.compilation import compiled_without_nrt

__all__ = ["Actuation", "is_valid_command"]

Floats = NDArray[np.float64]


@dataclass
class Actuation:
    """Joint servos: velocity commands integrated into position targets, with anti-windup.

    A target stays within the joint's limits and within the lag at which the servo's torque saturates, so a
    blocked joint does not wind up.

    With compensation the load of gravity, of velocities and of springs in the present state is fed forward,
    as a shift of the servo's input: it is bounded by the servo's torque, and an inner force of the robot.

    Attributes:
        model: The robot model.
        data: MuJoCo's state.
        is_compensated: Feed the load forward.
        velocity_rad_s: (D,) the active command [rad/s].
        refused_commands: Number of refused commands.
    """

    model: BodyModel
    data: mujoco.MjData
    is_compensated: bool
    velocity_rad_s: Floats = field(init=False)
    refused_commands: int = 0
    _target_rad: Floats = field(init=False)
    _lag_rad: Floats = field(init=False)
    _qpos: Floats = field(init=False)
    _ctrl: Floats = field(init=False)
    _loads: tuple[Floats, Floats, Floats] = field(init=False)

    def __post_init__(self) -> None:
        """Set the servo targets to static equilibrium: the servos carry the weight of the arms."""
        model, data = self.model, self.data
        self.velocity_rad_s = np.zeros(len(model.joint_id))
        self._qpos, self._ctrl = data.qpos, data.ctrl  # MuJoCo makes a new view at each access
        self._loads = data.qfrc_bias, data.qfrc_spring, data.qfrc_gravcomp
        self._lag_rad = model.torque_range_nm / model.gains.kp_nm_per_rad[:, None]
        if self.is_compensated:
            self._target_rad = data.qpos[model.qpos_address]
        else:
            self._target_rad = equilibrium_targets_rad(data, model.actuator_id, model.joint_motion)
        self.advance(0.0)

    def command(self, velocity_rad_s: Sequence[float] | Floats) -> bool:
        """Accept a velocity command (D,) [rad/s]; return False if it is refused.

        A command of another length, with a non-finite value, or above the speed limit is refused and counted:
        the targets stay where they are.
        """
        velocity = np.asarray(velocity_rad_s, dtype=np.float64)
        accepted = is_valid_command(velocity, len(self.velocity_rad_s), self.model.speed_limit_rad_s)
        self.velocity_rad_s = velocity.copy() if accepted else np.zeros_like(self.velocity_rad_s)
        self.refused_commands += not accepted
        return accepted

    def advance(self, step_s: float) -> None:
        """Integrate the servo targets over `step_s` [s] of the active command."""
        _advance(
            self._target_rad,
            self.velocity_rad_s * step_s,
            self.model.range_rad,
            self._lag_rad,
            self._qpos,
            self.model.qpos_address,
            self._ctrl,
            self.model.actuator_id,
        )

    def compensate(self) -> None:
        """Feed the load of the present state forward, after `mj_fwdVelocity`, if it is compensated."""
        if self.is_compensated:
            model = self.model
            kp = model.gains.kp_nm_per_rad
            _compensate(self._target_rad, *self._loads, model.joint_motion, kp, self._ctrl, model.actuator_id)


def is_valid_command(velocity_rad_s: Floats, n_dofs: int, limit_rad_s: Floats) -> bool:
    """Validate a velocity command for `n_dofs` joints: |velocity| within the limits (D,) [rad/s], no NaN."""
    return velocity_rad_s.shape == (n_dofs,) and bool(np.all(np.abs(velocity_rad_s) <= limit_rad_s))


@compiled_without_nrt
def _advance(
    target_rad: Floats,
    change_rad: Floats,
    range_rad: Floats,
    lag_rad: Floats,
    qpos: Floats,
    qpos_index: NDArray[np.int64],
    ctrl: Floats,
    ctrl_index: NDArray[np.int64],
) -> None:
    for d in range(len(target_rad)):
        position_rad = qpos[qpos_index[d]]
        target = target_rad[d] + change_rad[d]
        target = min(max(target, position_rad + lag_rad[d, 0]), position_rad + lag_rad[d, 1])
        target_rad[d] = min(max(target, range_rad[d, 0]), range_rad[d, 1])
        ctrl[ctrl_index[d]] = target_rad[d]


@compiled_without_nrt
def _compensate(
    target_rad: Floats,
    bias: Floats,
    spring: Floats,
    gravcomp: Floats,
    motion: Floats,
    kp: Floats,
    ctrl: Floats,
    ctrl_index: NDArray[np.int64],
) -> None:
    for d in range(len(target_rad)):
        load = 0.0
        for j in range(len(bias)):
            load += motion[d, j] * (bias[j] - spring[j] - gravcomp[j])
        ctrl[ctrl_index[d]] = target_rad[d] + load / kp[d]
