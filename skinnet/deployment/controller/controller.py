"""Controller spec: period, program of stages, reactions and safety."""

from msgspec import field

from skinnet.deployment.controller.exploration import MapExplorationSpec, StructureExplorationSpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.deployment.controller.teach_and_grasp import TeachAndGraspSpec
from skinnet.deployment.types import Name, Positive, Table, ns_of_ms

__all__ = ["ControllerSpec", "ReactionSpec", "SafetySpec"]


class ReactionSpec(Table, frozen=True, kw_only=True):
    """Tactile reactions of the controller."""

    enabled: bool = True
    """Switch for all tactile reactions."""


class SafetySpec(Table, frozen=True, kw_only=True):
    """Safety clamp of the commanded joint velocities *(assumed)*."""

    max_joint_speed_rad_s: Positive = 1.2
    """Speed limit of every joint."""
    input_timeout_ms: Positive = 50.0
    """Age beyond which joint feedback or skin data is stale: the robot slows down and holds."""
    ramp_ms: Positive = 100.0
    """Ramp from full speed to rest when input becomes stale, and back when it is fresh again."""


class ControllerSpec(Table, frozen=True, kw_only=True):
    """Controller: period, program of stages, explorations, reactions and safety."""

    period_ms: Positive = 5.0
    """Control period; equals `body.joint_state_period_ms`."""
    command_delay_ms: Positive | None = None
    """Delay from the control tick to the effect of its command; one control period unless given."""
    program: tuple[Name, ...] = ()
    """Sequence of stages by name, at least one; empty with a `[nursing]` table."""
    stages: dict[str, StageSpec] = field(default_factory=dict)
    """Stages by name, of which `program` is made."""
    poses_rad: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Named poses, with one angle per controlled joint."""
    structure: StructureExplorationSpec = field(default_factory=StructureExplorationSpec)
    """Structural exploration."""
    map: MapExplorationSpec = field(default_factory=MapExplorationSpec)
    """Exploration of the sensory-motor map."""
    reactions: ReactionSpec = field(default_factory=ReactionSpec)
    """Tactile reactions."""
    teach_and_grasp: TeachAndGraspSpec = field(default_factory=TeachAndGraspSpec)
    """Teaching and grasping, for stages of that kind."""
    external_velocity: bool = False
    """Add joint velocities of external clients to those of the controller, before the safety clamp."""
    safety: SafetySpec = field(default_factory=SafetySpec)
    """Safety clamp."""

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return ns_of_ms(self.period_ms)

    @property
    def command_delay_ns(self) -> int:
        """Delay from the control tick to the effect of its command [ns]."""
        return ns_of_ms(self.period_ms if self.command_delay_ms is None else self.command_delay_ms)
