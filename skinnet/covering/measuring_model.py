"""Measuring model of a link: MuJoCo's own rays and distances, to judge what the placer of cells has done.

The placer has geometry of its own in compiled code. Nothing of it is used here: solids are built anew for
MuJoCo, cells are prisms among them, and samples of the surface are where straight lines cross it.
"""

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from skinnet import pinned_math
from skinnet.body.contact.convex_hull import hull_vertices_m
from skinnet.covering.felt_solids import SOLID_SHAPES, Link, Model, felt_geoms

__all__ = ["MeasuringModel", "plate_overlap_m", "surface_heights_m"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_STEPS = tuple(1.1673039782614187**-k for k in range(1, 5))
"""Steps of the quasi-random sequence R4: powers of the root of x⁵ = x + 1 (Roberts, 2018)."""
_TOUCH_M = 1e-6
"""Distance [m] below which two solids count as one."""
_OFF_M, _PROBE_M = 1e-3, 1e-7
"""Distance [m] from a surface of the point from which its normal is taken, and the radius of that point."""


class MeasuringModel:
    """Felt and visual geoms of one link with a prism over a cell, in the frame of the link's body.

    Visual are the geoms that cannot be felt; where a link has none, its meshes as drawn and its primitives.
    """

    def __init__(self, mj: Model, link: Link, side_m: float, low_m: float, high_m: float) -> None:
        """Build the model; the prism reaches from `low_m` to `high_m` [m] above a cell of `side_m` [m]."""
        self._origin_m, self._R = _world_pose(mj, link.body_id)
        self._drawn, self._drawn_data = mj, _at_rest(mj)
        felt = felt_geoms(mj, link.members)
        own = [g for g in range(mj.ngeom) if int(mj.geom_bodyid[g]) in link.members]
        self._visual = [g for g in own if g not in felt and int(mj.geom_type[g]) in SOLID_SHAPES]
        self._visual = self._visual or felt
        spec = mujoco.MjSpec()
        for geom in felt:
            _add_geom(spec, mj, self._drawn_data, geom, self._origin_m, self._R)
        _add_prism(spec, side_m, low_m, high_m)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[_PROBE_M, 0.0, 0.0])
        self._model = spec.compile()
        self._data = _at_rest(self._model)
        self._prism, self._probe = self._model.ngeom - 2, self._model.ngeom - 1

    def is_buried(self, position_m: Floats, R: Floats) -> bool:
        """True if a felt solid reaches into the prism over a cell at `position_m` (3,) with axes `R`."""
        _place(self._model, self._data, self._prism, position_m, R)
        return any(
            mujoco.mj_geomDistance(self._model, self._data, self._prism, geom, 1.0, None) < -_TOUCH_M
            for geom in range(self._prism)
        )

    def felt_heights_m(self, points_m: Floats, normal: Floats, above_m: float, below_m: float) -> Floats:
        """Heights (p,) [m] of the felt surface along `normal` over points (p, 3); −inf beyond `below_m`."""
        geoms = range(self._prism)
        return surface_heights_m(self._model, self._data, geoms, points_m, normal, above_m, below_m)

    def visual_heights_m(self, points_m: Floats, normal: Floats, above_m: float, below_m: float) -> Floats:
        """Heights (p,) [m] of the visual surface, as `felt_heights_m`."""
        at_m = points_m @ self._R.T + self._origin_m
        return surface_heights_m(
            self._drawn, self._drawn_data, self._visual, at_m, self._R @ normal, above_m, below_m
        )

    def surface_points(self, count: int) -> tuple[Floats, Floats, float]:
        """Points (p, 3) [m] of the felt surface with normals (p, 3), evenly by area, and its area [m²].

        Straight lines, isotropic and uniform in a sphere about the link, cross every part of the surface in
        proportion to its area (Crofton's formula; Santaló, Integral Geometry, 1976, eq. 14.70). Parts inside
        another solid are left out.

        Args:
            count: Number of points wanted, about; at most twenty times as many lines are drawn.
        """
        centre_m, radius_m = self._bounding_sphere()
        points, normals, n_lines = [], [], 0
        for start_m, along in zip(*_lines(20 * count, centre_m, radius_m), strict=True):
            for point_m, normal in self._crossings(start_m, along, 2.0 * radius_m):
                points.append(point_m)
                normals.append(normal)
            n_lines += 1
            if len(points) >= count:
                break
        area_m2 = 2.0 * math.pi * radius_m**2 * len(points) / n_lines
        return np.array(points).reshape(-1, 3), np.array(normals).reshape(-1, 3), area_m2

    def _bounding_sphere(self) -> tuple[Floats, float]:
        centres_m, radii_m = self._data.geom_xpos[: self._prism], self._model.geom_rbound[: self._prism]
        centre_m = 0.5 * (
            (centres_m - radii_m[:, None]).min(axis=0) + (centres_m + radii_m[:, None]).max(axis=0)
        )
        return centre_m, float((np.sqrt(((centres_m - centre_m) ** 2).sum(axis=1)) + radii_m).max() + 1e-3)

    def _crossings(self, start_m: Floats, along: Floats, length_m: float) -> list[tuple[Floats, Floats]]:
        """Points and outward normals at which a line enters or leaves the union of the felt solids."""
        spans, end_m = [], start_m + length_m * along
        for geom in range(self._prism):
            first_m = _ray_m(self._model, self._data, geom, start_m, along)
            if first_m >= 0.0:
                last_m = length_m - _ray_m(self._model, self._data, geom, end_m, -along)
                spans.append((first_m, geom, last_m))
        merged: list[list[tuple[float, int]]] = []
        for first_m, geom, last_m in sorted(spans):
            if merged and first_m <= merged[-1][1][0] + _TOUCH_M:
                merged[-1][1] = max(merged[-1][1], (last_m, geom))
            else:
                merged.append([(first_m, geom), (last_m, geom)])
        return [
            (start_m + at_m * along, self._normal(geom, start_m + at_m * along, out * along))
            for span in merged
            for (at_m, geom), out in zip(span, (-1.0, 1.0), strict=True)
        ]

    def _normal(self, geom: int, point_m: Floats, outwards: Floats) -> Floats:
        """Normal (3,) of a geom at a point of its surface: that of the point nearest to one off it."""
        segment_m = np.zeros(6)
        self._data.geom_xpos[self._probe] = point_m + _OFF_M * outwards
        mujoco.mj_geomDistance(self._model, self._data, geom, self._probe, 1.0, segment_m)
        across_m = segment_m[3:] - segment_m[:3]
        length_m = math.sqrt(float((across_m * across_m).sum()))
        return across_m / length_m if length_m > _TOUCH_M else outwards


