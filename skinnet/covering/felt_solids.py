"""Solids of a link that are felt: primitives and convex hulls of meshes, in the frame of one body.

A link is a body with all that is welded to it, as these move as one.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact import ray_casting as shapes
from skinnet.body.contact.convex_hull import (
    ConvexHulls,
    build_convex_hulls,
    hull_entry,
    hull_of,
    hull_vertices_m,
)
from skinnet.body.contact.ray_casting import entry_distance_m
from skinnet.compilation import compiled_without_nrt
from skinnet.errors import ModelError

__all__ = [
    "SOLID_SHAPES",
    "FeltSolids",
    "Link",
    "Model",
    "body_names",
    "felt_geoms",
    "felt_solids",
    "first_entry_m",
    "geom_names",
    "is_inside",
    "link_of_body",
    "model_bytes",
    "neighbour_poses",
    "relative_pose",
    "solid_entry_m",
]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

SOLID_SHAPES = (shapes.SPHERE, shapes.CAPSULE, shapes.ELLIPSOID, shapes.CYLINDER, shapes.BOX, shapes.MESH)
_GRID = 2.0**24
"""Inverse of the grid [m] to which coordinates are rounded, so that last bits of a mesh do not matter."""
_SWEEP = {1: 72, 2: 9}
"""Values of each joint of a sweep, by the number of joints between two links."""
_SWEEP_OF_MORE = 5


class FeltSolids(NamedTuple):
    """Felt solids of a link (k) in the frame of its body.

    Attributes:
        geom_id: (k,) ids of the geoms.
        kind: (k,) their shapes, as `mjtGeom`.
        size_m: (k, 3) their sizes as in MuJoCo's `geom_size` [m]; unused for meshes.
        position_m: (k, 3) their centres [m].
        R_body_solid: (k, 3, 3) their orientations.
        hull: (k,) row of each mesh in `hulls`, -1 for primitives.
        hulls: Convex hulls of the meshes, frame of the body.
        corner_m: (t, 3, 3) corners of the triangles of the hulls, counter-clockwise from outside [m].
        sphere_m: (k, 4) centre and radius of bounding spheres [m].
    """

    geom_id: Indices
    kind: Indices
    size_m: Floats
    position_m: Floats
    R_body_solid: Floats
    hull: Indices
    hulls: ConvexHulls
    corner_m: Floats
    sphere_m: Floats


Model: TypeAlias = mujoco.MjModel
"""MuJoCo's model, of which the other modules of covering know nothing but what this one tells."""


class Link(NamedTuple):
    """Link: a body and all bodies that are welded to it.

    Attributes:
        body_id: Body in whose frame the link is described.
        members: Ids of all its bodies, ascending.
    """

    body_id: int
    members: tuple[int, ...]


def relative_pose(mj: Model, body_id: int, other_id: int) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) [m] of the frame of body `other_id` in that of body `body_id`, at rest."""
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    pose = _pose(data, body_id, other_id)
    return pose[:, :3], pose[:, 3]


def body_names(mj: Model) -> dict[str, int]:
    """Ids of the robot's bodies by their names: of all but the world and mocap bodies."""
    return {mj.body(i).name: i for i in range(1, mj.nbody) if mj.body_mocapid[i] < 0}


def geom_names(mj: Model, geoms: Sequence[int]) -> dict[str, int]:
    """Ids of those of `geoms` that have names, by their names."""
    return {mj.geom(geom).name: geom for geom in geoms if mj.geom(geom).name}


def model_bytes(mj: Model) -> bytes:
    """All of a compiled model as bytes."""
    buffer = np.zeros(mujoco.mj_sizeModel(mj), dtype=np.uint8)
    mujoco.mj_saveModel(mj, None, buffer)
    return buffer.tobytes()


def link_of_body(mj: Model, body_id: int) -> Link:
    """Link of a body; fixed bodies form a link with those on the same child of the world."""
    weld = int(mj.body_weldid[body_id])
    members = [i for i in range(1, mj.nbody) if int(mj.body_weldid[i]) == weld]
    if weld == 0:
        members = [i for i in members if mj.body_rootid[i] == mj.body_rootid[body_id]]
    return Link(body_id, tuple(members))


def felt_geoms(mj: Model, bodies: Sequence[int]) -> list[int]:
    """Geoms of `bodies` that can collide, by their masks or by a `<pair>`, and have a surface to cover."""
    paired = {int(geom) for pair in (mj.pair_geom1, mj.pair_geom2) for geom in pair}
    return [
        geom
        for geom in range(mj.ngeom)
        if int(mj.geom_bodyid[geom]) in bodies
        and int(mj.geom_type[geom]) in SOLID_SHAPES
        and (mj.geom_contype[geom] or mj.geom_conaffinity[geom] or geom in paired)
    ]


