"""Compliant objects on skin: springs in series with the foam, and delayed rigid contact with links."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import builtin_defaults, unused_name
from skinnet.deployment.robot import FoamSpec
from skinnet.pinned_linalg import matmul
from skinnet.skin.placement import PlacedPatch

__all__ = ["CompliantLayer", "compliant_layer", "delay_rigid_contact", "foam_fraction", "geoms_under_skin"]

Floats = NDArray[np.float64]
_MAX_INDENTATION_M = 0.03
"""Maximum indentation [m] beyond the foam: forearms are 45 mm thick (assumed)."""
_FREE_IMPEDANCE, _RIGID_IMPEDANCE = 0.0001, 0.95
"""Impedance (`solimp`) of a contact without force, and of a rigid one."""
_ONSET_MIDPOINT, _ONSET_POWER = 0.9, 20.0
"""Midpoint and power (`solimp`) of the onset of rigid contact over depth.

A negative margin would be simpler, but MuJoCo's collision of general convex shapes ignores it.
"""
_RAY_START_HEIGHT_M = 0.01
"""Start of rays [m] above the link's surface, to find the geom under a cell."""


class CompliantLayer(NamedTuple):
    """Compliance of a body in contact with skin.

    Attributes:
        foam_fraction: Fraction of the overlap that compresses the skin's foam; the rest indents the body.
        max_indentation_m: Maximum indentation of the body, beyond the thickness of the foam [m].
    """

    foam_fraction: float
    max_indentation_m: float = 0.0


def foam_fraction(stiffness_pa_per_m: float, foam: FoamSpec) -> float:
    """Fraction of the overlap that the foam takes against an elastic face: two springs in series.

    Foam with a curve takes this fraction at its secant stiffness; `foam_curve` has it at any compression.
    """
    return 1.0 / (1.0 + foam.secant_stiffness_pa_per_m / stiffness_pa_per_m)


def compliant_layer(stiffness_pa_per_m: float, foam: FoamSpec) -> CompliantLayer:
    """Compliance of an elastic body, indented until the foam is fully compressed, at most 30 mm."""
    share = foam_fraction(stiffness_pa_per_m, foam)
    flat_m = foam.thickness_m * (1.0 / share - 1.0)
    if foam.curve is not None:
        flat_m = foam.curve.loading_pa(1.0) / stiffness_pa_per_m
    return CompliantLayer(share, min(flat_m, _MAX_INDENTATION_M))


def delay_rigid_contact(
    spec: mujoco.MjSpec,
    mj: mujoco.MjModel,
    patches: Sequence[PlacedPatch],
    geom_names: Sequence[str],
    max_indentation_m: float,
) -> None:
    """Delay rigid contact of links under skin with elastic solids until these are almost fully indented.

    Contact with bare links is unchanged.

    Args:
        spec: The model, compiled once; must be compiled again.
        mj: The compiled model of `spec`.
        patches: The skin.
        geom_names: Names of the solids' geoms.
        max_indentation_m: Maximum indentation [m], as in `CompliantLayer`.
    """
    links = {geom.id: geom for geom in spec.geoms}
    for index in geoms_under_skin(mj, patches):
        link = links[index]
        link.name = link.name or unused_name(f"under_skin_{index}", {geom.name for geom in spec.geoms})
        for name in geom_names:
            slide, spin, roll = spec.geom(name).friction
            spec.add_pair(
                builtin_defaults(spec),
                geomname1=link.name,
                geomname2=name,
                condim=3,
                friction=[slide, slide, spin, roll, roll],
                solref=spec.geom(name).solref,
                solimp=[
                    _FREE_IMPEDANCE,
                    _RIGID_IMPEDANCE,
                    max(max_indentation_m, _FREE_IMPEDANCE),
                    _ONSET_MIDPOINT,
                    _ONSET_POWER,
                ],
            )


def geoms_under_skin(mj: mujoco.MjModel, patches: Sequence[PlacedPatch]) -> list[int]:
    """Find geoms under skin: ids, ascending, of the first geom along each cell's inward normal."""
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    found: set[int] = set()
    for patch in patches:
        body = mj.body(patch.body).id
        first = int(mj.body_geomadr[body])
        geoms = [g for g in range(first, first + int(mj.body_geomnum[body])) if mj.geom_contype[g]]
        R_world_body, origin_m = data.xmat[body].reshape(3, 3), data.xpos[body]
        for position_m, R_body_cell in zip(patch.position_m, patch.R_body_cell, strict=True):
            normal = matmul(R_world_body, R_body_cell[:, 2])
            start_m = origin_m + matmul(R_world_body, position_m) + _RAY_START_HEIGHT_M * normal
            met_m = {g: _ray_m(mj, data, g, start_m, -normal) for g in geoms}
            found |= {g for g, m in met_m.items() if 0.0 <= m == min(d for d in met_m.values() if d >= 0.0)}
    return sorted(found)


def _ray_m(mj: mujoco.MjModel, data: mujoco.MjData, geom: int, start_m: Floats, direction: Floats) -> float:
    """Ray distance [m] from `start_m` to a geom; negative if the ray misses it."""
    if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        return float(mujoco.mj_rayMesh(mj, data, geom, start_m, direction, None))
    xpos, xmat = data.geom_xpos[geom], data.geom_xmat[geom]
    return float(
        mujoco.mju_rayGeom(xpos, xmat, mj.geom_size[geom], start_m, direction, mj.geom_type[geom], None)
    )
