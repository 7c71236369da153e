"""Object models for the stand: five unknown objects of Fig. 9 [M14], and two that cannot be grasped.

The paper names and shows the objects without dimensions. All sizes, masses and compliances are assumed;
docs/assumptions.md gives the reasons. Object frame: origin at half the height, x away from the robot (depth),
y to the robot's left (width), z up.
"""

import math
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Literal, NamedTuple

from skinnet.deployment.types import Vector3

__all__ = ["NO_OBJECT", "OBJECTS", "ObjectModel", "ObjectName", "PrimitiveSolid", "Shape"]

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

_BASE_PROTRUSION_M = 0.002
"""Height [m] by which the box under a round object protrudes below it."""


class Shape(Enum):
    """Shape of a solid, which defines its `half_extents_m`."""

    BOX = "box"
    """Box: half of each edge."""
    CYLINDER = "cylinder"
    """Upright cylinder: radius, radius, half of the height."""
    ELLIPSOID = "ellipsoid"
    """Ellipsoid: semi-axes."""


class PrimitiveSolid(NamedTuple):
    """Primitive solid of an object.

    Attributes:
        shape: Box, cylinder or ellipsoid.
        half_extents_m: Half extents along x, y and z, before rotation [m].
        position_m: Position of the centre, object frame [m].
        yaw_deg: Rotation about the vertical axis.
    """

    shape: Shape
    half_extents_m: Vector3
    position_m: Vector3 = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @property
    def volume_m3(self) -> float:
        """Volume [m³]."""
        factor = {Shape.BOX: 8.0, Shape.CYLINDER: 2.0 * math.pi, Shape.ELLIPSOID: 4.0 / 3.0 * math.pi}
        return factor[self.shape] * math.prod(self.half_extents_m)


class ObjectModel(NamedTuple):
    """Object model: geometry, mass, compliance and friction *(assumed)*.

    Attributes:
        size_m: Overall depth (x), width (y) and height (z) [m].
        solids: Primitive solids, which share the mass by volume.
        mass_kg: Mass.
        stiffness_pa_per_m: Stiffness of the surface, in series with the skin's foam.
        friction: Friction of the surface on the stand and on bare links; on skin, that of the foam applies.
        base: Massless support; None if the first solid is a box that serves as one.
        hollow: True if the mass is in the walls.
        shift_to_robot_m: Shift towards the robot from `stand.object_face_x_m` [m]: round objects belong
            between the forearms, narrow ones beyond the elbows.
        rgb: RGB colour, each 0 to 1.
    """

    size_m: Vector3
    solids: tuple[PrimitiveSolid, ...]
    mass_kg: float
    stiffness_pa_per_m: float
    friction: float
    rgb: tuple[float, float, float]
    base: PrimitiveSolid | None = None
    hollow: bool = False
    shift_to_robot_m: float = 0.0


def _box(size_m: Vector3) -> tuple[PrimitiveSolid, ...]:
    depth, width, height = size_m
    return (PrimitiveSolid(Shape.BOX, (0.5 * depth, 0.5 * width, 0.5 * height)),)


def _base(depth_m: float, width_m: float, height_m: float, thickness_m: float) -> PrimitiveSolid:
    """Build the base, a box of `thickness_m` at the bottom of an object of `height_m`."""
    half_m = 0.5 * thickness_m
    return PrimitiveSolid(
        Shape.BOX, (0.5 * depth_m, 0.5 * width_m, half_m), (0.0, 0.0, half_m - 0.5 * height_m)
    )


def _frustum(bottom_m: float, top_m: float, height_m: float, n_cylinders: int) -> tuple[PrimitiveSolid, ...]:
    """Build a frustum as a stack of cylinders, from the bottom to the top diameter."""
    half_m = 0.5 * (height_m - _BASE_PROTRUSION_M) / n_cylinders
    lowest_m = _BASE_PROTRUSION_M - 0.5 * height_m
    solids = []
    for i in range(n_cylinders):
        radius_m = 0.5 * (bottom_m + (top_m - bottom_m) * i / (n_cylinders - 1))
        at_m = (0.0, 0.0, lowest_m + (2 * i + 1) * half_m)
        solids.append(PrimitiveSolid(Shape.CYLINDER, (radius_m, radius_m, half_m), at_m))
    return tuple(solids)