def felt_solids(mj: Model, link: Link) -> FeltSolids:
    """Build the felt solids of `link`, in the frame of its body.

    Raises:
        ModelError: the vertices of a mesh lie in a plane.
    """
    geoms = felt_geoms(mj, link.members)
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    R_world_body, origin_m = data.xmat[link.body_id].reshape(3, 3), data.xpos[link.body_id]
    position_m = np.zeros((len(geoms), 3))
    rotation = np.zeros((len(geoms), 3, 3))
    vertices_m: list[Floats] = []
    hull = np.full(len(geoms), -1, dtype=np.int64)
    for row, geom in enumerate(geoms):
        position_m[row] = _rounded(_turned_back(R_world_body, data.geom_xpos[geom] - origin_m))
        R_world_geom = data.geom_xmat[geom].reshape(3, 3)
        rotation[row] = np.stack([_turned_back(R_world_body, axis) for axis in R_world_geom.T], axis=1)
        if mj.geom_type[geom] == shapes.MESH:
            hull[row] = len(vertices_m)
            own_m = hull_vertices_m(mj, int(mj.geom_dataid[geom]))
            turned = sum(own_m[:, k, None] * rotation[row][:, k] for k in range(3))
            vertices_m.append(np.unique(_rounded(position_m[row] + turned), axis=0))
    rotation = np.round(rotation * 2.0**40) / 2.0**40
    try:
        hulls = build_convex_hulls(vertices_m)
        corner_m = [points_m[hull_of(points_m)[1]] for points_m in vertices_m]
    except ValueError:
        raise ModelError(
            f'body "{mj.body(link.body_id).name}": a mesh of it is flat, its hull has no inside'
        ) from None
    size_m = mj.geom_size[geoms].astype(np.float64)
    sphere_m = np.column_stack([position_m, _bounding_radii_m(mj, geoms, size_m)])
    for row in np.flatnonzero(hull >= 0).tolist():
        points_m = vertices_m[hull[row]]
        centre_m = 0.5 * (points_m.min(axis=0) + points_m.max(axis=0))
        sphere_m[row] = (*centre_m, np.linalg.norm(points_m - centre_m, axis=1).max())
    return FeltSolids(
        geom_id=np.array(geoms, dtype=np.int64),
        kind=mj.geom_type[geoms].astype(np.int64),
        size_m=size_m,
        position_m=position_m,
        R_body_solid=rotation,
        hull=hull,
        hulls=hulls,
        corner_m=np.concatenate([np.zeros((0, 3, 3)), *corner_m]),
        sphere_m=sphere_m,
    )


def neighbour_poses(mj: Model, link: Link) -> list[tuple[Link, Floats]]:
    """Links across one set of joints from `link`, with their poses (s, 3, 4) over the joints' ranges.

    A pose is R and t of the frame of the neighbour's body in that of the link's. Free joints have no range,
    and what stands in the world does not count as a neighbour beyond one; ball joints stay where they are.
    """
    weld = mj.body_weldid
    own = int(weld[link.body_id])
    found: list[tuple[int, int]] = []
    if own != 0:
        parent = int(mj.body_parentid[own])
        found.append((parent, own))
    children = sorted({int(weld[i]) for i in range(1, mj.nbody)} - {0, own})
    found += [(child, child) for child in children if int(mj.body_parentid[child]) in link.members]
    neighbours = []
    for body, moved in found:
        joints = range(int(mj.body_jntadr[moved]), int(mj.body_jntadr[moved]) + int(mj.body_jntnum[moved]))
        if body == 0 or any(mj.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE for j in joints):
            continue
        swept = [j for j in joints if mj.jnt_type[j] != mujoco.mjtJoint.mjJNT_BALL]
        neighbours.append((link_of_body(mj, body), _sweep(mj, link.body_id, body, swept)))
    return neighbours


def _sweep(mj: Model, body_id: int, neighbour_id: int, joints: Sequence[int]) -> Floats:
    steps = _SWEEP.get(len(joints), _SWEEP_OF_MORE)
    values = []
    for joint in joints:
        low, high = mj.jnt_range[joint] if mj.jnt_limited[joint] else (-np.pi, np.pi)
        if not mj.jnt_limited[joint] and mj.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            low = high = 0.0
        values.append(np.linspace(low, high, steps))
    data, poses = mujoco.MjData(mj), []
    for index in np.ndindex(*(steps for _ in joints)):
        data.qpos[:] = mj.qpos0
        for joint, column, step in zip(joints, values, index, strict=True):
            data.qpos[mj.jnt_qposadr[joint]] = column[step]
        mujoco.mj_kinematics(mj, data)
        poses.append(_pose(data, body_id, neighbour_id))
    return np.array(poses)


