"""The objects that a stand can present: five unknown ones as in Fig. 9 [M14], and what must not be grasped.

The paper names the objects and shows them; it gives no numbers. All sizes, masses and compliances here are
assumed; docs/assumptions.md says what each stands for. The frame of an object: origin in the middle of its
height, x away from the robot (depth), y to the robot's left (width), z up.
"""

import math
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Literal, NamedTuple

from skinnet.deployment.table import Vector

__all__ = ["NO_OBJECT", "THINGS", "ObjectName", "Shape", "Solid", "Thing"]

ObjectName = Literal[
    "none",
    "trash_bin",
    "sponge_rock",
    "moving_box",
    "lid",
    "delivery_box",
    "thin_post",
    "wide_crate",
]
NO_OBJECT: ObjectName = "none"

_BASE_M = 0.002
"""What does not stand on a box of its own has a box as base, which stands out by so much."""


class Shape(Enum):
    """Form of a solid, and what its `half_m` are."""

    BOX = "box"
    """Half of its edges."""
    CYLINDER = "cylinder"
    """Upright: radius, radius, half of its height."""
    ELLIPSOID = "ellipsoid"
    """Its semi-axes."""


class Solid(NamedTuple):
    """A part of an object.

    Attributes:
        shape: What it is.
        half_m: Half of its extent along x, y and z, before it is turned [m].
        at_m: Its middle, frame of the object [m].
        yaw_deg: How far it is turned about its vertical axis.
    """

    shape: Shape
    half_m: Vector
    at_m: Vector = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @property
    def volume_m3(self) -> float:
        """Its volume [m³]."""
        factor = {Shape.BOX: 8.0, Shape.CYLINDER: 2.0 * math.pi, Shape.ELLIPSOID: 4.0 / 3.0 * math.pi}
        return factor[self.shape] * math.prod(self.half_m)


class Thing(NamedTuple):
    """An object *(assumed)*.

    Attributes:
        size_m: Depth (x), width (y) and height (z) of all of it [m].
        solids: What it is made of; together they carry the mass, each its share of the volume.
        mass_kg: Mass.
        stiffness_pa_per_m: Of its face, in series with the skin's foam: pressure by which it gives way.
        friction: Of its face on the stand and on bare links; on skin it is that of the foam.
        base: What it stands on, without mass; None if its first solid is a box that does.
        hollow: The mass is in the walls.
        nearer_m: It is presented so much nearer than `stand.near_x_m`: round things belong between the
            forearms, narrow ones beyond the elbows [m].
        tint: Colour in pictures.
    """

    size_m: Vector
    solids: tuple[Solid, ...]
    mass_kg: float
    stiffness_pa_per_m: float
    friction: float
    tint: tuple[float, float, float]
    base: Solid | None = None
    hollow: bool = False
    nearer_m: float = 0.0


def _box(size_m: Vector) -> tuple[Solid, ...]:
    depth, width, height = size_m
    return (Solid(Shape.BOX, (0.5 * depth, 0.5 * width, 0.5 * height)),)


def _base(depth_m: float, width_m: float, height_m: float, thick_m: float) -> Solid:
    """A box of `thick_m` under an object of `height_m`."""
    half_m = 0.5 * thick_m
    return Solid(Shape.BOX, (0.5 * depth_m, 0.5 * width_m, half_m), (0.0, 0.0, half_m - 0.5 * height_m))


def _tapered(bottom_m: float, top_m: float, height_m: float, rings: int) -> tuple[Solid, ...]:
    """A frustum of two diameters as a pile of rings, from the one to the other."""
    half_m = 0.5 * (height_m - _BASE_M) / rings
    lowest_m = _BASE_M - 0.5 * height_m
    solids = []
    for i in range(rings):
        radius_m = 0.5 * (bottom_m + (top_m - bottom_m) * i / (rings - 1))
        at_m = (0.0, 0.0, lowest_m + (2 * i + 1) * half_m)
        solids.append(Solid(Shape.CYLINDER, (radius_m, radius_m, half_m), at_m))
    return tuple(solids)


THINGS: Mapping[ObjectName, Thing] = MappingProxyType(
    {
        "trash_bin": Thing(
            size_m=(0.330, 0.330, 0.320),
            solids=_tapered(0.270, 0.330, 0.320, rings=8),
            base=_base(0.170, 0.170, 0.320, 0.010),
            mass_kg=0.8,
            stiffness_pa_per_m=2.5e6,
            friction=0.3,
            nearer_m=0.04,
            tint=(0.30, 0.42, 0.55),
        ),
        "sponge_rock": Thing(
            size_m=(0.280, 0.340, 0.260),
            solids=(
                Solid(Shape.ELLIPSOID, (0.125, 0.162, 0.120), (0.000, 0.000, -0.006)),
                Solid(Shape.ELLIPSOID, (0.080, 0.085, 0.085), (0.030, 0.085, -0.010)),
                Solid(Shape.ELLIPSOID, (0.085, 0.080, 0.090), (-0.010, -0.090, 0.000)),
                Solid(Shape.ELLIPSOID, (0.070, 0.080, 0.085), (-0.070, 0.030, 0.010)),
                Solid(Shape.ELLIPSOID, (0.085, 0.080, 0.080), (0.055, -0.020, -0.020)),
                Solid(Shape.ELLIPSOID, (0.075, 0.060, 0.070), (-0.045, -0.085, -0.050), 25.0),
                Solid(Shape.ELLIPSOID, (0.080, 0.095, 0.065), (0.010, 0.020, 0.065), -30.0),
            ),
            base=_base(0.150, 0.190, 0.260, 0.050),
            mass_kg=0.25,
            stiffness_pa_per_m=0.5e6,
            friction=0.7,
            nearer_m=0.02,
            tint=(0.55, 0.53, 0.50),
        ),
        "moving_box": Thing(
            size_m=(0.300, 0.400, 0.330),
            solids=_box((0.300, 0.400, 0.330)),
            mass_kg=0.9,
            stiffness_pa_per_m=2.0e6,
            friction=0.4,
            hollow=True,
            tint=(0.76, 0.60, 0.40),
        ),
        "lid": Thing(
            size_m=(0.240, 0.330, 0.100),
            solids=_box((0.240, 0.330, 0.100)),
            mass_kg=0.15,
            stiffness_pa_per_m=4.0e6,
            friction=0.4,
            nearer_m=-0.04,
            hollow=True,
            tint=(0.86, 0.84, 0.78),
        ),
        "delivery_box": Thing(
            size_m=(0.260, 0.360, 0.280),
            solids=_box((0.260, 0.360, 0.280)),
            mass_kg=1.1,
            stiffness_pa_per_m=15.0e6,
            friction=0.4,
            tint=(0.70, 0.52, 0.32),
        ),
        "thin_post": Thing(
            size_m=(0.060, 0.060, 0.300),
            solids=_box((0.060, 0.060, 0.300)),
            mass_kg=0.6,
            stiffness_pa_per_m=1.0e8,
            friction=0.4,
            tint=(0.62, 0.45, 0.28),
        ),
        "wide_crate": Thing(
            size_m=(0.250, 0.800, 0.300),
            solids=_box((0.250, 0.800, 0.300)),
            mass_kg=3.0,
            stiffness_pa_per_m=1.0e8,
            friction=0.4,
            hollow=True,
            tint=(0.62, 0.45, 0.28),
        ),
    }
)
"""Every object but `none`, by name."""
