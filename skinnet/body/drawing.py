"""What the model looks like, as plain shapes in the frames of its bodies: to draw it without MuJoCo."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.links import WORLD
from skinnet.body.loose import LOOSE
from skinnet.body.model import load_model
from skinnet.body.things import presented_by
from skinnet.deployment.schema import Deployment
from skinnet.skin.placement import place

__all__ = ["Shape", "shapes_of"]

Floats = NDArray[np.float64]
_KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
_VISIBLE_GROUPS = 3
"""MuJoCo's viewers show geoms of the first three groups."""


class Shape(NamedTuple):
    """One solid.

    Attributes:
        frame: Name of its body, of a loose body as on the wire, or `world`.
        kind: plane, sphere, capsule, ellipsoid, cylinder, box or mesh.
        half_m: (3,) MuJoCo's size: half of a box's edges, radius and half length of what is round [m].
        position_m: (3,) in the frame [m].
        quaternion: (4,) rotation there, (w, x, y, z).
        rgba: (4,) colour.
        corners_m: (v, 3) corners of a mesh [m]; else none.
        triangles: (f, 3) numbers of the corners of its triangles; else none.
    """

    frame: str
    kind: str
    half_m: Floats
    position_m: Floats
    quaternion: Floats
    rgba: Floats
    corners_m: Floats
    triangles: NDArray[np.int64]


def shapes_of(deployment: Deployment, base_dir: Path) -> list[Shape]:
    """All visible shapes of the model of `deployment`.

    Raises:
        ModelError: the model does not compile or lacks what the deployment names.
        DeploymentError: there is no such model.
    """
    teacher = deployment.teacher
    patches = [place(patch, deployment.cells) for patch in deployment.patches]
    mj = load_model(
        deployment.body,
        base_dir,
        teacher.tip_radius_m,
        teacher.temperature_c,
        deployment.payload,
        presented_by(deployment),
        patches,
    ).mj
    names = {body: name for name, body in LOOSE.items()} | {"world": WORLD}
    shapes = []
    for geom in range(mj.ngeom):
        kind = _KINDS.get(mujoco.mjtGeom(mj.geom_type[geom]))
        if kind is None or mj.geom_group[geom] >= _VISIBLE_GROUPS or mj.geom_rgba[geom, 3] == 0.0:
            continue
        body = int(mj.geom_bodyid[geom])
        name = mj.body(body).name or f"body{body}"
        shapes.append(
            Shape(
                names.get(name, name),
                kind,
                mj.geom_size[geom].copy(),
                mj.geom_pos[geom].copy(),
                mj.geom_quat[geom].copy(),
                mj.geom_rgba[geom].astype(np.float64),
                *_mesh(mj, int(mj.geom_dataid[geom]) if kind == "mesh" else -1),
            )
        )
    return shapes


def _mesh(mj: mujoco.MjModel, mesh: int) -> tuple[Floats, NDArray[np.int64]]:
    """Corners and triangles of a mesh; none for −1."""
    if mesh < 0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    first, n = int(mj.mesh_vertadr[mesh]), int(mj.mesh_vertnum[mesh])
    face, m = int(mj.mesh_faceadr[mesh]), int(mj.mesh_facenum[mesh])
    corners_m = mj.mesh_vert[first : first + n].astype(np.float64)
    return corners_m, mj.mesh_face[face : face + m].astype(np.int64)
