"""Robot specs: model, controlled joints, servos, foam under the skin and postural sway.

Values marked *assumed* have no published source; all others cite theirs.
"""

from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.types import NonNegative, Positive, Table, ns_of_ms

__all__ = ["BodySpec", "FoamSpec", "ServoSpec", "SwaySpec"]


class ServoSpec(Table, frozen=True, kw_only=True):
    """Stiff position servos, which turn velocity commands into position targets *(assumed)*."""

    kp_nm_per_rad: Positive = 3000.0
    """Position gain (stiffness)."""
    kv_nm_s_per_rad: NonNegative = 60.0
    """Velocity gain (damping)."""
    speed_limit_rad_s: Positive = 1.5
    """Speed beyond which a command is refused."""
    torque_limit_nm: Positive = 400.0
    """Torque limit."""


class FoamSpec(Table, frozen=True, kw_only=True):
    """Elastic (Winkler) foundation between the rigid surface and the face of the cells.

    Stiffness: pads of 1–2 MPa/m held objects in the feasibility study; thickness and damping are assumed.
    """

    thickness_m: Positive = 0.012
    """Thickness of the uncompressed foam."""
    stiffness_pa_per_m: Positive = 1.5e6
    """Foundation modulus: pressure per indentation."""
    damping_pa_s_per_m: NonNegative = 1.0e4
    """Damping pressure per speed of indentation."""
    friction: NonNegative = 0.6
    """Coulomb friction coefficient of the skin."""


class SwaySpec(Table, frozen=True, kw_only=True):
    """Postural sway of the reference body: one sine per listed joint *(assumed)*."""

    joints: tuple[str, ...] = ()
    """Joints of the model that sway; none unless given."""
    amplitude_rad: NonNegative = 0.001
    """Amplitude of the sine."""
    frequency_hz: Positive = 0.3
    """Frequency of the sine."""


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
    """Servos of the controlled joints."""
    foam: FoamSpec = field(default_factory=FoamSpec)
    """Foam under the skin."""
    sway: SwaySpec = field(default_factory=SwaySpec)
    """Postural sway of the reference body."""

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
