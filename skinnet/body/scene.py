"""Contact scene: the solids that skin can contact, MuJoCo's motion arrays, collision filtering."""

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body import geometry
from skinnet.body.frames import rotated_back
from skinnet.body.geometry import entry_m
from skinnet.body.surface import Surface
from skinnet.body.yielding import Yielding
from skinnet.compiled import borrowing
from skinnet.errors import ModelError

__all__ = ["Motion", "Scene", "into_solid", "motion_of", "ray_m", "scene_of", "within"]

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


_RIGID = Yielding(1.0)


class Scene(NamedTuple):
    """Contact scene: the geoms of the model that take part in contacts (not the visual ones).

    Attributes:
        geom: (k,) ids of the geoms.
        kind: (k,) their shapes, as `mjtGeom`.
        size_m: (k, 3) their sizes [m].
        body: (k,) ids of their bodies.
        bound_m: (k,) radius of each bounding sphere, 0 for planes [m].
        first: (k,) first triangle of each mesh.
        last: (k,) one past its last.
        triangles_m: (t, 3, 3) corners of the triangles of all meshes, frames of the geoms [m].
        share: (k,) as in `Yielding`; 1 for rigid solids.
        give_m: (k,) as in `Yielding`; 0 for rigid solids [m].
        deepest_m: Largest `give_m` [m].
        felt: (p, k) collision filter: True if the patch may contact the solid; False for solids of its own
            and adjacent bodies.
    """

    geom: Indices
    kind: Indices
    size_m: Floats
    body: Indices
    bound_m: Floats
    first: Indices
    last: Indices
    triangles_m: Floats
    share: Floats
    give_m: Floats
    deepest_m: float
    felt: NDArray[np.bool_]


class Motion(NamedTuple):
    """Motion state: views of MuJoCo's arrays of poses and spatial velocities at the present time.

    Attributes:
        xpos: (nbody, 3) origins of the bodies [m], world.
        xmat: (nbody, 9) rotations of the bodies.
        xipos: (nbody, 3) centres of mass of the bodies [m], world.
        geom_xpos: (ngeom, 3) origins of the geoms [m], world.
        geom_xmat: (ngeom, 9) rotations of the geoms.
        cvel: (nbody, 6) angular and linear velocity at `centre_m` of the body's root, world.
        centre_m: (nbody, 3) centres of mass of the subtrees [m], world.
        root: (nbody,) ids of the root bodies of the kinematic trees.
    """

    xpos: Floats
    xmat: Floats
    xipos: Floats
    geom_xpos: Floats
    geom_xmat: Floats
    cvel: Floats
    centre_m: Floats
    root: NDArray[np.int32]


def motion_of(mj: mujoco.MjModel, data: mujoco.MjData) -> Motion:
    """Build the motion state as views of the arrays of `data`."""
    return Motion(
        xpos=data.xpos,
        xmat=data.xmat,
        xipos=data.xipos,
        geom_xpos=data.geom_xpos,
        geom_xmat=data.geom_xmat,
        cvel=data.cvel,
        centre_m=data.subtree_com,
        root=mj.body_rootid,
    )


