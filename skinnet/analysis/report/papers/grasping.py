"""Published self-organisation, guidance and grasps: Mittendorfer, Yoshida, Moulard, Cheng 2014 [M14]."""

from skinnet.analysis.report.claims import Between, Claim, Equals

__all__ = ["CLAIMS"]

_HRP2 = (
    Claim("cells on the upper body", "74", "M14", "VI.A", ("size.cells",), Equals(74)),
    Claim("DoFs under control", "14", "M14", "VI.A", ("size.joints",), Equals(14)),
    Claim("update rate of the skin", "250 Hz", "M14", "II.A", ("size.skin_rate_hz",), Equals(250)),
    Claim("control loop", "200 Hz", "M14", "II.B", ("size.control_rate_hz",), Equals(200)),
)
_STRUCTURE = (
    Claim(
        "steps of the structural exploration",
        "one run forth, one back, on all DoFs",
        "M14",
        "III.A",
        ("size.exploration_steps",),
        Equals(28),
    ),
    Claim("its duration", "about 70 s", "M14", "VI.A", ("structure.duration_s",), Between(68.0, 72.0)),
    Claim(
        "wrong entries of the activity matrix",
        "no failure in about 10 runs",
        "M14",
        "VI.A",
        ("structure.wrong_entries",),
        Equals(0),
    ),
    Claim("body parts form a tree", "a tree", "M14", "Fig. 4", ("structure.is_tree",), Equals(True)),
)
_TOUCH = (
    Claim(
        "reading held by 1.0 N on one force cell",
        "0.14",
        "M14",
        "VI.B",
        ("guidance.reading",),
        Between(0.135, 0.145),
    ),
    Claim(
        "commanded velocity for it, all joints",
        "0.09 rad/s",
        "M14",
        "VI.B",
        ("guidance.velocity_rad_s",),
        Between(0.0855, 0.0945),
        "(0.14 − 0.05) × 1.0; rows of the map have unit norm",
    ),
    Claim(
        "measured velocity",
        "approximately 0.09 rad/s",
        "M14",
        "VI.B, Fig. 8",
        ("guidance.measured_rad_s",),
        Between(0.0855, 0.0945),
    ),
    Claim(
        "measured velocity of the fastest joint",
        "0.09 rad/s on a single DoF",
        "M14",
        "VI.B",
        ("guidance.largest_dof_rad_s",),
        None,
        "the paper neglects two DoFs that move with it",
    ),
    Claim(
        "gap at which the robot begins to move away, least and greatest",
        "reacts about 5 cm before the touch",
        "M14",
        "IV.A",
        ("proximity.onset_distance_mm.min", "proximity.onset_distance_mm.max"),
        Between(40.0, 60.0),
        "true distance of the finger at the first motion",
    ),
    Claim(
        "contacts in approaches under proximity guidance",
        "moves before the touch",
        "M14",
        "IV.A",
        ("proximity.contacts",),
        Equals(0),
    ),
)
_GRASP = (
    Claim(
        "pulled to the chest with three contacts, held, released",
        "contact, force, pulled to the chest",
        "M14",
        "VI.C",
        ("grasp.success",),
        Equals(True),
    ),
    Claim(
        "highest reading of a force cell",
        "pain is 0.45; nothing was damaged",
        "M14",
        "Table I, VI.C",
        ("grasp.peak_reading",),
        Between(None, 0.45),
    ),
    Claim(
        "the object was dropped",
        "a grasp succeeds or is cancelled",
        "M14",
        "VI.C",
        ("object.dropped",),
        Equals(False),
    ),
)

CLAIMS = {
    "hrp2_touch": _HRP2 + _STRUCTURE + _TOUCH,
    "hrp2_teach": _HRP2 + _STRUCTURE + _GRASP,
    "hrp2_grasp": _HRP2 + _GRASP,
}
"""Claims by name of the deployment."""
