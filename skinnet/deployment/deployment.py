"""Schema of a deployment file: one TOML file describes one run.

All specs are frozen. Values marked *assumed* have no published source (docs/assumptions.md gives the reason
for each); all others cite theirs. Keys carry their unit; code uses the integer nanoseconds of the properties.
"""

import itertools
import math
from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.controller.nursing import NursingSpec
from skinnet.deployment.controller.teach_and_grasp import TeachAndGraspSpec
from skinnet.deployment.environment.objects import NO_OBJECT, ObjectName
from skinnet.deployment.environment.payload import PayloadSpec
from skinnet.deployment.environment.scripted_stimuli import ScriptedStimuliSpec
from skinnet.deployment.environment.stand import StandSpec
from skinnet.deployment.environment.teacher import TeacherSpec, TouchSpec
from skinnet.deployment.experiment.faults import FaultRule
from skinnet.deployment.experiment.memory import MemorySpec
from skinnet.deployment.experiment.plan import LinkBudgetSpec
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.deployment.power import PowerSpec
from skinnet.deployment.skin.sheets import BoardNetworkSpec, BoardSpec, SheetSpec, SurfaceSpec
from skinnet.deployment.types import (
    Fraction,
    LevelThresholds,
    Name,
    NonNegative,
    PortName,
    Positive,
    Table,
    Vector3,
    ns_of_ms,
    parse_port,
)

__all__ = [
    "BOARD_PROCESS",
    "AccelerometerSpec",
    "BodySpec",
    "BridgeSpec",
    "CellPoseSpec",
    "CellSpec",
    "ControllerSpec",
    "Deployment",
    "EncodingSpec",
    "FoamSpec",
    "ForceSpec",
    "InterfaceSpec",
    "LatticeSpec",
    "MapExplorationSpec",
    "NetworkSpec",
    "PatchSpec",
    "ProximitySpec",
    "RunSpec",
    "SafetySpec",
    "ServoSpec",
    "StageSpec",
    "StructureExplorationSpec",
    "SwaySpec",
    "TeacherSpec",
    "TemperatureSpec",
    "TouchSpec",
]


BOARD_PROCESS = "boards"
"""Name of the process that runs the boards of all tactile sheets."""


class RunSpec(Table, frozen=True, kw_only=True):
    """Duration, pace and fault tolerance of a run."""

    max_s: Positive = 300.0
    """Simulated time after which the run ends at the latest."""
    pace: Literal["lockstep", "realtime"] = "lockstep"
    """Pace of simulated time: as fast as it is computed, or following the wall clock."""
    pin: bool = True
    """CPU affinity: bind each process to one core where the operating system supports it, which keeps its
    caches warm. Turn it off to share the computer with other work."""
    deadline_s: Positive = 10.0
    """Wall-clock timeout of an upstream process that sends no period end."""
    tolerated_losses: tuple[Name, ...] = ()
    """Processes whose loss does not end the run; "cells" stands for every cell process."""


class ServoSpec(Table, frozen=True, kw_only=True):
    """Stiff position servos, which turn velocity commands into position targets *(assumed)*."""

    kp_nm_per_rad: Positive = 3000.0
    kv_nm_s_per_rad: NonNegative = 60.0
    speed_limit_rad_s: Positive = 1.5
    torque_limit_nm: Positive = 400.0


class FoamSpec(Table, frozen=True, kw_only=True):
    """Elastic (Winkler) foundation between the rigid surface and the face of the cells.

    Stiffness: pads of 1–2 MPa/m held objects in the feasibility study; thickness and damping are assumed.
    """

    thickness_m: Positive = 0.012
    stiffness_pa_per_m: Positive = 1.5e6
    damping_pa_s_per_m: NonNegative = 1.0e4
    friction: NonNegative = 0.6


class SwaySpec(Table, frozen=True, kw_only=True):
    """Postural sway of the reference body: one sine per listed joint *(assumed)*."""

    joints: tuple[str, ...] = ()
    amplitude_rad: NonNegative = 0.001
    frequency_hz: Positive = 0.3


