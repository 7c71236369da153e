"""Stages of the controller's program, each a state machine without I/O."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellRows
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.teach_and_grasp import TeachAndGrasp
from controller.self_model import SelfModel
from controller.selforganisation.exploration import Exploration, PositionControl, add_readings
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.selforganisation.structural_exploration import (
    StructuralExploration,
    StructuralExplorationConfig,
)
from controller.stages.guidance import GuidanceStage
from controller.stages.passive import PassiveStage
from controller.touch.posture import PoseTarget, PostureControl
from controller.touch.tactile_state import TactileState
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.stages import StageSpec

__all__ = ["ExplorationStage", "PostureStage", "Stage", "make_stage"]


class Stage(Protocol):
    """Stage of the program, ticked until it is done."""

    @property
    def state_name(self) -> str:
        """State within the stage; empty for a stage without states."""

    @property
    def reason(self) -> str:
        """Event of the last change of the label; empty before the first."""

    @property
    def done(self) -> bool:
        """True once the stage is complete."""

    @property
    def progress(self) -> float:
        """Completed fraction of the stage, 0 to 1."""

    @property
    def needs_stream(self) -> bool:
        """True while the full readings of all cells are needed."""

    @property
    def gains(self) -> NDArray[np.float64] | None:
        """Reaction gains (S, 4), whose cells stream while in contact; None without reactions."""

    @property
    def thresholds(self) -> NDArray[np.float64] | None:
        """Reaction thresholds (S, 4), inf where the gain is zero; None without reactions."""

    @property
    def tactile_input(self) -> NDArray[np.float64] | None:
        """Tactile input (S, 4) of the last tick's reaction; None without reactions."""

    def add_readings(self, stream: CellRows) -> None:
        """Process the full readings of a tick."""

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Compute the joint velocities (D,) [rad/s] at `t_ns`, from the measured positions (D,)."""

    def finish(self, t_ns: int) -> None:
        """Store the result in the self-model."""


class ExplorationStage:
    """Exploration stage of self-organisation: kinematic structure or sensory-motor map."""

    state_name = reason = ""
    gains = None
    thresholds = None
    tactile_input = None

    def __init__(
        self,
        program: StructuralExploration | MapExploration,
        self_model: SelfModel,
        memory: LongTermMemory,
    ) -> None:
        self._program: Exploration = program
        self._exploration = program
        self._self_model, self._memory = self_model, memory

    @property
    def done(self) -> bool:
        """True once the motion program is complete."""
        return self._program.done

    @property
    def progress(self) -> float:
        """Completed fraction of the motion program."""
        return self._program.progress

    @property
    def needs_stream(self) -> bool:
        """True while the accelerations of all cells are needed."""
        return self._program.needs_stream

    def add_readings(self, stream: CellRows) -> None:
        """Add accelerations to the averages and lock-in detectors, and touch to what stops a motion."""
        add_readings(self._program, stream)

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Compute the velocities of the motion program."""
        if isinstance(self._exploration, MapExploration):
            self._exploration.add_positions(t_ns, position_rad)
        return self._program.step(t_ns, position_rad)

    def finish(self, t_ns: int) -> None:
        """Store the structure, or the map fused with the activity matrix."""
        knowledge = self._self_model
        if isinstance(self._exploration, StructuralExploration):
            knowledge.structure = self._exploration.result
        else:
            knowledge.add_map(self._exploration.result)
        self._memory.store_structure()


class PostureStage:
    """Posture stage: moves to a pose by equation (5) of [M14]."""

    state_name = reason = ""
    gains = None
    thresholds = None
    tactile_input = None
    needs_stream = False

    def __init__(self, target: PoseTarget) -> None:
        self._posture = PostureControl()
        self._posture.set_target(target)
        self._target = target
        self._initial_distance_rad = 0.0
        self._distance_rad = np.inf
        self.done = False

    @property
    def progress(self) -> float:
        """Completed fraction of the largest joint distance."""
        if self.done:
            return 1.0
        return (
            max(0.0, 1.0 - self._distance_rad / self._initial_distance_rad)
            if self._initial_distance_rad > 0.0
            else 0.0
        )

    def add_readings(self, stream: CellRows) -> None:
        """Ignore the readings: a posture uses no tactile input."""

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Compute the velocities towards the pose; the completion event ends the stage."""
        velocity, event = self._posture.step(t_ns, position_rad)
        self._distance_rad = float(np.abs(self._target.position_rad - position_rad).max())
        self._initial_distance_rad = max(self._initial_distance_rad, self._distance_rad)
        self.done = self.done or event is not None
        return velocity

    def finish(self, t_ns: int) -> None:
        """Store nothing."""


def make_stage(
    spec: StageSpec,
    control: ControllerSpec,
    self_model: SelfModel,
    memory: LongTermMemory,
    tactile_state: TactileState,
    *,
    t_ns: int,
    n_cells: int,
    home_rad: NDArray[np.float64],
    range_rad: NDArray[np.float64] | None,
) -> Stage:
    """Build the stage of `spec`, starting at `t_ns`.

    `home_rad` (D,) is the initial pose, `range_rad` (D, 2) the limits of the joints, if they are known.
    """
    n_dofs = len(home_rad)
    names = {"dof_names": self_model.dof_names, "cell_names": self_model.cell_names}
    match spec.kind:
        case "structure":
            structure_config = _structure_config(control, range_rad)
            structure = StructuralExploration(structure_config, n_dofs, n_cells, t_ns, **names)
            return ExplorationStage(structure, self_model, memory)
        case "map":
            explored = MapExploration(_map_config(control, range_rad), n_dofs, n_cells, t_ns, **names)
            return ExplorationStage(explored, self_model, memory)
        case "posture":
            pose = home_rad if spec.pose == "home" else np.array(control.poses_rad[spec.pose])
            return PostureStage(PoseTarget(spec.pose, pose, spec.speed_rad_s, spec.tolerance_rad))
        case "guide":
            return GuidanceStage(spec, control, self_model, n_cells, t_ns)
        case "passive":
            assert spec.duration_s is not None
            return PassiveStage(spec.duration_s, t_ns)
        case "teach_and_grasp":
            return TeachAndGrasp(
                control,
                self_model,
                memory,
                _map_config(control, range_rad),
                tactile_state,
                n_dofs,
                n_cells,
                t_ns,
            )


def _structure_config(
    control: ControllerSpec, range_rad: NDArray[np.float64] | None
) -> StructuralExplorationConfig:
    spec = control.structure
    return StructuralExplorationConfig(
        step_rad=spec.step_rad,
        average_ns=round(spec.averaging_s * 1e9),
        settle_ns=round(spec.settle_s * 1e9),
        threshold_g=spec.threshold_g,
        position_control=PositionControl(
            speed_rad_s=spec.speed_rad_s, delay_ns=_feedback_delay_ns(control), range_rad=range_rad
        ),
        min_samples=max(1, round(25 * spec.averaging_s)),
    )


def _map_config(control: ControllerSpec, range_rad: NDArray[np.float64] | None) -> MapExplorationConfig:
    spec = control.map
    return MapExplorationConfig(
        amplitude_rad_s=spec.amplitude_rad_s,
        frequency_hz=spec.frequency_hz,
        tilt_frequency_hz=spec.tilt_frequency_hz,
        periods=spec.periods,
        settle_ns=round(spec.settle_s * 1e9),
        position_control=PositionControl(delay_ns=_feedback_delay_ns(control), range_rad=range_rad),
    )


def _feedback_delay_ns(control: ControllerSpec) -> int:
    """Time [ns] from a command to the tick that sees its effect."""
    return control.command_delay_ns + control.period_ns
