"""Low-level control of a state: superposition of tactile reaction and posture control [M14, V]."""

import numpy as np
from numpy.typing import NDArray

from controller.grasping.state_machine import Event
from controller.grasping.state_parameters import Area, ReactionParameters, StateParameters
from controller.self_model import SelfModel
from controller.touch.posture import PoseTarget, PostureControl
from controller.touch.tactile_reaction import TactileReaction
from controller.touch.tactile_state import TactileState
from skinnet.protocol.messages import FOREVER_NS, Modality

__all__ = ["LowLevelControl"]

_MIN_PROGRESS_RAD = 0.002
"""Minimum decrease [rad] of the summed joint distance that counts as progress (assumed)."""


class LowLevelControl:
    """Low-level controllers under the current state's parameters, with their completion events.

    Attributes:
        tactile_input: (S, 4) tactile input of the last tick's reaction; None while all gains are zero.
        reacting: True if the last tick had a tactile reaction.
    """

    def __init__(self, self_model: SelfModel, n_cells: int, max_age_ns: int, stall_ns: int) -> None:
        """Start with zero gains, without a target pose.

        Args:
            self_model: Maps and areas.
            n_cells: S.
            max_age_ns: Age beyond which readings count as lost.
            stall_ns: Time without progress towards the pose after which the robot counts as stalled.
        """
        self._self_model, self._max_age_ns, self._stall_ns = self_model, max_age_ns, stall_ns
        self._reaction = TactileReaction(n_cells)
        self._posture = PostureControl()
        self._target: PoseTarget | None = None
        self._timeout_ns: float = FOREVER_NS
        self._min_distance_rad, self._last_progress_ns = np.inf, 0
        self.tactile_input: NDArray[np.float64] | None = None
        self.reacting = False

    @property
    def gains(self) -> NDArray[np.float64]:
        """Reaction gains (S, 4) [rad/s per reading]."""
        return self._reaction.gains

    def apply(
        self, t_ns: int, parameters: StateParameters, target: PoseTarget | None, *, reactions_enabled: bool
    ) -> None:
        """Apply a state's parameters: set the gains of all areas, and the posture target if any."""
        self._reaction.inhibit()
        if reactions_enabled:
            self._tune(None, parameters.reactions.get(Area.OTHER, ReactionParameters()))
            for label, area_cells in self._self_model.areas.items():
                self._tune(area_cells, parameters.reactions.get(Area(label), ReactionParameters()))
        self._target = target
        if target is None:
            self._posture.clear_target()
        else:
            self._posture.set_target(target)
        self._timeout_ns = t_ns + min(parameters.timeout_s * 1e9, FOREVER_NS)
        self._min_distance_rad, self._last_progress_ns = np.inf, t_ns

    def _tune(self, cells: NDArray[np.int64] | None, gains: ReactionParameters) -> None:
        """Set thresholds and gains of the cells (n,) of an area, or of all."""
        for modality, threshold, gain in (
            (Modality.FORCE, gains.force_threshold, gains.force_gain),
            (Modality.PROXIMITY, gains.proximity_threshold, gains.proximity_gain),
        ):
            self._reaction.tune(modality, threshold=threshold, gain=gain, cells=cells)

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> tuple[NDArray[np.float64], set[Event]]:
        """Compute the joint velocities (D,) [rad/s], and the completion events of this tick."""
        velocity, reached = self._posture.step(t_ns, position_rad)
        events = set() if reached is None else {Event.POSE_REACHED}
        if self._stalled(t_ns, position_rad):
            events.add(Event.STALLED)
        if t_ns >= self._timeout_ns:
            events.add(Event.TIMED_OUT)
        self.tactile_input, self.reacting = None, False
        if self._reaction.gains.any() and len(self._self_model.sensory_motor_map):
            # cells in contact stream: an old reading means lost packets
            touch = tactile_state.reaction_readings(t_ns, self._max_age_ns)
            reaction = self._reaction.velocity(
                touch, self._self_model.sensory_motor_map.closest(position_rad)
            )
            velocity = velocity + reaction
            self.tactile_input, self.reacting = touch, bool(self._reaction.activation(touch).any())
        return velocity, events

    def _stalled(self, t_ns: int, position_rad: NDArray[np.float64]) -> bool:
        """Return True after `stall_ns` without progress to the pose; a push after arrival is no stall."""
        if self._target is None:
            return False
        away = np.abs(self._target.position_rad - position_rad)
        left_rad = float(away.sum())
        if (
            left_rad < self._min_distance_rad - _MIN_PROGRESS_RAD
            or (away <= self._target.tolerance_rad).all()
        ):
            self._min_distance_rad, self._last_progress_ns = left_rad, t_ns
        return t_ns - self._last_progress_ns > self._stall_ns
