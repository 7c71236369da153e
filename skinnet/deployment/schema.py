"""The schema of a deployment file: one TOML file is one complete run.

Everything is frozen data. Values marked *assumed* have no published source (docs/assumptions.md says
what each stands for); all others name theirs. Times in the file carry their unit in the name; code uses
the integer nanoseconds that the properties give.
"""

import itertools
import math
from typing import Annotated, Literal

from msgspec import Meta, field

from skinnet.deployment.faults import FaultRule
from skinnet.deployment.memory import MemorySpec
from skinnet.deployment.nursing import NursingSpec
from skinnet.deployment.payload import PayloadSpec
from skinnet.deployment.plan import PlanSpec
from skinnet.deployment.power import PowerSpec
from skinnet.deployment.script import ScriptSpec
from skinnet.deployment.session import SessionSpec
from skinnet.deployment.sheets import BoardNetworkSpec, BoardSpec, SheetSpec, SurfaceSpec
from skinnet.deployment.stand import StandSpec
from skinnet.deployment.stress import StressSpec
from skinnet.deployment.table import (
    Levels,
    Name,
    NonNegative,
    PortName,
    Positive,
    Share,
    Table,
    Vector,
    ns_of_ms,
    parse_port,
)
from skinnet.deployment.teacher import TeacherSpec, TouchSpec
from skinnet.deployment.things import NO_OBJECT, ObjectName

__all__ = [
    "BOARDS",
    "AccelerometerSpec",
    "BodySpec",
    "BridgeSpec",
    "CellSpec",
    "ControllerSpec",
    "Deployment",
    "EncodingSpec",
    "FoamSpec",
    "ForceSpec",
    "InterfaceSpec",
    "LatticeSpec",
    "MapSpec",
    "NetworkSpec",
    "PatchSpec",
    "PlacedCell",
    "ProximitySpec",
    "RunSpec",
    "SafetySpec",
    "ServoSpec",
    "StageSpec",
    "StructureSpec",
    "SwaySpec",
    "TeacherSpec",
    "TemperatureSpec",
    "TouchSpec",
]


BOARDS = "boards"
"""Name of the process that runs the boards of all tactile sheets."""


class RunSpec(Table, frozen=True, kw_only=True):
    """How long and at which pace a run goes, and who may be lost on the way."""

    max_s: Positive = 300.0
    pace: Literal["lockstep", "realtime"] = "lockstep"
    pin: bool = True
    """Bind each process to one core, where the system can: processes that take turns then find their caches
    warm. Turn it off to share a machine with other work."""
    deadline_s: Positive = 10.0
    """Wall time after which an upstream that sends no frame is given up."""
    may_be_lost: tuple[Name, ...] = ()
    """Processes whose loss does not end the run; "cells" stands for every cell host."""


class ServoSpec(Table, frozen=True, kw_only=True):
    """Stiff position servos that turn velocity commands into position targets *(assumed)*."""

    kp_nm_per_rad: Positive = 3000.0
    kv_nm_s_per_rad: NonNegative = 60.0
    speed_limit_rad_s: Positive = 1.5
    torque_limit_nm: Positive = 400.0


class FoamSpec(Table, frozen=True, kw_only=True):
    """Elastic foundation (Winkler) between the rigid surface and the face of the cells.

    Stiffness: pads of 1–2 MPa/m held well in the feasibility study; thickness and damping are assumed.
    """

    thickness_m: Positive = 0.012
    stiffness_pa_per_m: Positive = 1.5e6
    damping_pa_s_per_m: NonNegative = 1.0e4
    friction: NonNegative = 0.6


class SwaySpec(Table, frozen=True, kw_only=True):
    """Motion of the reference part by a balancing lower body: one sine per listed joint *(assumed)*."""

    joints: tuple[str, ...] = ()
    amplitude_rad: NonNegative = 0.001
    frequency_hz: Positive = 0.3