def scene_of(mj: mujoco.MjModel, surface: Surface, yielding: Mapping[int, Yielding] | None = None) -> Scene:
    """Build the contact scene of `mj`.

    Args:
        mj: The model.
        surface: The skin.
        yielding: Compliance of elastic bodies, by body id; all others are rigid.

    Raises:
        ModelError: a contact geom is a height field or a signed distance field.
    """
    geom = np.flatnonzero((mj.geom_contype != 0) | (mj.geom_conaffinity != 0)).astype(np.int64)
    for index in geom:
        if mj.geom_type[index] not in _SHAPES:
            kind = mujoco.mjtGeom(mj.geom_type[index]).name.removeprefix("mjGEOM_").lower()
            name = mj.geom(index).name or f"number {index}"
            raise ModelError(
                f'geom "{name}" is of type {kind}, which skin cannot feel; make it visual '
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
    gives = [(yielding or {}).get(int(body), _RIGID) for body in owner]
    return Scene(
        geom=geom,
        kind=mj.geom_type[geom].astype(np.int64),
        size_m=mj.geom_size[geom].copy(),
        body=owner,
        bound_m=mj.geom_rbound[geom].copy(),
        first=first,
        last=last,
        triangles_m=np.concatenate(triangles) if triangles else np.zeros((0, 3, 3)),
        share=np.array([each.share for each in gives], dtype=np.float64),
        give_m=np.array([each.give_m for each in gives], dtype=np.float64),
        deepest_m=max((each.give_m for each in gives), default=0.0),
        felt=np.array(
            [[_can_feel(mj, int(a), int(b)) for b in owner] for a in surface.patch_body], dtype=np.bool_
        ).reshape(-1, len(geom)),
    )


def _mesh_triangles_m(mj: mujoco.MjModel, mesh: int) -> Floats:
    vertices = mj.mesh_vert[mj.mesh_vertadr[mesh] :][: mj.mesh_vertnum[mesh]]
    faces = mj.mesh_face[mj.mesh_faceadr[mesh] :][: mj.mesh_facenum[mesh]]
    triangles: Floats = vertices[faces].astype(np.float64)
    return triangles


def _can_feel(mj: mujoco.MjModel, skin_body: int, other: int) -> bool:
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


@borrowing
def within(scene: Scene, motion: Motion, k: int, x: float, y: float, z: float, radius_m: float) -> bool:
    """Broad-phase test: True if solid `k` may intersect the sphere of `radius_m` around (x, y, z) [m]."""
    g = scene.geom[k]
    dx, dy, dz = x - motion.geom_xpos[g, 0], y - motion.geom_xpos[g, 1], z - motion.geom_xpos[g, 2]
    if scene.kind[k] == geometry.PLANE:
        axes = motion.geom_xmat
        return bool(dx * axes[g, 2] + dy * axes[g, 5] + dz * axes[g, 8] <= radius_m)
    reach = radius_m + scene.bound_m[k]
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return False
    kind, a, b, c = scene.kind[k], scene.size_m[k, 0], scene.size_m[k, 1], scene.size_m[k, 2]
    if kind == geometry.BOX:
        dx, dy, dz = rotated_back(motion.geom_xmat, g, dx, dy, dz)
        return bool(max(abs(dx) - a, abs(dy) - b, abs(dz) - c) <= radius_m)
    if kind in (geometry.CYLINDER, geometry.CAPSULE):
        dx, dy, dz = rotated_back(motion.geom_xmat, g, dx, dy, dz)
        end = b if kind == geometry.CYLINDER else a + b
        reach = radius_m + a
        return bool(abs(dz) <= radius_m + end and dx * dx + dy * dy <= reach * reach)
    return True


@borrowing
def ray_m(
    scene: Scene, motion: Motion, k: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> float:
    """Ray distance [m] from (x, y, z) along the unit vector (u, v, w), world, to solid `k` (`entry_m`)."""
    x, y, z = into_solid(scene, motion, k, x, y, z)
    u, v, w = rotated_back(motion.geom_xmat, scene.geom[k], u, v, w)
    size_m = scene.size_m
    return entry_m(
        scene.kind[k],
        size_m[k, 0],
        size_m[k, 1],
        size_m[k, 2],
        scene.triangles_m,
        scene.first[k],
        scene.last[k],
        x,
        y,
        z,
        u,
        v,
        w,
    )


@borrowing
def into_solid(
    scene: Scene, motion: Motion, k: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Transform the point (x, y, z) [m] from the world frame to the frame of solid `k`."""
    g, origin = scene.geom[k], motion.geom_xpos
    return rotated_back(motion.geom_xmat, g, x - origin[g, 0], y - origin[g, 1], z - origin[g, 2])