class BodySpec(Table, frozen=True, kw_only=True):
    """Robot model in MJCF, its controlled joints, and the periods of its simulation."""

    model: str
    """Path of an MJCF file relative to the deployment, or the name of a shipped model."""
    reference_body: str
    """Body of the model that is the root of the kinematic structure."""
    joints: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Controlled hinge and slide joints, in the order of commands and feedback; slide joints use m where a
    key says rad."""
    locked: tuple[str, ...] = ()
    """Joints fixed at the zero position of the model."""
    home_rad: dict[str, float] = field(default_factory=dict)
    """Home posture, by joint; the reference position of the model unless given."""
    timestep_ms: Positive = 1.0
    """Physics timestep."""
    stimulus_period_ms: Positive = 4.0
    """Period of the stimuli."""
    joint_state_period_ms: Positive = 5.0
    """Period of the joint feedback."""
    ambient_c: float = 23.0
    """Ambient temperature."""
    body_temperature_c: dict[str, float] = field(default_factory=dict)
    """Surface temperature, by body; ambient unless given."""
    servo: ServoSpec = field(default_factory=ServoSpec)
    foam: FoamSpec = field(default_factory=FoamSpec)
    sway: SwaySpec = field(default_factory=SwaySpec)

    @property
    def timestep_ns(self) -> int:
        """Physics timestep [ns]."""
        return ns_of_ms(self.timestep_ms)

    @property
    def stimulus_period_ns(self) -> int:
        """Period of the stimuli [ns]."""
        return ns_of_ms(self.stimulus_period_ms)

    @property
    def joint_state_period_ns(self) -> int:
        """Period of the joint feedback [ns]."""
        return ns_of_ms(self.joint_state_period_ms)


class ForceSpec(Table, frozen=True, kw_only=True):
    """Force cells: reading 0.05 ≈ 0.6 N and 0.14 ≈ 1.0 N [M14]; the ends of the curve are assumed."""

    calibration_n: tuple[float, ...] = (0.0, 0.6, 1.0, 4.822)
    calibration_reading: tuple[float, ...] = (0.0, 0.05, 0.14, 1.0)
    noise: NonNegative = 0.004
    """Standard deviation of a reading: idle noise 0.003–0.005 (field report, docs/assumptions.md)."""
    lsb: Positive = 0.0009765625
    levels: LevelThresholds = (0.04, 0.10, 0.30, 0.45)
    """Low, medium, high and pain force: Table I [M14]."""
    hysteresis: NonNegative = 0.028
    """Hysteresis of level crossing: seven times the noise, less than one false event in 15 s at rest."""
    delta: Positive = 0.02
    """Threshold of send-on-delta."""


class ProximitySpec(Table, frozen=True, kw_only=True):
    """Proximity sensor, range about 5 cm [M14]; reading = (d0 / (d0 + distance))² *(assumed law)*."""

    range_m: Positive = 0.05
    reading_at_range: Positive = 0.01
    noise: NonNegative = 0.0008
    lsb: Positive = 0.0009765625
    levels: LevelThresholds = (0.01, 0.02, 0.10, 0.80)
    """High, medium, low proximity and close contact: Table I [M14]."""
    hysteresis: NonNegative = 0.0056
    """Hysteresis of level crossing: seven times the noise."""
    delta: Positive = 0.02
    """Threshold of send-on-delta."""


class AccelerometerSpec(Table, frozen=True, kw_only=True):
    """Tri-axial accelerometer: ±8 g, 4 mg per LSB [T11]."""

    range_g: Positive = 8.0
    lsb_g: Positive = 0.004
    noise_g: NonNegative = 0.004
    delta_g: Positive = 0.1


class TemperatureSpec(Table, frozen=True, kw_only=True):
    """Temperature sensor: 0.06 °C, −5…55 °C, time constant 2.6 s [T11]."""

    lsb_c: Positive = 0.06
    min_c: float = -5.0
    max_c: float = 55.0
    time_constant_s: Positive = 2.6
    noise_c: NonNegative = 0.03
    delta_c: Positive = 0.5


class EncodingSpec(Table, frozen=True, kw_only=True):
    """Event encoding of the readings: `level_crossing`, `send_on_delta` or `periodic`."""

    kind: Literal["level_crossing", "send_on_delta", "periodic"] = "level_crossing"


class CellSpec(Table, frozen=True, kw_only=True):
    """HEX-o-SKIN cell: sampling, geometry, sensors and event encoding."""

    period_ms: Positive = 4.0
    side_m: Positive = 0.014
    force_cell_radius_m: Positive = 0.0055
    """Distance of the three force cells from the centre *(assumed)*."""
    processing_delay_us: Positive = 50.0
    """Processing delay from a packet to the cell's answer during network formation *(assumed)*."""
    encoding: EncodingSpec = field(default_factory=EncodingSpec)
    force: ForceSpec = field(default_factory=ForceSpec)
    proximity: ProximitySpec = field(default_factory=ProximitySpec)
    accelerometer: AccelerometerSpec = field(default_factory=AccelerometerSpec)
    temperature: TemperatureSpec = field(default_factory=TemperatureSpec)

    @property
    def period_ns(self) -> int:
        """Sampling period [ns]."""
        return ns_of_ms(self.period_ms)


