"""Off-screen rendering of the body, its skin coloured by one value per cell or element.

`render_body` renders in a process of its own (`offscreen`): this module with a request on standard input.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import matplotlib.image
import msgspec
import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import added_id, builtin_defaults, unused_name
from skinnet.body.contact.skin_surface import hexagon_m
from skinnet.body.environment.stand_model import OBJECT, STAND, place_object
from skinnet.body.model import PAYLOAD, build_mj_spec
from skinnet.body.offscreen import run_renderer
from skinnet.body.shown_geoms import shown_geoms
from skinnet.body.simulation import BodySimulation
from skinnet.deployment.deployment import Deployment
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["render_body"]

_CELL_THICKNESS_M = 0.003
_CELL_SCALE = 0.93
"""Scale of drawn cells, so that gaps show their edges."""
_FOAM_RGBA = (0.12, 0.12, 0.14, 1.0)
_SHEET_FOAM_RGBA = (0.50, 0.66, 0.68, 1.0)
_COLOUR_MAP = "turbo"
_AMBIENT_RGB, _HEADLIGHT_RGB, _LIGHT_RGB = [0.35] * 3, [0.35] * 3, [0.4] * 3
_SKY_RGB = [0.95] * 3, [0.75] * 3
_LIGHT_DIRECTION = (-0.5, 0.3, -0.8)
_HIDDEN_GROUP = 5
"""Geom group that MuJoCo does not draw."""


class _RenderRequest(msgspec.Struct, kw_only=True):
    deployment: Deployment
    base_dir: str
    out: str
    values: list[float]
    position_rad: list[float] | None = None
    object_pose: list[float] | None = None
    stand_top_m: float | None = None
    width: int
    height: int


def render_body(
    deployment: Deployment,
    base_dir: Path,
    out: Path,
    values: Sequence[float],
    position_rad: Sequence[float] | None = None,
    object_pose: Sequence[float] | None = None,
    stand_top_m: float | None = None,
    size: tuple[int, int] = (1280, 960),
) -> tuple[Path | None, str]:
    """Render the body with its cells and the elements of its sheets to a PNG file.

    Args:
        deployment: The deployment to render.
        base_dir: Folder that `body.model` is relative to.
        out: PNG file to write.
        values: One value in 0…1 for each cell, in the order of the stimulus, then for each element, in the
            order of the sheets; blue to red. Missing values are zero.
        position_rad: (D,) positions of the controlled joints [rad]; None: as at the start of a run.
        object_pose: (7,) position [m] and quaternion (w, x, y, z) of object or payload; None: at the start.
        stand_top_m: Height of the stand's top [m]; None: as at the start of a run.
        size: Width and height in pixels.

    Returns:
        The file and "", or None and the reason why rendering failed on this computer.
    """
    request = _RenderRequest(
        deployment=deployment,
        base_dir=str(base_dir),
        out=str(out),
        values=[float(value) for value in values],
        position_rad=None if position_rad is None else [float(angle) for angle in position_rad],
        object_pose=None if object_pose is None else [float(number) for number in object_pose],
        stand_top_m=stand_top_m,
        width=size[0],
        height=size[1],
    )
    return run_renderer(__spec__.name, msgspec.json.encode(request), out)


def _render(request: _RenderRequest) -> None:
    deployment, base_dir = request.deployment, Path(request.base_dir)
    body = BodySimulation(deployment, base_dir)
    presented = place_object(deployment)
    spec = build_mj_spec(deployment, base_dir)
    colours = _colours(np.array(request.values), body.n_cells + body.n_elements)
    thickness_m = deployment.body.foam.thickness_m
    if deployment.patches:
        patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
        _add_cells(spec, patches, deployment.cells.side_m, thickness_m, colours[: body.n_cells])
    _add_elements(spec, body.sheets, thickness_m, colours[body.n_cells :])
    spec.visual.global_.offwidth = request.width
    spec.visual.global_.offheight = request.height
    _light(spec)
    model = spec.compile()
    _show_once(model, body.model.mj)
    data = mujoco.MjData(model)
    data.qpos[:] = body.data.qpos
    if request.position_rad is not None:
        data.qpos[body.model.qpos_address] = request.position_rad
        body.model.follow(data.qpos)
    if request.stand_top_m is not None and presented is not None:
        data.qpos[model.joint(added_id(model, mujoco.mjtObj.mjOBJ_JOINT, STAND)).qposadr[0]] = (
            request.stand_top_m - presented.start_top_m
        )
    if request.object_pose is not None:
        _place_object(model, data, request.object_pose)
    data.mocap_pos[:] = body.data.mocap_pos
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    with mujoco.Renderer(model, request.height, request.width, max_geom=20 * model.ngeom) as renderer:
        renderer.update_scene(data, camera)
        matplotlib.image.imsave(request.out, renderer.render())


def _light(spec: mujoco.MjSpec) -> None:
    """Light a model that has no light of its own, without shadows, before a bright sky if it has none."""
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        sky = spec.add_texture(name=unused_name("sky", {texture.name for texture in spec.textures}))
        sky.type, sky.builtin = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
        sky.rgb1, sky.rgb2, sky.width, sky.height = *_SKY_RGB, 64, 64
    if spec.lights:
        return
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = _AMBIENT_RGB, _HEADLIGHT_RGB
    light = spec.worldbody.add_light(builtin_defaults(spec), dir=_LIGHT_DIRECTION, castshadow=False)
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.diffuse = _LIGHT_RGB


def _show_once(model: mujoco.MjModel, robot: mujoco.MjModel) -> None:
    """Hide geoms of the drawn `model` that `shown_geoms` leaves out of `robot`, the model without cells.

    Cells come last among the geoms of their body.
    """
    shown = shown_geoms(robot)
    for body in range(robot.nbody):
        first, count = int(robot.body_geomadr[body]), int(robot.body_geomnum[body])
        drawn = int(model.body_geomadr[body]) + np.arange(count)
        model.geom_group[drawn] = np.where(shown[first : first + count], 0, _HIDDEN_GROUP)


def _place_object(model: mujoco.MjModel, data: mujoco.MjData, pose: list[float]) -> None:
    """Set the pose (7,) of the free object and of the payload; an object fixed to the stand stays."""
    for name in (OBJECT, PAYLOAD):
        joint = added_id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if joint >= 0:
            address = int(model.jnt_qposadr[joint])
            data.qpos[address : address + 7] = pose


def _colours(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    filled = np.zeros(count)
    filled[: len(values)] = np.clip(values, 0.0, 1.0)
    colours: NDArray[np.float64] = matplotlib.colormaps[_COLOUR_MAP](0.06 + 0.88 * filled)
    return colours


def _add_cells(
    spec: mujoco.MjSpec,
    patches: list[PlacedPatch],
    side_m: float,
    thickness_m: float,
    colours: NDArray[np.float64],
) -> None:
    """Add every cell as two visual prisms: the foam, and on it the cell in its colour."""
    _add_prism(spec, "skin_foam", _CELL_SCALE * side_m, thickness_m - _CELL_THICKNESS_M)
    _add_prism(spec, "skin_cell", _CELL_SCALE * side_m, _CELL_THICKNESS_M)
    plain, row = builtin_defaults(spec), 0
    for patch in patches:
        owner = spec.body(patch.body)
        for position_m, R_body_cell in zip(patch.position_m, patch.R_body_cell, strict=True):
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, R_body_cell.ravel())
            lift_m = (thickness_m - _CELL_THICKNESS_M) * R_body_cell[:, 2]
            for mesh, at_m, rgba in (
                ("skin_foam", position_m, _FOAM_RGBA),
                ("skin_cell", position_m + lift_m, colours[row]),
            ):
                owner.add_geom(
                    plain,
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=mesh,
                    pos=at_m,
                    quat=quaternion,
                    rgba=rgba,
                    contype=0,
                    conaffinity=0,
                    density=0.0,
                )
            row += 1


def _add_elements(
    spec: mujoco.MjSpec, sheets: Sequence[PlacedSheet], thickness_m: float, colours: NDArray[np.float64]
) -> None:
    """Add every element as two visual blocks: its foam, wider outwards on round sides, and its face."""
    top_m = thickness_m - _CELL_THICKNESS_M
    plain, row = builtin_defaults(spec), 0
    for sheet in sheets:
        surface, half_m = sheet.surface, 0.5 * _CELL_SCALE * math.sqrt(sheet.area_m2)
        for name, radius_m in (("flat", math.inf), ("round", surface.radius_m)):
            for part, low_m, high_m in (("foam", 0.0, top_m), ("face", top_m, thickness_m)):
                _add_block(spec, f"{sheet.name}_{name}_{part}", half_m, radius_m, low_m, high_m)
        owner = spec.body(surface.body)
        for xi_m, position_m, R_body_element in zip(
            sheet.xi_m, sheet.position_m, sheet.R_body_element, strict=True
        ):
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, R_body_element.ravel())
            shape = "flat" if abs(xi_m[0]) <= surface.flat_half_width_m else "round"
            for part, rgba in (("foam", _SHEET_FOAM_RGBA), ("face", colours[row])):
                owner.add_geom(
                    plain,
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=f"{sheet.name}_{shape}_{part}",
                    pos=position_m,
                    quat=quaternion,
                    rgba=rgba,
                    contype=0,
                    conaffinity=0,
                    density=0.0,
                )
            row += 1


def _add_block(
    spec: mujoco.MjSpec, name: str, half_m: float, radius_m: float, low_m: float, high_m: float
) -> None:
    """Add a block mesh over a square of 2 × `half_m` between two heights; radius of curvature `radius_m`."""
    vertices = [
        [x * half_m * (1.0 + z / radius_m), y * half_m, z]
        for z in (low_m, high_m)
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    spec.add_mesh(name=name, uservert=np.array(vertices).ravel())


def _add_prism(spec: mujoco.MjSpec, name: str, side_m: float, height_m: float) -> None:
    rim = hexagon_m(side_m)
    vertices = [[x, y, z] for z in (0.0, height_m) for x, y in rim]
    spec.add_mesh(name=name, uservert=np.array(vertices).ravel())


if __name__ == "__main__":
    _render(msgspec.json.decode(sys.stdin.buffer.read(), type=_RenderRequest))
