"""Visual shapes of a body and forward kinematics of its links, for viewers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.environment.free_bodies import free_body_ids
from skinnet.body.model import load_model
from skinnet.body.shown_geoms import felt_geoms, shown_geoms
from skinnet.deployment.deployment import Deployment

__all__ = ["Camera", "Pose", "VisualModel", "VisualShape"]

Floats = NDArray[np.float64]

_GEOM_TYPE_NAMES = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
_CAMERA_DISTANCE_EXTENTS = 1.3
"""Distance of the camera, in extents of the model."""
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
"""Default colour of a MuJoCo geom; the colour is then that of its material."""


@dataclass(frozen=True)
class VisualShape:
    """Visual shape of a link.

    Attributes:
        link: Name of its link.
        geom_type: "plane", "sphere", "capsule", "ellipsoid", "cylinder", "box" or "mesh".
        size_m: (3,) MuJoCo's `geom_size`: radius, half-lengths.
        position_m: (3,) centre, frame of the link [m].
        wxyz: (4,) quaternion, frame of the link.
        rgba: (4,) colour, 0 to 1.
        vertices_m: (v, 3) vertices of a mesh, frame of the shape [m]; empty for all others.
        faces: (f, 3) triangles of a mesh; empty for all others.
    """

    link: str
    geom_type: str
    size_m: Floats
    position_m: Floats
    wxyz: Floats
    rgba: Floats
    vertices_m: Floats
    faces: NDArray[np.int64]


class Pose(NamedTuple):
    """Pose of a link: position (3,) [m] and quaternion (4,), (w, x, y, z), world."""

    position_m: Floats
    wxyz: Floats


class Camera(NamedTuple):
    """Camera pose that the model suggests: position (3,) and look-at point (3,), world [m]."""

    position_m: Floats
    look_at_m: Floats


class VisualModel:
    """Visual model of a body: shapes, and poses of its links.

    Attributes:
        links: Names of all links, `world` first; unnamed ones are called `body` with their id.
        free_links: Links of free bodies, by their name in messages.
        shapes: Shapes that pictures show.
        felt_shapes: Shapes of all geoms that can collide, whether or not they are seen.
        home_rad: (D,) positions of the controlled joints at home [rad].
        camera: Suggested camera.
    """

    def __init__(self, deployment: Deployment, base_dir: Path) -> None:
        """Compile the model.

        Raises:
            ModelError: the model does not compile or lacks something.
            DeploymentError: the deployment contradicts the model.
        """
        self._model = load_model(deployment, base_dir)
        mj = self._model.mj
        self._data = mujoco.MjData(mj)
        self._data.qpos[:] = self._model.home_qpos
        self.links = tuple(mj.body(i).name or f"body{i}" for i in range(mj.nbody))
        self.free_links = {name: self.links[i] for name, i in free_body_ids(mj).items()}
        known = np.isin(mj.geom_type, [*map(int, _GEOM_TYPE_NAMES)])
        self.shapes = tuple(self._shape(i) for i in np.flatnonzero(shown_geoms(mj) & known).tolist())
        self.felt_shapes = tuple(self._shape(i) for i in np.flatnonzero(felt_geoms(mj) & known).tolist())
        self.home_rad: list[float] = self._model.home_qpos[self._model.qpos_address].tolist()
        self.camera = _camera(mj)

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self._model.joint_id)

    def poses(
        self, position_rad: Sequence[float], free_body_poses: Mapping[str, Sequence[float]]
    ) -> dict[str, Pose]:
        """Compute poses of all links, world.

        Args:
            position_rad: (D,) positions of the controlled joints [rad].
            free_body_poses: Poses (7,) of free bodies, position [m] and quaternion, by name; others are at
                their start.
        """
        self._data.qpos[self._model.qpos_address] = position_rad
        self._model.follow(self._data.qpos)
        mujoco.mj_kinematics(self._model.mj, self._data)
        poses = {
            link: Pose(self._data.xpos[i].copy(), self._data.xquat[i].copy())
            for i, link in enumerate(self.links)
        }
        for name, numbers in free_body_poses.items():
            if name in self.free_links and len(numbers) == 7:
                pose = np.array(numbers, dtype=np.float64)
                poses[self.free_links[name]] = Pose(pose[:3], pose[3:])
        return poses

    def _shape(self, geom: int) -> VisualShape:
        mj = self._model.mj
        material = int(mj.geom_matid[geom])
        own = material < 0 or (mj.geom_rgba[geom] != _DEFAULT_RGBA).any()
        vertices, faces = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(mj.geom_dataid[geom])
            first, count = int(mj.mesh_vertadr[mesh]), int(mj.mesh_vertnum[mesh])
            vertices = mj.mesh_vert[first : first + count].astype(np.float64)
            first, count = int(mj.mesh_faceadr[mesh]), int(mj.mesh_facenum[mesh])
            faces = mj.mesh_face[first : first + count].astype(np.int64)
        return VisualShape(
            link=self.links[mj.geom_bodyid[geom]],
            geom_type=_GEOM_TYPE_NAMES[mujoco.mjtGeom(mj.geom_type[geom])],
            size_m=mj.geom_size[geom].copy(),
            position_m=mj.geom_pos[geom].copy(),
            wxyz=mj.geom_quat[geom].copy(),
            rgba=(mj.geom_rgba[geom] if own else mj.mat_rgba[material]).astype(np.float64),
            vertices_m=vertices,
            faces=faces,
        )


def _camera(mj: mujoco.MjModel) -> Camera:
    """Compute the camera of MuJoCo's own viewer, a little nearer."""
    look_at = mj.stat.center.copy()
    view = mj.vis.global_
    azimuth, elevation = math.radians(view.azimuth), math.radians(view.elevation)
    ahead = [
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    ]
    return Camera(look_at - _CAMERA_DISTANCE_EXTENTS * mj.stat.extent * np.array(ahead), look_at)