class LatticeSpec(Table, frozen=True, kw_only=True):
    """Hexagonal lattice of `rows` × `columns` cells on a plane or around a cylinder.

    `origin_m` is the centre of the lattice on the rigid surface, `normal` points outwards and `up` from row
    to row, all in the frame of the body. With `radius_m` the lattice lies on a cylinder whose axis is
    parallel to `up`, `radius_m` below the origin.
    """

    columns: Annotated[int, Meta(ge=1)]
    rows: Annotated[int, Meta(ge=1)]
    origin_m: Vector3
    normal: Vector3
    up: Vector3
    radius_m: Positive | None = None


class CellPoseSpec(Table, frozen=True, kw_only=True):
    """Pose of a single cell on the rigid surface, in the frame of the body.

    `x_axis` points from the centre to the edge of port 0.
    """

    position_m: Vector3
    normal: Vector3
    x_axis: Vector3


class InterfaceSpec(Table, frozen=True, kw_only=True):
    """Interface: a free port of a boundary cell that is wired to the computer."""

    cell: Annotated[int, Meta(ge=0)]
    port: Annotated[int, Meta(ge=0, le=3)]


class PatchSpec(Table, frozen=True, kw_only=True):
    """Patch of HEX-o-SKIN cells on one body, placed by a lattice or cell by cell."""

    name: Name
    body: str
    lattice: LatticeSpec | None = None
    cells: tuple[CellPoseSpec, ...] = ()
    interfaces: tuple[InterfaceSpec, ...] = ()
    """Ports of the gateways; at least one, here or in a patch that bridges connect."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells) if self.lattice is None else self.lattice.columns * self.lattice.rows


class BridgeSpec(Table, frozen=True, kw_only=True):
    """Wire between free ports of cells of two patches, each "patch/cell:port"."""

    a: PortName
    b: PortName


class NetworkSpec(Table, frozen=True, kw_only=True):
    """Cell-to-cell links: UART of 2 Mbit/s, 10 bits a byte, packets of 8 and 23 bytes [T11].

    With this hop delay a 23-byte packet takes the measured 300 µs a hop [T11]; the queue is assumed.
    """

    bits_per_s: Annotated[int, Meta(gt=0)] = 2_000_000
    bits_per_byte: Annotated[int, Meta(gt=0)] = 10
    hop_delay_us: NonNegative = 185.0
    """Processing delay of a cell that forwards a packet."""
    queue_packets: Annotated[int, Meta(ge=-1)] = 16
    """Capacity of the queue of each port; −1 for no bound."""
    event_bytes: Annotated[int, Meta(gt=0)] = 8
    stream_bytes: Annotated[int, Meta(gt=0)] = 23
    control_bytes: Annotated[int, Meta(gt=0)] = 8
    jitter_us: NonNegative = 0.0
    loss: Fraction = 0.0
    """Probability that a link loses a packet."""
    failure_detection_us: NonNegative = 500.0
    """Time from the loss of a line's signal (cut wire, or far end without power) to its detection by the
    receiver *(assumed)*."""
    aggregate_events: bool = False
    """Aggregate the events of a period in one message per gateway, instead of one per cell."""


class StructureExplorationSpec(Table, frozen=True, kw_only=True):
    """Structural exploration, with the timing of [M14, VI.A]."""

    step_rad: Positive = 0.1
    speed_rad_s: Positive = 1.0
    settle_s: NonNegative = 0.5
    averaging_s: Positive = 1.0
    threshold_g: Positive = 0.01


class MapExplorationSpec(Table, frozen=True, kw_only=True):
    """Sensory-motor map exploration by velocity sines of 0.3 rad/s (frequency: docs/assumptions.md)."""

    amplitude_rad_s: Positive = 0.3
    frequency_hz: Positive = 4.0
    periods: Annotated[int, Meta(ge=1)] = 4
    settle_s: NonNegative = 0.3
    min_row_norm: NonNegative = 0.05
    """Norm of a map row below which its cell counts as immobile along its normal."""


class StageSpec(Table, frozen=True, kw_only=True):
    """Stage of the controller's program."""

    kind: Literal["structure", "map", "posture", "guide", "passive", "teach_and_grasp"]
    duration_s: Positive | None = None
    force_gain: NonNegative = 0.0
    force_threshold: NonNegative = 0.05
    proximity_gain: NonNegative = 0.0
    proximity_threshold: NonNegative = 0.01
    pose: str = "home"
    speed_rad_s: Positive = 0.4
    tolerance_rad: Positive = 0.01