def _pose(data: mujoco.MjData, body_id: int, other_id: int) -> Floats:
    """R and t (3, 4) of the frame of one body in that of another, at the present positions."""
    R_world_body = data.xmat[body_id].reshape(3, 3)
    turned = [_turned_back(R_world_body, axis) for axis in data.xmat[other_id].reshape(3, 3).T]
    shift_m = _turned_back(R_world_body, data.xpos[other_id] - data.xpos[body_id])
    return _rounded(np.column_stack([*turned, shift_m]))


def _turned_back(R: Floats, vector: Floats) -> Floats:
    """Return R^T · vector without BLAS, whose rounding depends on the machine."""
    turned: Floats = R[0] * vector[0] + R[1] * vector[1] + R[2] * vector[2]
    return turned


def _rounded(value: Floats) -> Floats:
    rounded: Floats = np.round(value * _GRID) / _GRID
    return rounded


def _bounding_radii_m(mj: Model, geoms: list[int], size_m: Floats) -> Floats:
    radii_m = np.zeros(len(geoms))
    for row, geom in enumerate(geoms):
        a, b, c = size_m[row]
        match int(mj.geom_type[geom]):
            case shapes.SPHERE:
                radii_m[row] = a
            case shapes.CAPSULE:
                radii_m[row] = a + b
            case shapes.CYLINDER:
                radii_m[row] = np.sqrt(a * a + b * b)
            case _:
                radii_m[row] = np.sqrt(a * a + b * b + c * c)
    return radii_m


@compiled_without_nrt
def solid_entry_m(
    solids: FeltSolids, k: int, x: float, y: float, z: float, u: float, v: float, w: float
) -> float:
    """Ray distance [m] from (x, y, z) along unit (u, v, w) to solid `k`, frame of the body.

    Zero if the origin is inside, infinity if the ray misses.
    """
    if solids.hull[k] >= 0:
        return hull_entry(solids.hulls, solids.hull[k], x, y, z, u, v, w, -1)[0]
    R, o = solids.R_body_solid, solids.position_m
    px, py, pz = x - o[k, 0], y - o[k, 1], z - o[k, 2]
    size = solids.size_m
    return entry_distance_m(
        solids.kind[k],
        size[k, 0],
        size[k, 1],
        size[k, 2],
        R[k, 0, 0] * px + R[k, 1, 0] * py + R[k, 2, 0] * pz,
        R[k, 0, 1] * px + R[k, 1, 1] * py + R[k, 2, 1] * pz,
        R[k, 0, 2] * px + R[k, 1, 2] * py + R[k, 2, 2] * pz,
        R[k, 0, 0] * u + R[k, 1, 0] * v + R[k, 2, 0] * w,
        R[k, 0, 1] * u + R[k, 1, 1] * v + R[k, 2, 1] * w,
        R[k, 0, 2] * u + R[k, 1, 2] * v + R[k, 2, 2] * w,
    )


@compiled_without_nrt
def first_entry_m(
    solids: FeltSolids, x: float, y: float, z: float, u: float, v: float, w: float, reach_m: float
) -> float:
    """Ray distance [m] from (x, y, z) along unit (u, v, w) to the union of all solids.

    Zero if the origin is inside, infinity if there is nothing within `reach_m`.
    """
    nearest_m = np.inf
    for k in range(len(solids.kind)):
        px, py, pz = solids.sphere_m[k, 0] - x, solids.sphere_m[k, 1] - y, solids.sphere_m[k, 2] - z
        radius_m = solids.sphere_m[k, 3] + 1e-9
        along_m = px * u + py * v + pz * w
        if along_m < -radius_m or along_m > reach_m + radius_m:
            continue
        if px * px + py * py + pz * pz - along_m * along_m > radius_m * radius_m:
            continue
        nearest_m = min(nearest_m, solid_entry_m(solids, k, x, y, z, u, v, w))
    return nearest_m if nearest_m <= reach_m else np.inf


@compiled_without_nrt
def is_inside(solids: FeltSolids, k: int, x: float, y: float, z: float) -> bool:
    """True if (x, y, z) [m] is inside solid `k`."""
    px, py, pz = x - solids.sphere_m[k, 0], y - solids.sphere_m[k, 1], z - solids.sphere_m[k, 2]
    radius_m = solids.sphere_m[k, 3]
    if px * px + py * py + pz * pz > radius_m * radius_m:
        return False
    return solid_entry_m(solids, k, x, y, z, 0.0, 0.0, 1.0) == 0.0