OBJECTS: Mapping[ObjectName, ObjectModel] = MappingProxyType(
    {
        "trash_bin": ObjectModel(
            size_m=(0.330, 0.330, 0.320),
            solids=_frustum(0.270, 0.330, 0.320, n_cylinders=8),
            base=_base(0.170, 0.170, 0.320, 0.010),
            mass_kg=0.8,
            stiffness_pa_per_m=2.5e6,
            friction=0.3,
            shift_to_robot_m=0.04,
            rgb=(0.30, 0.42, 0.55),
        ),
        "sponge_rock": ObjectModel(
            size_m=(0.280, 0.340, 0.260),
            solids=(
                PrimitiveSolid(Shape.ELLIPSOID, (0.125, 0.162, 0.120), (0.000, 0.000, -0.006)),
                PrimitiveSolid(Shape.ELLIPSOID, (0.080, 0.085, 0.085), (0.030, 0.085, -0.010)),
                PrimitiveSolid(Shape.ELLIPSOID, (0.085, 0.080, 0.090), (-0.010, -0.090, 0.000)),
                PrimitiveSolid(Shape.ELLIPSOID, (0.070, 0.080, 0.085), (-0.070, 0.030, 0.010)),
                PrimitiveSolid(Shape.ELLIPSOID, (0.085, 0.080, 0.080), (0.055, -0.020, -0.020)),
                PrimitiveSolid(Shape.ELLIPSOID, (0.075, 0.060, 0.070), (-0.045, -0.085, -0.050), 25.0),
                PrimitiveSolid(Shape.ELLIPSOID, (0.080, 0.095, 0.065), (0.010, 0.020, 0.065), -30.0),
            ),
            base=_base(0.150, 0.190, 0.260, 0.050),
            mass_kg=0.25,
            stiffness_pa_per_m=0.5e6,
            friction=0.7,
            shift_to_robot_m=0.02,
            rgb=(0.55, 0.53, 0.50),
        ),
        "moving_box": ObjectModel(
            size_m=(0.300, 0.400, 0.330),
            solids=_box((0.300, 0.400, 0.330)),
            mass_kg=0.9,
            stiffness_pa_per_m=2.0e6,
            friction=0.4,
            hollow=True,
            rgb=(0.76, 0.60, 0.40),
        ),
        "lid": ObjectModel(
            size_m=(0.240, 0.330, 0.100),
            solids=_box((0.240, 0.330, 0.100)),
            mass_kg=0.15,
            stiffness_pa_per_m=4.0e6,
            friction=0.4,
            shift_to_robot_m=-0.04,
            hollow=True,
            rgb=(0.86, 0.84, 0.78),
        ),
        "delivery_box": ObjectModel(
            size_m=(0.260, 0.360, 0.280),
            solids=_box((0.260, 0.360, 0.280)),
            mass_kg=1.1,
            stiffness_pa_per_m=15.0e6,
            friction=0.4,
            rgb=(0.70, 0.52, 0.32),
        ),
        "thin_post": ObjectModel(
            size_m=(0.060, 0.060, 0.300),
            solids=_box((0.060, 0.060, 0.300)),
            mass_kg=0.6,
            stiffness_pa_per_m=1.0e8,
            friction=0.4,
            rgb=(0.62, 0.45, 0.28),
        ),
        "wide_crate": ObjectModel(
            size_m=(0.250, 0.800, 0.300),
            solids=_box((0.250, 0.800, 0.300)),
            mass_kg=3.0,
            stiffness_pa_per_m=1.0e8,
            friction=0.4,
            hollow=True,
            rgb=(0.62, 0.45, 0.28),
        ),
    }
)
"""Object models by name, without `none`."""
