"""Covers made into patches and bridges, link by link."""

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.covering.covering_metrics import CellFigures, covered_share_of_thick, covering_metrics
from skinnet.covering.covering_patches import bridges_between, component_patches, patch_name
from skinnet.covering.felt_solids import (
    Link,
    Model,
    body_names,
    felt_geoms,
    link_of_body,
    relative_pose,
)
from skinnet.covering.layout_sheets import sheets_of_layout
from skinnet.covering.link_covering import CellSize, LinkGround, cover_ground, largest_side_m, prepare_ground
from skinnet.covering.link_rows import patch_row, sheet_row
from skinnet.covering.link_sheets import element_size, largest_sheet_pitch_m, lay_sheets
from skinnet.covering.measured_layouts import Layout, cells_of_layout
from skinnet.covering.sheet_fit import SheetPose
from skinnet.deployment import Deployment
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import pitch_m
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.skin.tactile_sheets import place_sheets
from skinnet.suggestions import known_names

__all__ = ["Covering", "cover_links", "why_no_cell"]

Floats = NDArray[np.float64]

_NOT_FELT = "no geom of it can be felt (contype and conaffinity are 0, or it has none)"
_ALL_REACHED = "other links reach all of the surface asked for; clearance = false covers it all the same"


class Covering(msgspec.Struct, frozen=True, kw_only=True):
    """Covering of a deployment: what its covers have become.

    Attributes:
        patches: Patches of all covers.
        bridges: Bridges between them.
        surfaces: Surfaces of tactile sheets, one for each.
        sheets: Tactile sheets of all covers.
        links: Metrics of each link, with the names of cover, body and patches.
        total: Metrics of all links together.
        cpu_s: CPU time that it took to place and measure the cells [s].
        bare: Links that a pattern names and that took no cell, as "cover: body: why".
    """

    patches: tuple[PatchSpec, ...] = ()
    bridges: tuple[BridgeSpec, ...] = ()
    surfaces: tuple[SurfaceSpec, ...] = ()
    sheets: tuple[SheetSpec, ...] = ()
    links: tuple[dict[str, Any], ...] = ()
    total: dict[str, Any] = {}
    cpu_s: float = 0.0
    bare: tuple[str, ...] = ()


