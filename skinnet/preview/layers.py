"""Layers of a preview: body, cells by their state, wires, ports, gateways and normals as coloured meshes."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.body.visual_shapes import Pose, VisualModel
from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Code, Finding
from skinnet.preview.marks import diamonds, instances, polylines
from skinnet.skin.lattice import N_PORTS, PORT_ANGLES_RAD, pitch_m
from skinnet.skin.placement import place_patch, resolve_bridges
from skinnet.skin.tactile_sheets import place_sheets
from skinnet.skin.whole_skin import WholeSkin, join_patches
from skinnet.view.page.triangle_meshes import (
    TriangleMesh,
    concatenate,
    hexagonal_prism,
    hull_mesh,
    shape_mesh,
    square_plate,
)

__all__ = ["Layer", "preview_layers"]

Floats = NDArray[np.float64]
Rgb = tuple[int, int, int]

_FAULTS: dict[Code, tuple[str, Rgb]] = {
    "cells_buried": ("cells buried", (110, 0, 10)),
    "cells_off_surface": ("cells off the surface", (255, 120, 60)),
    "cells_overlap": ("cells overlapping", (205, 25, 125)),
    "cells_pressed": ("cells pressed at rest", (230, 20, 20)),
    "cells_unreached": ("cells without a gateway", (255, 150, 165)),
}
"""Names and colours of faulty cells; of several faults of a cell, the first one is drawn."""
_BODY_RGB, _FELT_RGB = (200, 203, 208), (170, 180, 205)
_CELL_RGB, _ELEMENT_RGB = (48, 118, 158), (52, 130, 120)
_WIRE_RGB, _BRIDGE_RGB, _PORT_RGB = (235, 190, 60), (250, 130, 20), (245, 245, 245)
_GATEWAY_RGB, _NORMAL_RGB = (40, 170, 70), (120, 190, 235)
_DRAWN_SCALE = 0.93
"""Scale of drawn cells; gaps between them show their edges."""
_PLATE_M = 0.001
_NORMAL_M, _PORT_M, _GATEWAY_M, _WIRE_M = 0.012, 0.0016, 0.007, 0.0012
"""Length of normals; radii of ports, gateways and wires [m]."""
_HIDDEN_LINK = "finger"


class Layer(NamedTuple):
    """Layer of a preview: one mesh in the world, in one colour.

    Attributes:
        name: Name in the legend.
        mesh: Triangles [m], world.
        rgb: Colour, 0 to 255.
        number: Number of things in it, in the legend; 0 for none.
        is_skin: True for what belongs to the skin, False for bodies.
    """

    name: str
    mesh: TriangleMesh
    rgb: Rgb
    number: int = 0
    is_skin: bool = True


def preview_layers(
    deployment: Deployment, base_dir: Path, findings: Iterable[Finding], *, felt: bool = False
) -> list[Layer]:
    """Build the layers of a deployment's robot at home; those with nothing in them are left out.

    Args:
        deployment: The deployment, with patches in place of its covers.
        base_dir: Folder that `body.model` is relative to.
        findings: Findings, whose cells are drawn in the colours of their faults.
        felt: Draw what skin and contacts feel, meshes as their hulls, in place of what is seen.

    Raises:
        ModelError: the model does not compile or lacks something.
        DeploymentError: cells, bridges or surfaces do not fit together.
    """
    model = VisualModel(deployment, base_dir)
    poses = model.poses(model.home_rad, {})
    layers = [_body(model, poses, felt=felt)]
    if deployment.patches:
        layers += _cells(deployment, poses, findings)
    layers += _elements(deployment, poses)
    return [layer for layer in layers if len(layer.mesh.faces)]


def _body(model: VisualModel, poses: dict[str, Pose], *, felt: bool) -> Layer:
    """Bodies as they are seen, or as they are felt; links of which nothing is seen as they are felt."""
    hidden = model.free_links.get(_HIDDEN_LINK, "")
    seen = {shape.link for shape in model.shapes}
    drawn = [(shape, False) for shape in model.shapes if not felt]
    drawn += [(shape, True) for shape in model.felt_shapes if felt or shape.link not in seen]
    parts = [
        _in_world(hull_mesh(shape) if is_felt else shape_mesh(shape), poses[shape.link])
        for shape, is_felt in drawn
        if shape.link != hidden
    ]
    name, rgb = ("felt geometry", _FELT_RGB) if felt else ("bodies", _BODY_RGB)
    return Layer(name, concatenate(parts) if parts else _nothing(), rgb, is_skin=False)


def _in_world(mesh: TriangleMesh, pose: Pose) -> TriangleMesh:
    turn = Rotation.from_quat(pose.wxyz, scalar_first=True)
    return TriangleMesh(turn.apply(mesh.vertices_m) + pose.position_m, mesh.faces)


def _nothing() -> TriangleMesh:
    return TriangleMesh(np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))


class _CellPoses(NamedTuple):
    """Cells of the whole skin in the world: centres (n, 3) [m] and axes (n, 3, 3)."""

    position_m: Floats
    R_world_cell: Floats

    def points(self, rows: NDArray[np.int64], local_m: Floats) -> Floats:
        """Points (m, 3) [m] at `local_m` (m, 3) in the frames of the cells `rows` (m,)."""
        at: Floats = self.position_m[rows] + np.einsum("nij,nj->ni", self.R_world_cell[rows], local_m)
        return at


def _world_poses(skin: WholeSkin, poses: dict[str, Pose]) -> _CellPoses:
    positions, rotations = [], []
    for patch in skin.patches:
        pose = poses[patch.body]
        turn = Rotation.from_quat(pose.wxyz, scalar_first=True)
        positions.append(turn.apply(patch.position_m) + pose.position_m)
        rotations.append(np.einsum("ij,njk->nik", turn.as_matrix(), patch.R_body_cell))
    return _CellPoses(np.concatenate(positions), np.concatenate(rotations))


def _cells(deployment: Deployment, poses: dict[str, Pose], findings: Iterable[Finding]) -> list[Layer]:
    placed = tuple(place_patch(patch, deployment.cells) for patch in deployment.patches)
    skin = join_patches(placed, resolve_bridges(deployment.bridges, placed))
    cells = _world_poses(skin, poses)
    side_m, top_m = deployment.cells.side_m, deployment.body.foam.thickness_m + _PLATE_M
    prism = hexagonal_prism(_DRAWN_SCALE * side_m, top_m)
    layers = []
    for name, rgb, rows in _by_state(skin, findings):
        mesh = instances(prism, cells.position_m[rows], cells.R_world_cell[rows])
        layers.append(Layer(name, mesh, rgb, len(rows)))
    every = np.arange(skin.n_cells)
    along = np.tile([0.0, 0.0, 1.0], (skin.n_cells, 1))
    normals = np.stack([cells.points(every, height * along) for height in (top_m, top_m + _NORMAL_M)], axis=1)
    n_bridges = len(skin.bridges)
    inner = skin.wires[: len(skin.wires) - n_bridges]
    ports = np.column_stack([np.repeat(every, N_PORTS), np.tile(np.arange(N_PORTS), skin.n_cells)])
    layers += [
        Layer("normals", polylines(normals, 0.5 * _WIRE_M), _NORMAL_RGB),
        Layer("ports", diamonds(_port_points(cells, ports, side_m, top_m, 0.86), _PORT_M), _PORT_RGB),
        Layer("wires", _wires(cells, inner, side_m, top_m), _WIRE_RGB, len(inner)),
        Layer("bridges", _wires(cells, skin.bridges, side_m, top_m), _BRIDGE_RGB, n_bridges),
        Layer(
            "gateways",
            diamonds(_port_points(cells, skin.gateways, side_m, top_m + _GATEWAY_M, 1.0), _GATEWAY_M),
            _GATEWAY_RGB,
            len(skin.gateways),
        ),
    ]
    return layers


def _by_state(skin: WholeSkin, findings: Iterable[Finding]) -> list[tuple[str, Rgb, NDArray[np.int64]]]:
    """Names, colours and rows of the cells without a fault, and of those with each fault."""
    faulty: dict[Code, set[str]] = {code: set() for code in _FAULTS}
    for finding in findings:
        if finding.code in faulty:
            faulty[finding.code] |= set(finding.cells)
    names = [skin.cell_name(cell) for cell in range(skin.n_cells)]
    state = [next((code for code in _FAULTS if name in faulty[code]), None) for name in names]
    groups = [("cells", _CELL_RGB, np.array([row for row, code in enumerate(state) if code is None], int))]
    for fault, (name, rgb) in _FAULTS.items():
        groups.append((name, rgb, np.array([row for row, code in enumerate(state) if code == fault], int)))
    return groups


def _port_points(
    cells: _CellPoses, ends: NDArray[np.int64], side_m: float, height_m: float, share: float
) -> Floats:
    """Points (n, 3) [m] of ports (n, 2), rows of (cell, port), at a share of the way to the edge."""
    angles = np.array(PORT_ANGLES_RAD)[ends[:, 1]]
    out_m = 0.5 * share * pitch_m(side_m)
    local_m = np.column_stack([out_m * np.cos(angles), out_m * np.sin(angles), np.full(len(ends), height_m)])
    return cells.points(ends[:, 0], local_m)


def _wires(cells: _CellPoses, wires: NDArray[np.int64], side_m: float, top_m: float) -> TriangleMesh:
    """Wires (m, 4) as lines from cell to cell over the two ports."""
    height_m = top_m + _WIRE_M
    ends = [wires[:, :2], wires[:, 2:]]
    outer = [_port_points(cells, end, side_m, height_m, 0.86) for end in ends]
    inner = [_port_points(cells, end, side_m, height_m, 0.0) for end in ends]
    return polylines(np.stack([inner[0], outer[0], outer[1], inner[1]], axis=1), _WIRE_M)


def _elements(deployment: Deployment, poses: dict[str, Pose]) -> list[Layer]:
    parts: list[TriangleMesh] = []
    count = 0
    for sheet in place_sheets(deployment.surfaces, deployment.sheets):
        side_m = _DRAWN_SCALE * float(np.sqrt(sheet.area_m2))
        plate = square_plate(side_m, deployment.body.foam.thickness_m + _PLATE_M)
        mesh = instances(plate, sheet.position_m, sheet.R_body_element)
        parts.append(_in_world(mesh, poses[sheet.surface.body]))
        count += sheet.n_elements
    return [Layer("elements of sheets", concatenate(parts), _ELEMENT_RGB, count)] if parts else []
