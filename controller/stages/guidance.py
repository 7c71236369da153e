"""Tactile guidance stage."""

import numpy as np
from numpy.typing import NDArray

from controller.self_model import SelfModel
from controller.stages.timed import TimedStage
from controller.touch.tactile_reaction import TactileReaction
from controller.touch.tactile_state import TactileState
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.protocol.messages import Modality

__all__ = ["GuidanceStage"]


class GuidanceStage(TimedStage):
    """Tactile guidance: the robot evades contact and so follows a push, equation (4) of [M14]."""

    def __init__(
        self, spec: StageSpec, control: ControllerSpec, self_model: SelfModel, n_cells: int, start_ns: int
    ) -> None:
        assert spec.duration_s is not None
        super().__init__(spec.duration_s, start_ns)
        self._max_age_ns = round(control.safety.input_timeout_ms * 1e6)
        self._self_model = self_model
        self._reaction = TactileReaction(n_cells)
        self.tactile_input: NDArray[np.float64] | None = None
        if control.reactions.enabled:
            self.tune(Modality.FORCE, spec.force_threshold, spec.force_gain)
            self.tune(Modality.PROXIMITY, spec.proximity_threshold, spec.proximity_gain)

    def tune(self, modality: Modality, threshold: float, gain: float) -> None:
        """Set threshold and gain of a modality for all cells."""
        self._reaction.tune(modality, threshold=threshold, gain=gain)

    @property
    def gains(self) -> NDArray[np.float64]:
        """Reaction gains (S, 4) [rad/s per reading]."""
        return self._reaction.gains

    @property
    def thresholds(self) -> NDArray[np.float64]:
        """Reaction thresholds (S, 4), inf where the gain is zero."""
        return self._reaction.thresholds

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Compute the superposed reactions (D,) [rad/s] of all cells, by the map of the closest pose."""
        self._t_ns = t_ns
        # cells in contact stream: an old reading means lost packets
        touch = tactile_state.reaction_readings(t_ns, self._max_age_ns)
        velocity = self._reaction.velocity(touch, self._self_model.sensory_motor_map.closest(position_rad))
        self.tactile_input = touch
        return velocity