@dataclass
class _LinkSkin:
    """Skin of one link so far.

    Attributes:
        link: The link.
        patches: Its patches.
        poses: Pose of the body of each patch in the frame of the link's.
        n_explicit: Number of patches that no cover made.
        sheets: Positions and rotations of the elements of each sheet, with the pose of its body.
    """

    link: Link
    patches: list[PlacedPatch] = field(default_factory=list)
    poses: list[tuple[Floats, Floats]] = field(default_factory=list)
    n_explicit: int = 0
    sheets: list[tuple[Floats, Floats, tuple[Floats, Floats]]] = field(default_factory=list)

    def cells_in(self, R: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Positions and rotations of cells and elements in a frame with pose R, t in the link body's."""
        positions, rotations = [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
        of_patches = (
            (patch.position_m, patch.R_body_cell, pose)
            for patch, pose in zip(self.patches, self.poses, strict=True)
        )
        for position_m, R_own, (R_body, t_body) in (*of_patches, *self.sheets):
            at_m = np.einsum("ij,nj->ni", R_body, position_m) + t_body
            positions.append(np.einsum("ji,nj->ni", R, at_m - t))
            rotations.append(np.einsum("ji,jk,nkl->nil", R, R_body, R_own))
        return np.concatenate(positions), np.ascontiguousarray(np.concatenate(rotations))


@dataclass(frozen=True)
class _Made:
    """Patches or sheets that a cover has made on one link."""

    ground: LinkGround
    patches: list[PatchSpec]
    sheets: list[SheetPose]


def cover_links(
    deployment: Deployment, mj: Model, layouts: Mapping[str, Layout], home_qpos: Floats
) -> Covering:
    """Cover the links of `mj` as the deployment's covers ask, still without gateways.

    Args:
        deployment: The deployment.
        mj: Model of its robot.
        layouts: Measured layouts, by cover.
        home_qpos: (nq,) home posture.

    Raises:
        DeploymentError: a cover names no body, asks for no surface, or its cells do not fit.
    """
    side_m, foam_m = deployment.cells.side_m, deployment.body.foam.thickness_m
    skins = _explicit_skins(deployment, mj)
    patches: list[PatchSpec] = []
    sheets: list[SheetPose] = []
    rows: list[dict[str, Any]] = []
    figures: list[CellFigures] = []
    bare: list[str] = []
    for cover in deployment.cover:
        left_out: list[str] = []
        links = list(_links(mj, cover))
        for body, link in links:
            skin = _add(mj, skins, link, None)
            fixed = skin.cells_in(*relative_pose(mj, skin.link.body_id, link.body_id))
            label = (cover.name, body) if len(links) > 1 else (cover.name,)
            layout = layouts.get(cover.name)
            found = _cover_link(mj, cover, body, link, deployment, fixed, layout, label, home_qpos)
            if isinstance(found, str):
                if not cover.is_pattern:
                    raise DeploymentError(f'cover.{cover.name}.body = "{body}": {found}')
                left_out.append(f"{body}: {found}")
                continue
            placed = [place_patch(patch, deployment.cells) for patch in found.patches]
            for patch in placed:
                _add(mj, skins, link, patch)
            patches += found.patches
            for pose in found.sheets:
                _add_sheet(mj, skins, link, pose.position_m, pose.R_body_element)
            sheets += found.sheets
            row, own = (
                sheet_row(mj, found.ground, found.sheets, foam_m)
                if found.sheets
                else patch_row(mj, found.ground, placed, side_m, foam_m)
            )
            rows.append({"cover": cover.name, "body": body, **row})
            figures.append(own)
        if len(left_out) == len(links):
            what = "sheet" if cover.kind == "sheet" else "cell"
            raise DeploymentError(
                f'cover.{cover.name}.body = "{cover.body}": none of the {len(links)} links takes a {what}; '
                f"{left_out[0]}"
            )
        bare += [f"{cover.name}: {line}" for line in left_out]
    bridges = [
        bridge
        for skin in skins.values()
        for bridge in bridges_between(skin.patches[skin.n_explicit :], skin.poses[skin.n_explicit :], side_m)
    ]
    return Covering(
        patches=tuple(patches),
        bridges=tuple(bridges),
        surfaces=tuple(pose.surface for pose in sheets),
        sheets=tuple(pose.sheet for pose in sheets),
        links=tuple(rows),
        total=covering_metrics(figures, sum(row["wires"] for row in rows))
        | {"within_0_6_pitch_thick": covered_share_of_thick(figures)},
        bare=tuple(bare),
    )


def _explicit_skins(deployment: Deployment, mj: Model) -> dict[tuple[int, ...], _LinkSkin]:
    """Skin of links that the deployment gives cell by cell and sheet by sheet."""
    skins: dict[tuple[int, ...], _LinkSkin] = {}
    known = body_names(mj)
    for patch in deployment.patches:
        if patch.body in known:
            link = link_of_body(mj, known[patch.body])
            _add(mj, skins, link, place_patch(patch, deployment.cells)).n_explicit += 1
    for sheet in place_sheets(deployment.surfaces, deployment.sheets):
        if sheet.surface.body in known:
            link = link_of_body(mj, known[sheet.surface.body])
            _add_sheet(mj, skins, link, sheet.position_m, sheet.R_body_element)
    return skins


def _add(
    mj: Model, skins: dict[tuple[int, ...], _LinkSkin], link: Link, patch: PlacedPatch | None
) -> _LinkSkin:
    skin = skins.setdefault(link.members, _LinkSkin(link))
    if patch is not None:
        skin.patches.append(patch)
        skin.poses.append(relative_pose(mj, skin.link.body_id, link.body_id))
    return skin


def _add_sheet(
    mj: Model, skins: dict[tuple[int, ...], _LinkSkin], link: Link, position_m: Floats, R: Floats
) -> None:
    skin = _add(mj, skins, link, None)
    skin.sheets.append((position_m, R, relative_pose(mj, skin.link.body_id, link.body_id)))


def _links(mj: Model, cover: CoverSpec) -> Iterator[tuple[str, Link]]:
    """Links that a cover names, each once, with the name of its body that comes first."""
    known = body_names(mj)
    names: Sequence[str] = (cover.body,) if isinstance(cover.body, str) else cover.body
    if cover.is_pattern:
        names = [name for name in known if fnmatch.fnmatchcase(name, str(cover.body))]
        if not names:
            raise DeploymentError(
                f'cover.{cover.name}.body = "{cover.body}": matches no body; the model has {", ".join(known)}'
            )
    seen = set()
    for name in names:
        if name not in known:
            raise DeploymentError(
                f'cover.{cover.name}.body = "{name}": the model has no such body; {known_names(name, known)}'
            )
        link = link_of_body(mj, known[name])
        if link.members not in seen:
            seen.add(link.members)
            yield name, link


def _cover_link(
    mj: Model,
    cover: CoverSpec,
    body: str,
    link: Link,
    deployment: Deployment,
    fixed: tuple[Floats, Floats],
    layout: Layout | None,
    label: Sequence[str],
    home_qpos: Floats,
) -> _Made | str:
    """Patches or sheets of a link, named by `label`, or why there are none."""
    if not felt_geoms(mj, link.members):
        return _NOT_FELT
    side_m, foam_m = deployment.cells.side_m, deployment.body.foam.thickness_m
    of_sheets, measured = cover.kind == "sheet", None
    if of_sheets and layout is not None:
        measured = sheets_of_layout(layout, patch_name(*label), body)
    if of_sheets:
        pitch = min(pose.pitch_m for pose in measured) if measured else cover.pitch_m
        size = element_size(pitch or SheetSpec(name="s", surface="s").pitch_m, foam_m)
    else:
        size = CellSize(side_m, cover.pitch_m or pitch_m(side_m), foam_m)
    ground = prepare_ground(mj, link, body, cover, size, home_qpos)
    if measured:
        return _Made(ground, [], measured)
    if layout is not None:
        return _patches(ground, cells_of_layout(layout, side_m), cover, deployment, label)
    if not ground.n_in_region:
        low_m, high_m = (
            getattr(ground.ground.samples.point_m, end)(axis=0).round(3).tolist() for end in ("min", "max")
        )
        return f"the region holds none of its surface, which reaches from {low_m} to {high_m} m"
    if not ground.ground.asked.any():
        return _ALL_REACHED
    if of_sheets:
        sheets = lay_sheets(ground, size.pitch_m, fixed[0], fixed[1][:, :, 2], side_m, patch_name(*label))
        return _Made(ground, [], sheets) if sheets else _no_sheet(mj, link, body, cover, size, home_qpos)
    made = cover_ground(ground, *fixed, cover.max_cells)
    if len(made.position_m):
        return _patches(ground, (made.position_m, made.R_body_cell), cover, deployment, label)
    least_m = largest_side_m(mj, link, body, cover, size, home_qpos)
    hint = (
        "nor does one much smaller"
        if least_m is None
        else f"one of {1e3 * least_m:.1f} mm does (cells.side_m)"
    )
    return f"no cell of side {1e3 * size.side_m:g} mm fits on the surface asked for; {hint}"


def why_no_cell(
    mj: Model, link: Link, body: str, cover: CoverSpec, side_m: float, foam_m: float, home_qpos: Floats
) -> str:
    """Why a link takes no cell of a side [m] on foam of a thickness [m]; empty if it takes one."""
    if not felt_geoms(mj, link.members):
        return _NOT_FELT
    size = CellSize(side_m, cover.pitch_m or pitch_m(side_m), foam_m)
    ground = prepare_ground(mj, link, body, cover, size, home_qpos)
    if not ground.ground.asked.any():
        return _ALL_REACHED
    if len(cover_ground(ground, np.zeros((0, 3)), np.zeros((0, 3, 3)), 1).position_m):
        return ""
    return f"no cell of side {1e3 * side_m:g} mm fits"


def _patches(
    ground: LinkGround,
    cells: tuple[Floats, Floats],
    cover: CoverSpec,
    deployment: Deployment,
    label: Sequence[str],
) -> _Made | str:
    """Patches of cells, or why all of them are too small."""
    own = component_patches(patch_name(*label), ground.body, *cells, deployment.cells, cover.min_component)
    return (
        _Made(ground, own, [])
        if own
        else f"no component of the wiring has {cover.min_component} cells (min_component)"
    )


def _no_sheet(mj: Model, link: Link, body: str, cover: CoverSpec, size: CellSize, home_qpos: Floats) -> str:
    largest_m = largest_sheet_pitch_m(mj, link, body, cover, size, home_qpos)
    hint = (
        "nor does one much smaller"
        if largest_m is None
        else f"one of {1e3 * largest_m:.1f} mm does (cover.{cover.name}.pitch_m)"
    )
    size_mm = 1e3 * size.pitch_m
    return f"no sheet of 8 × 8 elements at a pitch of {size_mm:g} mm fits on the surface asked for; {hint}"