class BodySpec(Table, frozen=True, kw_only=True):
    """The MuJoCo body: any MJCF."""

    model: str
    """Path of an MJCF file relative to the deployment, or the name of a shipped model."""
    reference: str
    joints: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Controlled hinge and slide joints, in the order of commands and feedback; for a slide joint read m
    where a name says rad."""
    locked: tuple[str, ...] = ()
    """Joints that take no part: fixed where the model has them at zero."""
    home_rad: dict[str, float] = field(default_factory=dict)
    physics_ms: Positive = 1.0
    stimulus_ms: Positive = 4.0
    joints_ms: Positive = 5.0
    ambient_c: float = 23.0
    body_temperature_c: dict[str, float] = field(default_factory=dict)
    servo: ServoSpec = field(default_factory=ServoSpec)
    foam: FoamSpec = field(default_factory=FoamSpec)
    sway: SwaySpec = field(default_factory=SwaySpec)

    @property
    def physics_ns(self) -> int:
        """Physics step [ns]."""
        return ns_of_ms(self.physics_ms)

    @property
    def stimulus_ns(self) -> int:
        """Period of stimulus frames [ns]."""
        return ns_of_ms(self.stimulus_ms)

    @property
    def joints_ns(self) -> int:
        """Period of joint feedback [ns]."""
        return ns_of_ms(self.joints_ms)


class ForceSpec(Table, frozen=True, kw_only=True):
    """Force cells: reading 0.05 ≈ 0.6 N and 0.14 ≈ 1.0 N [M14]; the ends of the curve are assumed."""

    calibration_n: tuple[float, ...] = (0.0, 0.6, 1.0, 4.822)
    calibration_reading: tuple[float, ...] = (0.0, 0.05, 0.14, 1.0)
    noise: NonNegative = 0.004
    """Idle noise 0.003–0.005 (field report in FACTS.md)."""
    lsb: Positive = 0.0009765625
    levels: Levels = (0.04, 0.10, 0.30, 0.45)
    """Low, medium, high and pain force: Table I [M14]."""
    hysteresis: NonNegative = 0.028
    """Seven times the noise: a reading at rest between two levels changes level less than once in 15 s."""
    delta: Positive = 0.02


class ProximitySpec(Table, frozen=True, kw_only=True):
    """Proximity sensor: reacts from about 5 cm [M14]; reading = (d0 / (d0 + distance))² *(assumed law)*."""

    reach_m: Positive = 0.05
    reading_at_reach: Positive = 0.01
    noise: NonNegative = 0.0008
    lsb: Positive = 0.0009765625
    levels: Levels = (0.01, 0.02, 0.10, 0.80)
    """High, medium, low proximity and close contact: Table I [M14]."""
    hysteresis: NonNegative = 0.0056
    delta: Positive = 0.02


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
    """How readings become packets."""

    kind: Literal["levels", "delta", "clock"] = "levels"


class CellSpec(Table, frozen=True, kw_only=True):
    """The HEX-o-SKIN cell."""

    period_ms: Positive = 4.0
    side_m: Positive = 0.014
    force_cell_radius_m: Positive = 0.0055
    """Distance of the three force cells from the centre *(assumed)*."""
    reaction_us: Positive = 50.0
    """Time from a packet to the cell's answer while forming the network *(assumed)*."""
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
    """A hexagonal lattice of `rows` × `columns` cells on a plane, or wrapped around a cylinder.

    `origin_m` is the middle of the lattice on the rigid surface, `normal` points outwards and `up` along the
    rows' stacking direction, all in the frame of the body. With `radius_m` the lattice bends around an
    axis parallel to `up`, `radius_m` below the origin.
    """

    columns: Annotated[int, Meta(ge=1)]
    rows: Annotated[int, Meta(ge=1)]
    origin_m: Vector
    normal: Vector
    up: Vector
    radius_m: Positive | None = None


class PlacedCell(Table, frozen=True, kw_only=True):
    """One cell placed by hand, on the rigid surface, in the frame of the body.

    `x_axis` points from the centre to the edge of port 0.
    """

    position_m: Vector
    normal: Vector
    x_axis: Vector


class InterfaceSpec(Table, frozen=True, kw_only=True):
    """A free port of a boundary cell that is wired to the computer."""

    cell: Annotated[int, Meta(ge=0)]
    port: Annotated[int, Meta(ge=0, le=3)]


