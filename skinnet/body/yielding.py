"""What is elastic itself: how it shares its depth with the skin's foam, and where the link below is met."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.schema import FoamSpec
from skinnet.skin.placement import PlacedPatch

__all__ = ["Yielding", "delay_rigid_contact", "share_of", "under_skin", "yielding_of"]

Floats = NDArray[np.float64]
_DEEPEST_M = 0.03
"""Nothing is followed deeper than this into a link: forearms are 45 mm thick (assumed)."""
_NOTHING, _RIGID = 0.0001, 0.95
"""MuJoCo's impedance of a contact that exerts no force, and of a rigid one."""
_SETS_IN, _STEEP = 0.9, 20.0
"""Rigid contact sets in at this share of the depth, and rises with this power of it. A negative margin would
be simpler, but MuJoCo's collision of general convex shapes does not heed it."""
_ABOVE_M = 0.01
"""A cell looks for its link from so far above the link's surface."""


class Yielding(NamedTuple):
    """How a body gives way to the skin.

    Attributes:
        share: Part of its depth in the skin by which the skin's foam is pressed; the rest is its own.
        give_m: How much deeper than the foam is thick it may lie [m].
    """

    share: float
    give_m: float = 0.0


def share_of(own_pa_per_m: float, foam: FoamSpec) -> float:
    """Part of the overlap of foam and an elastic face that the foam takes: two springs in a row."""
    return 1.0 / (1.0 + foam.stiffness_pa_per_m / own_pa_per_m)


def yielding_of(own_pa_per_m: float, foam: FoamSpec) -> Yielding:
    """How an elastic body gives way: until the foam is pressed flat, and never by more than 30 mm."""
    share = share_of(own_pa_per_m, foam)
    return Yielding(share, min(foam.thickness_m * (1.0 / share - 1.0), _DEEPEST_M))


def delay_rigid_contact(
    spec: mujoco.MjSpec,
    mj: mujoco.MjModel,
    patches: Sequence[PlacedPatch],
    solids: Sequence[str],
    give_m: float,
) -> None:
    """Links under skin meet elastic solids in rigid contact only where these hardly give way any further.

    Bare links meet them where they are.

    Args:
        spec: The model, compiled once; to be compiled again.
        mj: That model.
        patches: The skin.
        solids: Names of the solids.
        give_m: As in `Yielding`.
    """
    links = {geom.id: geom for geom in spec.geoms}
    for index in under_skin(mj, patches):
        link = links[index]
        link.name = link.name or f"under_skin_{index}"
        for name in solids:
            slide, spin, roll = spec.geom(name).friction
            spec.add_pair(
                geomname1=link.name,
                geomname2=name,
                condim=3,
                friction=[slide, slide, spin, roll, roll],
                solref=spec.geom(name).solref,
                solimp=[_NOTHING, _RIGID, max(give_m, _NOTHING), _SETS_IN, _STEEP],
            )


def under_skin(mj: mujoco.MjModel, patches: Sequence[PlacedPatch]) -> list[int]:
    """Ids of the geoms, ascending, on which cells lie: what a cell's normal meets first from outside."""
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    found: set[int] = set()
    for patch in patches:
        body = mj.body(patch.body).id
        first = int(mj.body_geomadr[body])
        geoms = [g for g in range(first, first + int(mj.body_geomnum[body])) if mj.geom_contype[g]]
        R_world_body, origin_m = data.xmat[body].reshape(3, 3), data.xpos[body]
        for position_m, R_body_cell in zip(patch.position_m, patch.R_body_cell, strict=True):
            normal = R_world_body @ R_body_cell[:, 2]
            start_m = origin_m + R_world_body @ position_m + _ABOVE_M * normal
            met_m = {g: _ray_m(mj, data, g, start_m, -normal) for g in geoms}
            found |= {g for g, m in met_m.items() if 0.0 <= m == min(d for d in met_m.values() if d >= 0.0)}
    return sorted(found)


def _ray_m(mj: mujoco.MjModel, data: mujoco.MjData, geom: int, start_m: Floats, direction: Floats) -> float:
    """Distance [m] from `start_m` to a geom; negative if the ray misses it."""
    if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        return float(mujoco.mj_rayMesh(mj, data, geom, start_m, direction, None))
    xpos, xmat = data.geom_xpos[geom], data.geom_xmat[geom]
    return float(
        mujoco.mju_rayGeom(xpos, xmat, mj.geom_size[geom], start_m, direction, mj.geom_type[geom], None)
    )