def plate_overlap_m(position_m: Floats, R: Floats, pairs: Indices, side_m: float, plate_m: float) -> Floats:
    """Depths (p,) [m] by which plates of pairs (p, 2) of cells penetrate each other; 0 if they are apart."""
    spec = mujoco.MjSpec()
    _add_prism(spec, side_m, 0.0, plate_m)
    _add_prism(spec, side_m, 0.0, plate_m)
    model = spec.compile()
    data = _at_rest(model)
    depth_m = np.zeros(len(pairs))
    for row, pair in enumerate(pairs.tolist()):
        for geom, cell in enumerate(pair):
            _place(model, data, geom, position_m[cell], R[cell])
        depth_m[row] = max(-mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None), 0.0)
    return depth_m


def surface_heights_m(
    model: Model,
    data: mujoco.MjData,
    geoms: Sequence[int],
    points_m: Floats,
    normal: Floats,
    above_m: float,
    below_m: float,
) -> Floats:
    """Heights (p,) [m] of geoms of a placed model over points (p, 3) of the world, along `normal` (3,).

    Rays start `above_m` over each point and end `below_m` under it; −inf where they meet nothing.
    """
    centre_m = points_m.mean(axis=0)
    reach_m = float(np.sqrt(((points_m - centre_m) ** 2).sum(axis=1)).max()) + above_m + below_m
    near = [
        geom
        for geom in geoms
        if np.sqrt(((data.geom_xpos[geom] - centre_m) ** 2).sum()) < reach_m + model.geom_rbound[geom]
    ]
    heights_m = np.full(len(points_m), -np.inf)
    start_m, down = points_m + above_m * normal, -normal
    for geom in near:
        for i, point_m in enumerate(start_m):
            entry_m = _ray_m(model, data, geom, point_m, down)
            if 0.0 <= entry_m <= above_m + below_m:
                heights_m[i] = max(heights_m[i], above_m - entry_m)
    return heights_m