class PatchSpec(Table, frozen=True, kw_only=True):
    """A patch of HEX-o-SKIN cells on one body, placed by a lattice or cell by cell."""

    name: Name
    body: str
    lattice: LatticeSpec | None = None
    cells: tuple[PlacedCell, ...] = ()
    interfaces: tuple[InterfaceSpec, ...] = ()
    """Where gateways are wired; at least one, here or in a patch that bridges lead to."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells) if self.lattice is None else self.lattice.columns * self.lattice.rows


class BridgeSpec(Table, frozen=True, kw_only=True):
    """A wire from a free port of a cell to a free port of a cell of another patch: "patch/cell:port"."""

    a: PortName
    b: PortName


class NetworkSpec(Table, frozen=True, kw_only=True):
    """Cell-to-cell links: UART of 2 Mbit/s, 10 bits a byte, packets of 8 and 23 bytes [T11].

    The hop delay makes a 23-byte packet take the measured 300 µs a hop [T11]; the queue is assumed.
    """

    bits_per_s: Annotated[int, Meta(gt=0)] = 2_000_000
    bits_per_byte: Annotated[int, Meta(gt=0)] = 10
    hop_delay_us: NonNegative = 185.0
    queue_packets: Annotated[int, Meta(ge=-1)] = 16
    event_bytes: Annotated[int, Meta(gt=0)] = 8
    stream_bytes: Annotated[int, Meta(gt=0)] = 23
    control_bytes: Annotated[int, Meta(gt=0)] = 8
    jitter_us: NonNegative = 0.0
    loss: Share = 0.0
    """Chance that a link destroys a packet."""
    detect_us: NonNegative = 500.0
    """From the end of a line's signal to the moment when its receiver knows: a cut wire, or a far end without
    power, reads as a break *(assumed)*."""
    bundle: bool = False
    """One event message per gateway and period instead of one per cell."""


class StructureSpec(Table, frozen=True, kw_only=True):
    """Structural exploration, with the paper's timing [M14, VI.A]."""

    step_rad: Positive = 0.1
    speed_rad_s: Positive = 1.0
    settle_s: NonNegative = 0.5
    average_s: Positive = 1.0
    threshold_g: Positive = 0.01


class MapSpec(Table, frozen=True, kw_only=True):
    """Exploration of the sensory-motor map by velocity sines of 0.3 rad/s (frequency: FACTS.md)."""

    amplitude_rad_s: Positive = 0.3
    frequency_hz: Positive = 4.0
    periods: Annotated[int, Meta(ge=1)] = 4
    settle_s: NonNegative = 0.3
    cut: NonNegative = 0.05


class StageSpec(Table, frozen=True, kw_only=True):
    """One stage of the controller's program."""

    kind: Literal["structure", "map", "posture", "guide", "listen", "session"]
    duration_s: Positive | None = None
    force_gain: NonNegative = 0.0
    force_threshold: NonNegative = 0.05
    proximity_gain: NonNegative = 0.0
    proximity_threshold: NonNegative = 0.01
    pose: str = "home"
    speed_rad_s: Positive = 0.4
    accuracy_rad: Positive = 0.01


class ReactionSpec(Table, frozen=True, kw_only=True):
    """Tactile reactions as a whole."""

    enabled: bool = True


class SafetySpec(Table, frozen=True, kw_only=True):
    """The last clamp before the body *(assumed)*."""

    joint_speed_rad_s: Positive = 1.2
    stale_ms: Positive = 50.0
    """Older joint feedback or skin frames are stale: the robot slows down and holds."""
    ramp_ms: Positive = 100.0
    """From full speed to rest when input is stale, and back when it is fresh again."""


class ControllerSpec(Table, frozen=True, kw_only=True):
    """The brain."""

    period_ms: Positive = 5.0
    command_delay_ms: Positive | None = None
    """From the tick to the moment a command takes effect; one control period unless set."""
    program: tuple[Name, ...] = ()
    """Stages by name, at least one; none if there is a `[nursing]` table."""
    stages: dict[str, StageSpec] = field(default_factory=dict)
    poses_rad: dict[str, tuple[float, ...]] = field(default_factory=dict)
    structure: StructureSpec = field(default_factory=StructureSpec)
    map: MapSpec = field(default_factory=MapSpec)
    reactions: ReactionSpec = field(default_factory=ReactionSpec)
    session: SessionSpec = field(default_factory=SessionSpec)
    outside_velocity: bool = False
    """Let users add joint velocities to the controller's own, before the safety clamp."""
    safety: SafetySpec = field(default_factory=SafetySpec)

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return ns_of_ms(self.period_ms)

    @property
    def command_delay_ns(self) -> int:
        """From the tick to the moment a command takes effect [ns]."""
        return ns_of_ms(self.period_ms if self.command_delay_ms is None else self.command_delay_ms)


