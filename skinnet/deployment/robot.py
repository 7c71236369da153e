"""Robot specs: model, controlled joints, foam under the skin and postural sway.

Values marked *assumed* have no published source; all others cite theirs.
"""

from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.servo import JointServoSpec, ServoSpec
from skinnet.deployment.types import Fraction, NonNegative, Positive, Table, ns_of_ms
from skinnet.errors import DeploymentError

__all__ = ["BodySpec", "FoamCurveSpec", "FoamSpec", "SwaySpec"]

_QUOTED_STRAIN = 0.4
"""Strain at which ISO 3386-1 quotes the stress of foam: CC40, the compression stress value."""


class FoamCurveSpec(Table, frozen=True, kw_only=True):
    """Compression curve of the foam as a table, one row per entry of its columns, as ISO 3386-1 measures it.

    Pressure is linear between rows; beyond the last one both columns continue with the last slope of
    loading, up to full compression. ISO 3386-1 takes loading from its fourth cycle, and quotes CC40, the
    pressure of loading at 40 % strain.
    """

    strain: Annotated[tuple[Fraction, ...], Meta(min_length=2, max_length=1000)]
    """Compression as a fraction of the thickness, from 0, ascending."""
    loading_kpa: tuple[NonNegative, ...]
    """Pressure while compression grows, from 0; never falls."""
    unloading_kpa: tuple[NonNegative, ...] = ()
    """Pressure while compression falls, from 0; never above loading. Empty: loading, so no hysteresis."""
    reversal_strain: Annotated[float, Meta(ge=0.001, le=1.0)] = 0.05
    """Way back, as a strain, within which the pressure goes over to the other column *(assumed)*."""

    def loading_pa(self, strain: float) -> float:
        """Pressure of loading [Pa] at `strain`, from 0 to 1."""
        last, before = len(self.strain) - 1, len(self.strain) - 2
        for row in range(1, last + 1):
            if strain <= self.strain[row]:
                last, before = row, row - 1
                break
        x0, x1, p0, p1 = (
            self.strain[before],
            self.strain[last],
            self.loading_kpa[before],
            self.loading_kpa[last],
        )
        return 1e3 * (p0 + (p1 - p0) * (strain - x0) / (x1 - x0))

    @property
    def cc40_kpa(self) -> float:
        """Compression stress value CC40 of ISO 3386-1 [kPa]: pressure of loading at 40 % strain."""
        return 1e-3 * self.loading_pa(_QUOTED_STRAIN)

    @property
    def hysteresis_loss(self) -> float:
        """Fraction of the work of loading to the last row that unloading does not give back."""
        work = _area(self.strain, self.loading_kpa)
        return 1.0 - _area(self.strain, self.unloading_kpa or self.loading_kpa) / work


def _area(x: tuple[float, ...], y: tuple[float, ...]) -> float:
    """Area under the straight lines between the points (x, y)."""
    return sum(0.5 * (y[i] + y[i - 1]) * (x[i] - x[i - 1]) for i in range(1, len(x)))


class FoamSpec(Table, frozen=True, kw_only=True):
    """Elastic (Winkler) foundation between the rigid surface and the face of the cells.

    Stiffness: pads of 1–2 MPa/m held objects in the feasibility study; thickness and damping are assumed.
    """

    thickness_m: Positive = 0.012
    """Thickness of the uncompressed foam."""
    stiffness_pa_per_m: Positive = 1.5e6
    """Foundation modulus: pressure per indentation. With a curve: unset, or CC40 / (0.4 thickness)."""
    damping_pa_s_per_m: NonNegative = 1.0e4
    """Damping pressure per speed of indentation."""
    friction: NonNegative = 0.6
    """Coulomb friction coefficient of the skin."""
    curve: FoamCurveSpec | None = None
    """Compression curve; linear unless given."""

    @property
    def secant_stiffness_pa_per_m(self) -> float:
        """Foundation modulus [Pa/m]; with a curve, its secant to 40 % strain: CC40 / (0.4 thickness)."""
        if self.curve is None:
            return self.stiffness_pa_per_m
        return self.curve.loading_pa(_QUOTED_STRAIN) / (_QUOTED_STRAIN * self.thickness_m)


class SwaySpec(Table, frozen=True, kw_only=True):
    """Postural sway of the reference body: one sine per listed joint *(assumed)*."""

    joints: tuple[str, ...] = ()
    """Joints of the model that sway; none unless given."""
    amplitude_rad: NonNegative = 0.001
    """Amplitude of the sine."""
    frequency_hz: Positive = 0.3
    """Frequency of the sine."""


class BodySpec(Table, frozen=True, kw_only=True):
    """Robot model in MJCF or URDF, its controlled joints, and the periods of its simulation."""

    model: str
    """Path of an MJCF or URDF file relative to the deployment, or the name of a shipped model."""
    package_paths: tuple[str, ...] = ()
    """Folders of the ROS packages of a URDF's meshes (`package://`), relative to the deployment; those above
    the model and in ROS_PACKAGE_PATH are looked at afterwards."""
    reference_body: str
    """Body of the model that is the root of the kinematic structure; "world" for a robot whose first body
    moves."""
    joints: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Controlled hinge and slide joints, in the order of commands and feedback; slide joints use m where a
    key says rad."""
    locked: tuple[str, ...] = ()
    """Joints fixed at the zero position of the model."""
    leave_out: tuple[str, ...] = ()
    """Geoms of the model, by name, that are not simulated: deleted with all that refers to them. Skin does
    not feel height fields and signed distance fields: such geoms have to be named here, or be visual."""
    fixed_base: bool = False
    """Fix the base where the file draws it: the free joint of the robot's root is left out. Keyframes do not
    move it."""
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
    joint_servos: dict[str, JointServoSpec] = field(default_factory=dict)
    """Servos of single joints, by joint, where they differ from `servo`."""
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

    def servo_of(self, joint: str) -> ServoSpec:
        """Servo of `joint`, with its own values in place of the common ones.

        Raises:
            DeploymentError: values are missing that its own ones ask for.
        """
        own = self.joint_servos.get(joint)
        if own is None:
            return self.servo
        try:
            return self.servo.of_joint(own)
        except ValueError as error:
            raise DeploymentError(f'body.joint_servos."{joint}": {error}') from None