def _at_rest(model: Model) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


def _world_pose(mj: Model, body_id: int) -> tuple[Floats, Floats]:
    data = _at_rest(mj)
    return data.xpos[body_id].copy(), data.xmat[body_id].reshape(3, 3).copy()


def _add_geom(
    spec: mujoco.MjSpec, mj: Model, data: mujoco.MjData, geom: int, origin_m: Floats, R: Floats
) -> None:
    """Add a geom of `mj` in the frame with origin `origin_m` and axes `R`; a mesh as its convex hull."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, (R.T @ data.geom_xmat[geom].reshape(3, 3)).ravel())
    pose = {"pos": R.T @ (data.geom_xpos[geom] - origin_m), "quat": quaternion}
    if mj.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        kind = mujoco.mjtGeom(int(mj.geom_type[geom]))
        spec.worldbody.add_geom(type=kind, size=mj.geom_size[geom], **pose)
        return
    _add_hull(spec, hull_vertices_m(mj, int(mj.geom_dataid[geom])), **pose)


def _add_prism(spec: mujoco.MjSpec, side_m: float, low_m: float, high_m: float) -> None:
    angle = np.radians(30.0 + 60.0 * np.arange(6))
    rim_m = side_m * np.column_stack([np.cos(angle), np.sin(angle)])
    _add_hull(spec, np.array([(x, y, z) for z in (low_m, high_m) for x, y in rim_m]))


def _add_hull(spec: mujoco.MjSpec, vertices_m: Floats, **pose: Floats) -> None:
    hull = ConvexHull(vertices_m)
    faces = hull.simplices.copy()
    a, b, c = (vertices_m[faces[:, k]] for k in range(3))
    inwards = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    name = f"hull{len(spec.meshes)}"
    spec.add_mesh(
        name=name,
        uservert=vertices_m.ravel(),
        userface=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **pose)


def _place(model: Model, data: mujoco.MjData, geom: int, position_m: Floats, R: Floats) -> None:
    """Move a geom of the world to where its frame before compiling is at `position_m` with axes `R`."""
    own = np.zeros(9)
    mujoco.mju_quat2Mat(own, model.geom_quat[geom])
    data.geom_xpos[geom] = position_m + R @ model.geom_pos[geom]
    data.geom_xmat[geom] = (R @ own.reshape(3, 3)).ravel()


def _ray_m(model: Model, data: mujoco.MjData, geom: int, point_m: Floats, along: Floats) -> float:
    """Distance [m] of a geom from a point along a ray, −1 if it misses."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        return float(mujoco.mj_rayMesh(model, data, geom, point_m, along))
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    return float(mujoco.mju_rayGeom(data.geom_xpos[geom], data.geom_xmat[geom], size, point_m, along, kind))


def _lines(count: int, centre_m: Floats, radius_m: float) -> tuple[Floats, Floats]:
    """Starts (n, 3) [m] and directions (n, 3) of isotropic lines, uniform through a sphere.

    Each comes with those whose coordinates are exchanged, so that no axis is preferred.
    """
    a, b, c, d = ((0.5 + np.arange(1, -(-count // 3) + 1) * step) % 1.0 for step in _STEPS)
    z = 2.0 * a - 1.0
    across = np.sqrt(1.0 - z * z)
    cosine, sine = _circle(b)
    along = np.column_stack([across * cosine, across * sine, z])
    u = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    u /= np.sqrt((u * u).sum(axis=1))[:, None]
    cosine, sine = _circle(d)
    offset = cosine[:, None] * u + sine[:, None] * np.cross(along, u)
    start_m = radius_m * (np.sqrt(c)[:, None] * offset - along)
    in_turn = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1)])
    return centre_m + start_m[:, in_turn].reshape(-1, 3), along[:, in_turn].reshape(-1, 3)


def _circle(turns: NDArray[np.floating[Any]]) -> tuple[Floats, Floats]:
    angle: Floats = 2.0 * math.pi * turns.astype(np.float64)
    return pinned_math.cos_of(angle), pinned_math.sin_of(angle)