class Deployment(Table, frozen=True, kw_only=True):
    """One complete run."""

    name: Name
    robot: Name
    seed: Annotated[int, Meta(ge=0)] = 1
    hosts: int | Literal["per_patch"] | dict[Name, tuple[str, ...]] = 2
    """Cell hosts: how many, one for each patch, or the patches of each by name."""
    run: RunSpec = field(default_factory=RunSpec)
    body: BodySpec
    cells: CellSpec = field(default_factory=CellSpec)
    network: NetworkSpec = field(default_factory=NetworkSpec)
    patches: tuple[PatchSpec, ...] = ()
    """HEX-o-SKIN cells; at least one patch or one tactile sheet."""
    surfaces: tuple[SurfaceSpec, ...] = ()
    """Where tactile sheets lie."""
    sheets: tuple[SheetSpec, ...] = ()
    """Tactile sheets, each with its board; all boards run in a host of their own, `boards`."""
    boards: BoardSpec = field(default_factory=BoardSpec)
    board_network: BoardNetworkSpec = field(default_factory=BoardNetworkSpec)
    bridges: tuple[BridgeSpec, ...] = ()
    power: PowerSpec | None = None
    """Solve the power network; without this table every cell has power."""
    plan: PlanSpec = field(default_factory=PlanSpec)
    faults: tuple[FaultRule, ...] = ()
    script: ScriptSpec | None = None
    """Scripted stimuli instead of physics."""
    teacher: TeacherSpec = field(default_factory=TeacherSpec)
    payload: PayloadSpec | None = None
    """An object between the robot's arms."""
    object: ObjectName = NO_OBJECT
    """What the stand presents to be grasped; docs/assumptions.md describes each."""
    stand: StandSpec | None = None
    """A stand in front of the robot."""
    nursing: NursingSpec | None = None
    """Whole-body contact manipulation as the controller's program, in the place of stages."""
    controller: ControllerSpec
    memory: MemorySpec = field(default_factory=MemorySpec)
    stress: StressSpec = field(default_factory=StressSpec)
    """What `skinnet stress` sweeps; runs ignore it."""

    @property
    def frame_ns(self) -> int:
        """Period after which stimulus, joints and control frames fall together again [ns]; runs end on it."""
        return math.lcm(self.body.stimulus_ns, self.body.joints_ns, self.controller.period_ns)

    @property
    def max_ns(self) -> int:
        """Simulated time at which the run ends at the latest [ns]."""
        return -(-round(self.run.max_s * 1e9) // self.frame_ns) * self.frame_ns

    def hosts_of_skin(self) -> tuple[str, ...]:
        """Names of all processes that run skin: the hosts of patches, then that of the boards."""
        return (*self.host_patches(), *((BOARDS,) if self.sheets else ()))

    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Patches that bridges join into one network, by name; one without bridges is a group of its own."""
        group = {patch.name: [patch.name] for patch in self.patches}
        for bridge in self.bridges:
            one, other = (group.get(parse_port(end)[0]) for end in (bridge.a, bridge.b))
            if one is not None and other is not None and one is not other:
                one += other
                group |= dict.fromkeys(other, one)
        order = [patch.name for patch in self.patches]
        members = {id(names): tuple(sorted(names, key=order.index)) for names in group.values()}
        return tuple(sorted(members.values(), key=lambda names: order.index(names[0])))

    def host_patches(self) -> dict[str, tuple[str, ...]]:
        """Names of the patches that each cell host runs, by the name of the host; a group stays together."""
        groups = self.groups()
        if not groups:
            return {}
        if isinstance(self.hosts, dict):
            order = {patch: i for i, patch in enumerate(itertools.chain(*groups))}
            place = len(order)
            return {
                host: tuple(sorted(patches, key=lambda patch: order.get(patch, place)))
                for host, patches in self.hosts.items()
            }
        count = len(groups) if self.hosts == "per_patch" else min(int(self.hosts), len(groups))
        return {f"host{i}": tuple(itertools.chain(*groups[i::count])) for i in range(count)}
