"""Deployment: one TOML file describes one run.

All specs are frozen. Values marked *assumed* have no published source (docs/assumptions.md gives the reason
for each); all others cite theirs. Keys carry their unit; code uses the integer nanoseconds of the properties.
"""

import itertools
import math
from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.nursing import NursingSpec
from skinnet.deployment.environment.objects import NO_OBJECT, ObjectName
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.deployment.environment.scripted_stimuli import ScriptedStimuliSpec
from skinnet.deployment.environment.stand import StandSpec
from skinnet.deployment.environment.teacher import TeacherSpec
from skinnet.deployment.experiment.faults import FaultRule
from skinnet.deployment.experiment.memory import MemorySpec
from skinnet.deployment.experiment.plan import LinkBudgetSpec
from skinnet.deployment.experiment.run import RunSpec
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.deployment.network import BoardNetworkSpec, BridgeSpec, NetworkSpec, PowerSpec
from skinnet.deployment.robot import BodySpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.deployment.skin.sheets import BoardSpec, SheetSpec, SurfaceSpec
from skinnet.deployment.types import Name, Table

__all__ = ["BOARD_PROCESS", "Deployment"]

BOARD_PROCESS = "boards"
"""Name of the process that runs the boards of all tactile sheets."""


class Deployment(Table, frozen=True, kw_only=True):
    """Deployment: the complete description of one run."""

    name: Name
    """Name of the deployment; that of its file for the shipped ones."""
    robot: Name
    """Name of the robot: part of every key on the wire, and what a memory belongs to."""
    seed: Annotated[int, Meta(ge=0)] = 1
    """Seed of all random streams."""
    cell_processes: int | Literal["per_patch"] | dict[Name, tuple[str, ...]] = 2
    """Cell processes: their number, one per patch, or a table of patches by process."""
    run: RunSpec = field(default_factory=RunSpec)
    """Duration, pace and fault tolerance."""
    body: BodySpec
    """Robot model, its joints and periods."""
    cells: CellSpec = field(default_factory=CellSpec)
    """Sampling, sensors and encoding of the HEX-o-SKIN cells."""
    network: NetworkSpec = field(default_factory=NetworkSpec)
    """Links between cells."""
    patches: tuple[PatchSpec, ...] = ()
    """HEX-o-SKIN cells; at least one patch, cover or tactile sheet."""
    cover: tuple[CoverSpec, ...] = ()
    """Covers of links with cells, which become patches before a run."""
    surfaces: tuple[SurfaceSpec, ...] = ()
    """Surfaces that carry tactile sheets."""
    sheets: tuple[SheetSpec, ...] = ()
    """Tactile sheets, each with its board; all boards run in one process, `boards`."""
    boards: BoardSpec = field(default_factory=BoardSpec)
    """Boards of the tactile sheets."""
    board_network: BoardNetworkSpec = field(default_factory=BoardNetworkSpec)
    """Network from the boards to the main PC."""
    bridges: tuple[BridgeSpec, ...] = ()
    """Wires between patches, which then form one network."""
    power: PowerSpec | None = None
    """Power network; without this table every cell has power."""
    plan: LinkBudgetSpec = field(default_factory=LinkBudgetSpec)
    """Load and limits of `skinnet plan`; runs ignore them."""
    faults: tuple[FaultRule, ...] = ()
    """Fault rules, each with a `kind` (docs/faults.md)."""
    scripted_stimuli: ScriptedStimuliSpec | None = None
    """Scripted stimuli instead of physics."""
    teacher: TeacherSpec = field(default_factory=TeacherSpec)
    """Touches, lessons and strokes of the teacher's finger."""
    payload: PayloadSpec | None = None
    """Payload held between the robot's arms."""
    object: ObjectName = NO_OBJECT
    """Object presented by the stand; docs/assumptions.md describes each."""
    stand: StandSpec | None = None
    """Stand in front of the robot."""
    nursing: NursingSpec | None = None
    """Whole-body contact manipulation [R11] as the controller's program, instead of stages."""
    controller: ControllerSpec
    """Program, reactions and safety of the controller."""
    memory: MemorySpec = field(default_factory=MemorySpec)
    """Long-term memory of earlier runs."""
    stress: StressSpec = field(default_factory=StressSpec)
    """Parameter sweep of `skinnet stress`; runs ignore it."""

    @property
    def hyperperiod_ns(self) -> int:
        """Hyperperiod (least common multiple) of stimulus, joint and control periods [ns]; runs end on it."""
        return math.lcm(
            self.body.stimulus_period_ns, self.body.joint_state_period_ns, self.controller.period_ns
        )

    @property
    def max_duration_ns(self) -> int:
        """Latest simulated end time of the run [ns], a whole number of hyperperiods."""
        return -(-round(self.run.max_s * 1e9) // self.hyperperiod_ns) * self.hyperperiod_ns

    def skin_processes(self) -> tuple[str, ...]:
        """List the processes that simulate skin: the cell processes, then that of the boards."""
        return (*self.patches_by_process(), *((BOARD_PROCESS,) if self.sheets else ()))

    def bridged_patches(self) -> tuple[tuple[str, ...], ...]:
        """Group the patches that bridges join into one network; a patch without bridges is its own group."""
        group = {patch.name: [patch.name] for patch in self.patches}
        for bridge in self.bridges:
            one, other = (group.get(parse_port(end)[0]) for end in (bridge.a, bridge.b))
            if one is not None and other is not None and one is not other:
                one += other
                group |= dict.fromkeys(other, one)
        order = [patch.name for patch in self.patches]
        members = {id(names): tuple(sorted(names, key=order.index)) for names in group.values()}
        return tuple(sorted(members.values(), key=lambda names: order.index(names[0])))

    def patches_by_process(self) -> dict[str, tuple[str, ...]]:
        """Assign patches to cell processes, by name of the process; a bridged group stays together."""
        groups = self.bridged_patches()
        if not groups:
            return {}
        if isinstance(self.cell_processes, dict):
            order = {patch: i for i, patch in enumerate(itertools.chain(*groups))}
            place = len(order)
            return {
                process: tuple(sorted(patches, key=lambda patch: order.get(patch, place)))
                for process, patches in self.cell_processes.items()
            }
        count = (
            len(groups) if self.cell_processes == "per_patch" else min(int(self.cell_processes), len(groups))
        )
        return {f"cells{i}": tuple(itertools.chain(*groups[i::count])) for i in range(count)}
