"""Contact scene: the solids that skin can contact, broad phase, collision filtering."""

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact import ray_casting as geometry
from skinnet.body.contact.compliant_layer import CompliantLayer
from skinnet.body.contact.point_kinematics import Motion, rotate, rotate_inverse
from skinnet.body.contact.ray_casting import entry_distance_m
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt
from skinnet.errors import ModelError

__all__ = [
    "ContactScene",
    "build_contact_scene",
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
        first_triangle: (k,) first triangle of each mesh.
        end_triangle: (k,) one past its last.
        triangles_m: (t, 3, 3) corners of the triangles of all meshes, frames of the geoms [m].
        foam_fraction: (k,) as in `CompliantLayer`; 1 for rigid solids.
        max_indentation_m: (k,) as in `CompliantLayer`; 0 for rigid solids [m].
        largest_indentation_m: Largest `max_indentation_m` [m].
        collides: (p, k) collision filter: True if the patch may contact the solid; False for solids of its
            own and adjacent bodies.
    """

    geom_id: Indices
    geom_type: Indices
    size_m: Floats
    body_id: Indices
    bounding_radius_m: Floats
    first_triangle: Indices
    end_triangle: Indices
    triangles_m: Floats
    foam_fraction: Floats
    max_indentation_m: Floats
    largest_indentation_m: float
    collides: NDArray[np.bool_]


def build_contact_scene(
    mj: mujoco.MjModel, surface: SkinSurface, compliant_layers: Mapping[int, CompliantLayer] | None = None
) -> ContactScene:
    """Build the contact scene of `mj`.

    Args:
        mj: The model.
        surface: The skin.
        compliant_layers: Compliance of elastic bodies, by body id; all others are rigid.

    Raises:
        ModelError: a contact geom is a height field or a signed distance field.
    """
    geom = np.flatnonzero((mj.geom_contype != 0) | (mj.geom_conaffinity != 0)).astype(np.int64)
    for index in geom:
        if mj.geom_type[index] not in _SHAPES:
            kind = mujoco.mjtGeom(mj.geom_type[index]).name.removeprefix("mjGEOM_").lower()
            name = mj.geom(index).name or f"number {index}"
            raise ModelError(
                f'geom "{name}" is of type {kind}, which skin contact does not support; make it visual '
                "(contype and conaffinity 0) or use primitives or a mesh"
            )
    triangles: list[Floats] = []
    first, last = np.zeros_like(geom), np.zeros_like(geom)
    for k, index in enumerate(geom):
        if mj.geom_type[index] == geometry.MESH:
            triangles.append(_mesh_triangles_m(mj, int(mj.geom_dataid[index])))
            last[k] = sum(len(mesh) for mesh in triangles)
            first[k] = last[k] - len(triangles[-1])
    owner = mj.geom_bodyid[geom].astype(np.int64)
    gives = [(compliant_layers or {}).get(int(body), _RIGID_LAYER) for body in owner]
    return ContactScene(
        geom_id=geom,
        geom_type=mj.geom_type[geom].astype(np.int64),
        size_m=mj.geom_size[geom].copy(),
        body_id=owner,
        bounding_radius_m=mj.geom_rbound[geom].copy(),
        first_triangle=first,
        end_triangle=last,
        triangles_m=np.concatenate(triangles) if triangles else np.zeros((0, 3, 3)),
        foam_fraction=np.array([each.foam_fraction for each in gives], dtype=np.float64),
        max_indentation_m=np.array([each.max_indentation_m for each in gives], dtype=np.float64),
        largest_indentation_m=max((each.max_indentation_m for each in gives), default=0.0),
        collides=np.array(
            [[_may_collide(mj, int(a), int(b)) for b in owner] for a in surface.patch_body_id], dtype=np.bool_
        ).reshape(-1, len(geom)),
    )


def _mesh_triangles_m(mj: mujoco.MjModel, mesh: int) -> Floats:
    vertices = mj.mesh_vert[mj.mesh_vertadr[mesh] :][: mj.mesh_vertnum[mesh]]
    faces = mj.mesh_face[mj.mesh_faceadr[mesh] :][: mj.mesh_facenum[mesh]]
    triangles: Floats = vertices[faces].astype(np.float64)
    return triangles


def _may_collide(mj: mujoco.MjModel, skin_body: int, other: int) -> bool:
    """Collision filter: False for the skin's own body, its weld group, and neighbours across one joint.

    MuJoCo puts all bodies welded to the world into one group; skin on a fixed body must still contact a fixed
    table, so there only the body itself and its direct parent and children are excluded.
    """
    group, other_group = int(mj.body_weldid[skin_body]), int(mj.body_weldid[other])
    if group == 0 and other_group == 0:
        related = (skin_body, int(mj.body_parentid[skin_body]) or skin_body)
        return not (other in related or (other != 0 and mj.body_parentid[other] == skin_body))
    if group == other_group:
        return False
    if group == 0 or other_group == 0:
        return True  # as in MuJoCo: the world counts as nobody's parent
    up, other_up = (int(mj.body_weldid[mj.body_parentid[g]]) for g in (group, other_group))
    return up != other_group and other_up != group


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
    """Ray distance [m] from (x, y, z) along unit (u, v, w), world, to solid `k`; see `entry_distance_m`."""
    x, y, z = world_to_solid(scene, motion, k, x, y, z)
    u, v, w = rotate_inverse(motion.geom_xmat, scene.geom_id[k], u, v, w)
    size_m = scene.size_m
    return entry_distance_m(
        scene.geom_type[k],
        size_m[k, 0],
        size_m[k, 1],
        size_m[k, 2],
        scene.triangles_m,
        scene.first_triangle[k],
        scene.end_triangle[k],
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
