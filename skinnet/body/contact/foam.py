"""Foam of the skin: its material, and its friction.

Friction is shear of the foam: a spring and damper with half of k and c (the ratio of shear to normal
stiffness of a foam with Poisson's ratio 0, assumed) that slides at μ p.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.compilation import compiled_inline, compiled_without_nrt
from skinnet.deployment.robot import FoamSpec

__all__ = ["SHEAR_STIFFNESS_RATIO", "Foam", "friction_force", "limited_friction"]

Floats = NDArray[np.float64]
_PA_PER_KPA = 1e3

SHEAR_STIFFNESS_RATIO = 0.5
"""Ratio of the foam's shear stiffness and damping to the normal ones; assumed."""


class Foam(NamedTuple):
    """Material of the foam layer, the same for all cells.

    Attributes:
        thickness_m: Distance from the rigid surface to the outer face [m].
        stiffness_pa_per_m: Foundation stiffness k [Pa/m]; with a curve, its secant to 40 % strain.
        damping_pa_s_per_m: Damping c [Pa s/m].
        friction: Friction coefficient μ.
        curve: (r, 3) compression [m], pressure of loading and of unloading [Pa]; no rows for linear foam.
        reversal_m: Way back [m] within which the pressure changes from one to the other; 0 if they are one.
    """

    thickness_m: float
    stiffness_pa_per_m: float
    damping_pa_s_per_m: float
    friction: float
    curve: Floats
    reversal_m: float

    @classmethod
    def of(cls, spec: FoamSpec) -> Self:
        """Material of `spec`."""
        curve, reversal_m = np.zeros((0, 3)), 0.0
        if spec.curve is not None:
            columns = spec.curve.loading_kpa, spec.curve.unloading_kpa or spec.curve.loading_kpa
            strain = np.array(spec.curve.strain)
            curve = np.column_stack(
                [spec.thickness_m * strain, *(_PA_PER_KPA * np.array(c) for c in columns)]
            )
            if spec.curve.unloading_kpa:
                reversal_m = spec.curve.reversal_strain * spec.thickness_m
        return cls(
            thickness_m=spec.thickness_m,
            stiffness_pa_per_m=spec.secant_stiffness_pa_per_m,
            damping_pa_s_per_m=spec.damping_pa_s_per_m,
            friction=spec.friction,
            curve=curve,
            reversal_m=reversal_m,
        )


@compiled_inline
def friction_force(
    foam: Foam,
    area: float,
    normal_n: float,
    slip_x: float,
    slip_y: float,
    shear_x: float,
    shear_y: float,
) -> tuple[float, float, float, float, float]:
    """Friction force (2) [N], shear displacement (2) [m] and sliding distance [m], plane of the cell.

    Elastic-plastic Coulomb friction: the shear displacement (shear_x, shear_y) [m] grows with the slip
    velocity (slip_x, slip_y) [m/s] until the force reaches μ N; beyond, the solid slides at constant
    displacement. So a body at rest on a slope stays at rest.
    """
    stiffness = SHEAR_STIFFNESS_RATIO * foam.stiffness_pa_per_m * area
    damping = SHEAR_STIFFNESS_RATIO * foam.damping_pa_s_per_m * area
    fx, fy = -stiffness * shear_x - damping * slip_x, -stiffness * shear_y - damping * slip_y
    limit_n = foam.friction * normal_n
    if abs(fx) + abs(fy) > limit_n:  # cheap, and mostly decides
        return limited_friction(limit_n, stiffness, fx, fy, shear_x, shear_y)
    return fx, fy, shear_x, shear_y, 0.0


@compiled_without_nrt
def limited_friction(
    limit_n: float, stiffness_n_per_m: float, fx: float, fy: float, shear_x: float, shear_y: float
) -> tuple[float, float, float, float, float]:
    """As `friction_force`, from the force (fx, fy) [N] that there would be without limit."""
    slid_m, force_n = 0.0, pinned_math.hypot(fx, fy)
    if force_n > limit_n:
        fx, fy = fx * limit_n / force_n, fy * limit_n / force_n
        held = limit_n / stiffness_n_per_m
        stretch = pinned_math.hypot(shear_x, shear_y)
        if stretch > held:
            slid_m = stretch - held
            shear_x, shear_y = shear_x * held / stretch, shear_y * held / stretch
    return fx, fy, shear_x, shear_y, slid_m
