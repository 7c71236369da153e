"""What the robot knows of itself, and what it remembers of its reactions for those who judge it later."""

from dataclasses import dataclass, field

from controller.selforganisation.sensory_motor_map import SensoryMotorMap
from controller.selforganisation.structure import Structure

__all__ = ["Knowledge", "Onset"]


@dataclass(frozen=True)
class Onset:
    """A channel of a cell began to drive a reaction.

    Attributes:
        stage: During which stage of the program.
        cell: Row of the cell.
        channel: 0 to 2 are force cells, 3 is proximity.
        t_sampled_ns: When the cell took the sample that did it.
        t_delivered_ns: When that reached the gateway.
        t_ns: The tick that used it.
    """

    stage: str
    cell: int
    channel: int
    t_sampled_ns: int
    t_delivered_ns: int
    t_ns: int


@dataclass
class Knowledge:
    """Found by exploration, used by reactions; no model of the robot in it.

    Attributes:
        cut: Cells whose fused vector is shorter cannot move along their normal.
        structure: From the structural exploration; None before.
        map: Sensory-motor maps by pose.
        map_problems: What the exploration of the map could not measure.
        onsets: When which channel began to drive a reaction.
    """

    cut: float
    structure: Structure | None = None
    map: SensoryMotorMap = field(default_factory=SensoryMotorMap)
    map_problems: tuple[str, ...] = ()
    onsets: list[Onset] = field(default_factory=list)
