"""Off-screen rendering of coloured triangle meshes from several sides, with a light of its own."""

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.image
import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.offscreen import run_renderer

__all__ = ["ColouredMesh", "View", "render_meshes"]

_FIELD_OF_VIEW_DEG = 35.0
_MARGIN = 1.06
"""Distance of the camera, in distances at which the sphere fills the picture."""
_BACKGROUND = (0.97, 0.97, 0.98)


class ColouredMesh(NamedTuple):
    """Mesh to draw: vertices (v, 3) [m] and faces (f, 3), world, with one colour, 0 to 255."""

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    rgb: tuple[int, int, int]


class View(NamedTuple):
    """Direction of view: azimuth of the camera's heading and its elevation, negative from above [°]."""

    azimuth_deg: float
    elevation_deg: float


class _Mesh(msgspec.Struct):
    vertices: bytes
    faces: bytes
    rgb: tuple[int, int, int]


class _Request(msgspec.Struct):
    meshes: list[_Mesh]
    views: list[tuple[float, float]]
    columns: int
    centre_m: tuple[float, float, float]
    radius_m: float
    width: int
    height: int
    out: str


def render_meshes(
    meshes: Sequence[ColouredMesh],
    out: Path,
    views: Sequence[View],
    columns: int,
    sphere_m: tuple[tuple[float, float, float], float],
    size: tuple[int, int] = (640, 560),
) -> tuple[Path | None, str]:
    """Render meshes from several sides into one PNG file, in rows of `columns` views.

    Args:
        meshes: Meshes to draw.
        out: PNG file to write.
        views: Directions of view, a whole number of rows.
        columns: Views in a row.
        sphere_m: Centre (3,) and radius of what is to be seen [m].
        size: Width and height of a view in pixels.

    Returns:
        The file and "", or None and the reason why rendering failed on this computer.
    """
    request = _Request(
        meshes=[
            _Mesh(
                mesh.vertices_m.astype(np.float32).tobytes(), mesh.faces.astype(np.int32).tobytes(), mesh.rgb
            )
            for mesh in meshes
        ],
        views=[(view.azimuth_deg, view.elevation_deg) for view in views],
        columns=columns,
        centre_m=sphere_m[0],
        radius_m=sphere_m[1],
        width=size[0],
        height=size[1],
        out=str(out),
    )
    return run_renderer(__spec__.name, msgspec.msgpack.encode(request), out)


def _render(request: _Request) -> None:
    model = _scene(request).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = request.centre_m
    camera.distance = _MARGIN * request.radius_m / math.sin(math.radians(0.5 * _FIELD_OF_VIEW_DEG))
    pictures = []
    with mujoco.Renderer(model, request.height, request.width) as renderer:
        for camera.azimuth, camera.elevation in request.views:
            renderer.update_scene(data, camera)
            pictures.append(renderer.render().copy())
    rows = [np.hstack(pictures[i : i + request.columns]) for i in range(0, len(pictures), request.columns)]
    matplotlib.image.imsave(request.out, np.vstack(rows))


def _scene(request: _Request) -> mujoco.MjSpec:
    """Build a world of the meshes alone, with lights that follow the camera and one from above."""
    spec = mujoco.MjSpec()
    spec.stat.extent = request.radius_m
    view = spec.visual
    view.global_.fovy = _FIELD_OF_VIEW_DEG
    view.global_.offwidth, view.global_.offheight = request.width, request.height
    view.headlight.ambient, view.headlight.diffuse = [0.35] * 3, [0.45] * 3
    view.headlight.specular = [0.0] * 3
    view.map.znear, view.map.zfar = 0.01, 50.0
    light = spec.worldbody.add_light(pos=[0, 0, 10], dir=[0.3, 0.2, -1], castshadow=False)
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse = [0.35] * 3
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=_BACKGROUND,
        rgb2=_BACKGROUND,
        width=16,
        height=16,
    )
    for number, mesh in enumerate(request.meshes):
        name = f"mesh{number}"
        added = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        added.uservert = np.frombuffer(mesh.vertices, dtype=np.float32)
        added.userface = np.frombuffer(mesh.faces, dtype=np.int32)
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            rgba=[*(part / 255.0 for part in mesh.rgb), 1.0],
            contype=0,
            conaffinity=0,
            mass=0.0,
        )
    return spec


if __name__ == "__main__":
    _render(msgspec.msgpack.decode(sys.stdin.buffer.read(), type=_Request))
