"""Contact scene: the solids that skin can contact, broad phase, collision filtering."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact import ray_casting as geometry
from skinnet.body.contact.collision_filter import felt_flex, geoms_felt_by_bodies
from skinnet.body.contact.compliant_layer import CompliantLayer
from skinnet.body.contact.contact_margins import geom_label
from skinnet.body.contact.convex_hull import (
    ConvexHulls,
    build_convex_hulls,
    hull_entry,
    hull_vertices_m,
    is_apart_from_hull,
)
from skinnet.body.contact.point_kinematics import Motion, rotate, rotate_inverse
from skinnet.body.contact.ray_casting import entry_distance_m
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt
from skinnet.errors import ModelError

__all__ = [
    "ContactScene",
    "build_contact_scene",
    "flat_mesh_error",
    "may_intersect_sphere",
    "ray_distance_m",
    "solids_near_patch",
    "world_to_solid",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_SHAPES = (
    geometry.PLANE,
    geometry.SPHERE,
    geometry.CAPSULE,
    geometry.ELLIPSOID,
    geometry.CYLINDER,
    geometry.BOX,
    geometry.MESH,
)


_RIGID_LAYER = CompliantLayer(1.0)


class ContactScene(NamedTuple):
    """Contact scene: the geoms of the model that take part in contacts (not the visual ones).

    Attributes:
        geom_id: (k,) ids of the geoms.
        geom_type: (k,) their shapes, as `mjtGeom`.
        size_m: (k, 3) their sizes [m].
        body_id: (k,) ids of their bodies.
        bounding_radius_m: (k,) radius of each bounding sphere, 0 for planes [m].
        bounding_box_m: (k, 6) centre and half sizes of each bounding box, frame of the geom [m].
        hull: (k,) row of each mesh in `hulls`, -1 for primitives.
        hulls: Convex hulls of the meshes, frames of their geoms.
        foam_fraction: (k,) as in `CompliantLayer`; 1 for rigid solids.
        max_indentation_m: (k,) as in `CompliantLayer`; 0 for rigid solids [m].
        largest_indentation_m: Largest `max_indentation_m` [m].
        collides: (p, k) collision filter: True if the patch may touch the solid (`geoms_felt_by_bodies`);
            else it is never probed.
    """

    geom_id: Indices
    geom_type: Indices
    size_m: Floats
    body_id: Indices
    bounding_radius_m: Floats
    bounding_box_m: Floats
    hull: Indices
    hulls: ConvexHulls
    foam_fraction: Floats
    max_indentation_m: Floats
    largest_indentation_m: float
    collides: NDArray[np.bool_]


def build_contact_scene(
    mj: mujoco.MjModel,
    surface: SkinSurface,
    compliant_layers: Mapping[int, CompliantLayer] | None = None,
    always_felt: Sequence[int] = (),
) -> ContactScene:
    """Build the contact scene of `mj`.

    Args:
        mj: The model.
        surface: The skin.
        compliant_layers: Compliance of elastic bodies, by body id; all others are rigid.
        always_felt: Bodies that all skin feels, whatever its masks: the teacher's finger.

    Raises:
        ModelError: skin may touch a height field, a signed distance field, a mesh without a hull, or a flex.
    """
    collidable = (mj.geom_contype != 0) | (mj.geom_conaffinity != 0)
    felt = geoms_felt_by_bodies(mj, surface.patch_body_id)
    felt |= np.isin(mj.geom_bodyid, always_felt) & collidable
    _refuse_felt_flexes(mj, surface)
    supported = np.isin(mj.geom_type, _SHAPES)
    for index in np.flatnonzero(felt.any(axis=0) & ~supported):
        kind = mujoco.mjtGeom(mj.geom_type[index]).name.removeprefix("mjGEOM_").lower()
        raise ModelError(
            f"{geom_label(mj, int(index))} is of type {kind}, which skin contact does not support; name it "
            "in body.leave_out, make it visual (contype and conaffinity 0) or use primitives or a mesh"
        )
    geom = np.flatnonzero((collidable | felt.any(axis=0)) & supported).astype(np.int64)
    meshes = geom[mj.geom_type[geom] == geometry.MESH]
    hull = np.full(len(geom), -1, dtype=np.int64)
    hull[np.isin(geom, meshes)] = np.arange(len(meshes))
    owner = mj.geom_bodyid[geom].astype(np.int64)
    gives = [(compliant_layers or {}).get(int(body), _RIGID_LAYER) for body in owner]
    return ContactScene(
        geom_id=geom,
        geom_type=mj.geom_type[geom].astype(np.int64),
        size_m=mj.geom_size[geom].copy(),
        body_id=owner,
        bounding_radius_m=mj.geom_rbound[geom].copy(),
        bounding_box_m=mj.geom_aabb[geom].copy(),
        hull=hull,
        hulls=_hulls(mj, meshes),
        foam_fraction=np.array([each.foam_fraction for each in gives], dtype=np.float64),
        max_indentation_m=np.array([each.max_indentation_m for each in gives], dtype=np.float64),
        largest_indentation_m=max((each.max_indentation_m for each in gives), default=0.0),
        collides=np.ascontiguousarray(felt[:, geom]),  # else of another type where it is one row
    )


def _hulls(mj: mujoco.MjModel, meshes: Indices) -> ConvexHulls:
    """Convex hulls of the mesh geoms `meshes`."""
    try:
        return build_convex_hulls([hull_vertices_m(mj, int(mj.geom_dataid[index])) for index in meshes])
    except ValueError as error:
        raise flat_mesh_error(mj, int(meshes[error.args[0]])) from error


def flat_mesh_error(mj: mujoco.MjModel, geom: int) -> ModelError:
    """Error for a geom whose mesh is flat."""
    return ModelError(
        f"{geom_label(mj, geom)}: its mesh is flat and has no convex hull, which is what MuJoCo "
        "collides and skin feels; give it a thickness, use a box, or make it visual (contype and "
        "conaffinity 0)"
    )


def _refuse_felt_flexes(mj: mujoco.MjModel, surface: SkinSurface) -> None:
    """Refuse flexes (cloth, rope, elastic solids) that skin may touch: the foundation does not feel them."""
    for index in range(mj.nflex):
        if felt_flex(mj, surface.patch_body_id, index):
            name = mujoco.mj_id2name(mj, mujoco.mjtObj.mjOBJ_FLEX, index) or f"number {index}"
            raise ModelError(
                f'flex "{name}" can touch skin, and skin does not feel flexes (cloth, rope, elastic solids); '
                "use bodies with geoms instead, or give it contype and conaffinity that no skinned body meets"
            )


@compiled_without_nrt
def may_intersect_sphere(
    scene: ContactScene, motion: Motion, k: int, x: float, y: float, z: float, radius_m: float
) -> bool:
    """Broad-phase test: True if solid `k` may intersect the sphere of `radius_m` around (x, y, z) [m]."""
    g = scene.geom_id[k]
    dx, dy, dz = x - motion.geom_xpos[g, 0], y - motion.geom_xpos[g, 1], z - motion.geom_xpos[g, 2]
    if scene.geom_type[k] == geometry.PLANE:
        axes = motion.geom_xmat
        return bool(dx * axes[g, 2] + dy * axes[g, 5] + dz * axes[g, 8] <= radius_m)
    reach = radius_m + scene.bounding_radius_m[k]
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return False
    kind, a, b, c = scene.geom_type[k], scene.size_m[k, 0], scene.size_m[k, 1], scene.size_m[k, 2]
    if kind == geometry.BOX:
        dx, dy, dz = rotate_inverse(motion.geom_xmat, g, dx, dy, dz)
        return bool(max(abs(dx) - a, abs(dy) - b, abs(dz) - c) <= radius_m)
    if kind in (geometry.CYLINDER, geometry.CAPSULE):
        dx, dy, dz = rotate_inverse(motion.geom_xmat, g, dx, dy, dz)
        end = b if kind == geometry.CYLINDER else a + b
        reach = radius_m + a
        return bool(abs(dz) <= radius_m + end and dx * dx + dy * dy <= reach * reach)
    if kind == geometry.MESH:
        x, y, z = rotate_inverse(motion.geom_xmat, g, dx, dy, dz)
        box_m = scene.bounding_box_m
        dx, dy, dz = x - box_m[k, 0], y - box_m[k, 1], z - box_m[k, 2]
        if max(abs(dx) - box_m[k, 3], abs(dy) - box_m[k, 4], abs(dz) - box_m[k, 5]) > radius_m:
            return False
        return not is_apart_from_hull(scene.hulls, scene.hull[k], x, y, z, radius_m)
    return True


@compiled_without_nrt
def solids_near_patch(
    surface: SkinSurface,
    scene: ContactScene,
    motion: Motion,
    p: int,
    margin_m: float,
    near: NDArray[np.int64],
) -> int:
    """Collect solids within `margin_m` [m] of the cells of patch `p` in `near`; return their number."""
    b = surface.patch_body_id[p]
    centre_m = surface.patch_centre_m
    x, y, z = rotate(motion.xmat, b, centre_m[p, 0], centre_m[p, 1], centre_m[p, 2])
    x, y, z = motion.xpos[b, 0] + x, motion.xpos[b, 1] + y, motion.xpos[b, 2] + z
    radius_m = surface.patch_radius_m[p] + margin_m
    count = 0
    for k in range(len(scene.geom_id)):
        if scene.collides[p, k] and may_intersect_sphere(scene, motion, k, x, y, z, radius_m):
            near[count] = k
            count += 1
    return count


@compiled_without_nrt
def ray_distance_m(
    scene: ContactScene, motion: Motion, k: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> float:
    """Ray distance [m] from (x, y, z) along unit (u, v, w), world, to solid `k` (`entry_distance_m`)."""
    x, y, z = world_to_solid(scene, motion, k, x, y, z)
    u, v, w = rotate_inverse(motion.geom_xmat, scene.geom_id[k], u, v, w)
    size_m = scene.size_m
    if scene.geom_type[k] == geometry.MESH:
        distance_m, _ = hull_entry(scene.hulls, scene.hull[k], x, y, z, u, v, w, -1)
        return distance_m
    return entry_distance_m(
        scene.geom_type[k],
        size_m[k, 0],
        size_m[k, 1],
        size_m[k, 2],
        x,
        y,
        z,
        u,
        v,
        w,
    )


@compiled_without_nrt
def world_to_solid(
    scene: ContactScene, motion: Motion, k: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Transform the point (x, y, z) [m] from the world frame to the frame of solid `k`."""
    g, origin = scene.geom_id[k], motion.geom_xpos
    return rotate_inverse(motion.geom_xmat, g, x - origin[g, 0], y - origin[g, 1], z - origin[g, 2])