class ReactionSpec(Table, frozen=True, kw_only=True):
    """Tactile reactions of the controller."""

    enabled: bool = True


class SafetySpec(Table, frozen=True, kw_only=True):
    """Safety clamp of the commanded joint velocities *(assumed)*."""

    max_joint_speed_rad_s: Positive = 1.2
    input_timeout_ms: Positive = 50.0
    """Age beyond which joint feedback or skin data is stale: the robot slows down and holds."""
    ramp_ms: Positive = 100.0
    """Ramp from full speed to rest when input becomes stale, and back when it is fresh again."""


class ControllerSpec(Table, frozen=True, kw_only=True):
    """Controller: period, program of stages, explorations, reactions and safety."""

    period_ms: Positive = 5.0
    command_delay_ms: Positive | None = None
    """Delay from the control tick to the effect of its command; one control period unless given."""
    program: tuple[Name, ...] = ()
    """Sequence of stages by name, at least one; empty with a `[nursing]` table."""
    stages: dict[str, StageSpec] = field(default_factory=dict)
    poses_rad: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Named poses, with one angle per controlled joint."""
    structure: StructureExplorationSpec = field(default_factory=StructureExplorationSpec)
    map: MapExplorationSpec = field(default_factory=MapExplorationSpec)
    reactions: ReactionSpec = field(default_factory=ReactionSpec)
    teach_and_grasp: TeachAndGraspSpec = field(default_factory=TeachAndGraspSpec)
    external_velocity: bool = False
    """Add joint velocities of external clients to those of the controller, before the safety clamp."""
    safety: SafetySpec = field(default_factory=SafetySpec)

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return ns_of_ms(self.period_ms)

    @property
    def command_delay_ns(self) -> int:
        """Delay from the control tick to the effect of its command [ns]."""
        return ns_of_ms(self.period_ms if self.command_delay_ms is None else self.command_delay_ms)


class Deployment(Table, frozen=True, kw_only=True):
    """Deployment: the complete description of one run."""

    name: Name
    robot: Name
    seed: Annotated[int, Meta(ge=0)] = 1
    """Seed of all random streams."""
    cell_processes: int | Literal["per_patch"] | dict[Name, tuple[str, ...]] = 2
    """Cell processes: their number, one per patch, or a table of patches by process."""
    run: RunSpec = field(default_factory=RunSpec)
    body: BodySpec
    cells: CellSpec = field(default_factory=CellSpec)
    network: NetworkSpec = field(default_factory=NetworkSpec)
    patches: tuple[PatchSpec, ...] = ()
    """HEX-o-SKIN cells; at least one patch or one tactile sheet."""
    surfaces: tuple[SurfaceSpec, ...] = ()
    """Surfaces that carry tactile sheets."""
    sheets: tuple[SheetSpec, ...] = ()
    """Tactile sheets, each with its board; all boards run in one process, `boards`."""
    boards: BoardSpec = field(default_factory=BoardSpec)
    board_network: BoardNetworkSpec = field(default_factory=BoardNetworkSpec)
    bridges: tuple[BridgeSpec, ...] = ()
    power: PowerSpec | None = None
    """Power network; without this table every cell has power."""
    plan: LinkBudgetSpec = field(default_factory=LinkBudgetSpec)
    faults: tuple[FaultRule, ...] = ()
    scripted_stimuli: ScriptedStimuliSpec | None = None
    """Scripted stimuli instead of physics."""
    teacher: TeacherSpec = field(default_factory=TeacherSpec)
    payload: PayloadSpec | None = None
    """Payload held between the robot's arms."""
    object: ObjectName = NO_OBJECT
    """Object presented by the stand; docs/assumptions.md describes each."""
    stand: StandSpec | None = None
    """Stand in front of the robot."""
    nursing: NursingSpec | None = None
    """Whole-body contact manipulation [R11] as the controller's program, instead of stages."""
    controller: ControllerSpec
    memory: MemorySpec = field(default_factory=MemorySpec)
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
                host: tuple(sorted(patches, key=lambda patch: order.get(patch, place)))
                for host, patches in self.cell_processes.items()
            }
        count = (
            len(groups) if self.cell_processes == "per_patch" else min(int(self.cell_processes), len(groups))
        )
        return {f"cells{i}": tuple(itertools.chain(*groups[i::count])) for i in range(count)}
