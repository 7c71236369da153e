"""Servo specs: gains of the controlled joints, given directly or by frequency and damping ratio."""

from typing import Self

from msgspec import structs

from skinnet.deployment.types import NonNegative, Positive, Table

__all__ = ["JointServoSpec", "ServoSpec"]

_KP_NM_PER_RAD = 3000.0
_KV_NM_S_PER_RAD = 60.0
_DAMPING = 0.8
_BY_GAINS = ("kp_nm_per_rad", "kv_nm_s_per_rad")
_BY_FREQUENCY = ("frequency_hz", "damping")


class ServoSpec(Table, frozen=True, kw_only=True):
    """Stiff position servos, which turn velocity commands into position targets *(assumed)*.

    Their gains are given directly, or follow from `frequency_hz` and `damping` of the closed loop: with the
    inertia M of the joint at home, armature included and the other controlled joints held, kp = (2πf)² M
    and kv = 2 ζ 2πf M less the joint's own damping. A slide joint has m where a key says rad, N where it
    says N·m.
    """

    kp_nm_per_rad: Positive | None = None
    """Position gain (stiffness); 3000 unless given, or from `frequency_hz`."""
    kv_nm_s_per_rad: NonNegative | None = None
    """Velocity gain (damping); 60 unless given, or from `frequency_hz`."""
    speed_limit_rad_s: Positive = 1.5
    """Speed beyond which a command is refused."""
    torque_limit_nm: Positive = 400.0
    """Torque limit."""
    frequency_hz: Positive | None = None
    """Undamped natural frequency of each joint at home, in place of the gains."""
    damping: Positive | None = None
    """Damping ratio of each joint at home; 0.8 unless given, with `frequency_hz`."""
    gravity_compensation: bool | None = None
    """Feed the load of gravity and of the joints' springs forward; true with `frequency_hz` unless given."""

    def __post_init__(self) -> None:
        by_frequency = self.frequency_hz is not None
        _refuse_both(self)
        if not by_frequency and self.damping is not None:
            raise ValueError(f"damping = {self.damping:g}: goes with frequency_hz only; give that, too")
        defaults: dict[str, float | bool] = {"gravity_compensation": by_frequency}
        if by_frequency:
            defaults["damping"] = _DAMPING
        else:
            defaults |= {"kp_nm_per_rad": _KP_NM_PER_RAD, "kv_nm_s_per_rad": _KV_NM_S_PER_RAD}
        for name, value in defaults.items():
            if getattr(self, name) is None:
                structs.force_setattr(self, name, value)

    def of_joint(self, own: "JointServoSpec") -> Self:
        """Servo of a joint that has some values of its `own`.

        Raises:
            ValueError: values are missing that its own ones ask for.
        """
        values = structs.asdict(own)
        given = {name: value for name, value in values.items() if value is not None}
        base = structs.asdict(self)
        if any(name in given for name in _BY_GAINS):
            missing = [name for name in _BY_GAINS if given.get(name, base[name]) is None]
            if missing:
                raise ValueError(f"{missing[0]} is missing: body.servo goes by frequency_hz; give both gains")
            base |= dict.fromkeys(_BY_FREQUENCY)
        elif any(name in given for name in _BY_FREQUENCY):
            base |= dict.fromkeys(_BY_GAINS)
        return type(self)(**(base | given))


class JointServoSpec(Table, frozen=True, kw_only=True):
    """Servo of one joint, where it differs from `[body.servo]`."""

    kp_nm_per_rad: Positive | None = None
    """Position gain (stiffness)."""
    kv_nm_s_per_rad: NonNegative | None = None
    """Velocity gain (damping)."""
    speed_limit_rad_s: Positive | None = None
    """Speed beyond which a command is refused."""
    torque_limit_nm: Positive | None = None
    """Torque limit."""
    frequency_hz: Positive | None = None
    """Undamped natural frequency at home, in place of the gains."""
    damping: Positive | None = None
    """Damping ratio at home."""

    def __post_init__(self) -> None:
        _refuse_both(self)


def _refuse_both(servo: ServoSpec | JointServoSpec) -> None:
    """Refuse gains beside a frequency.

    Raises:
        ValueError: both are given.
    """
    for gain in _BY_GAINS:
        if servo.frequency_hz is not None and getattr(servo, gain) is not None:
            raise ValueError(
                f"frequency_hz = {servo.frequency_hz:g} and {gain} = {getattr(servo, gain):g}: give the "
                "frequency (with damping) or the gains, not both"
            )
