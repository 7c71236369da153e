"""Covers made into patches and bridges, link by link."""

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.covering.covering_metrics import CellFigures, cell_figures, covering_metrics
from skinnet.covering.covering_patches import bridges_between, component_patches, patch_name
from skinnet.covering.felt_solids import (
    Link,
    Model,
    body_names,
    felt_geoms,
    link_of_body,
    relative_pose,
)
from skinnet.covering.link_covering import CellSize, LinkGround, cover_ground, largest_side_m, prepare_ground
from skinnet.covering.measured_layouts import Layout, cells_of_layout
from skinnet.deployment import Deployment
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.covers import CoverSpec
from skinnet.deployment.skin.patches import PatchSpec
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import pitch_m
from skinnet.skin.placement import PlacedPatch, place_patch
from skinnet.suggestions import known_names

__all__ = ["Covering", "check_covers", "cover_links", "why_no_cell"]

Floats = NDArray[np.float64]

_NOT_FELT = "no geom of it can be felt (contype and conaffinity are 0, or it has none)"
_ALL_REACHED = "other links reach all of the surface asked for; clearance = false covers it all the same"
_LARGEST_PITCH_FRACTION = 1.1
"""Greatest pitch as a fraction of the cell's own: beyond, wires do not reach the neighbours."""


class Covering(msgspec.Struct, frozen=True, kw_only=True):
    """Covering of a deployment: what its covers have become.

    Attributes:
        patches: Patches of all covers.
        bridges: Bridges between them.
        links: Metrics of each link, with the names of cover, body and patches.
        total: Metrics of all links together.
        cpu_s: CPU time that it took to place and measure the cells [s].
        bare: Links that a pattern names and that took no cell, as "cover: body: why".
    """

    patches: tuple[PatchSpec, ...] = ()
    bridges: tuple[BridgeSpec, ...] = ()
    links: tuple[dict[str, Any], ...] = ()
    total: dict[str, Any] = {}
    cpu_s: float = 0.0
    bare: tuple[str, ...] = ()


@dataclass
class _LinkSkin:
    """Skin of one link so far: its patches, each with the pose of its body in the frame of the link's."""

    link: Link
    patches: list[PlacedPatch] = field(default_factory=list)
    poses: list[tuple[Floats, Floats]] = field(default_factory=list)
    n_explicit: int = 0

    def cells_in(self, R: Floats, t: Floats) -> tuple[Floats, Floats]:
        """Positions and rotations of all cells in a frame with pose R, t in that of the link's body."""
        positions, rotations = [np.zeros((0, 3))], [np.zeros((0, 3, 3))]
        for patch, (R_patch, t_patch) in zip(self.patches, self.poses, strict=True):
            at_m = np.einsum("ij,nj->ni", R_patch, patch.position_m) + t_patch
            positions.append(np.einsum("ji,nj->ni", R, at_m - t))
            rotations.append(np.einsum("ji,jk,nkl->nil", R, R_patch, patch.R_body_cell))
        return np.concatenate(positions), np.ascontiguousarray(np.concatenate(rotations))


def check_covers(deployment: Deployment) -> None:
    """Check names and pitches of covers.

    Raises:
        DeploymentError: a name is given twice, or cells would overlap or lie too far apart for wires.
    """
    names: list[str] = []
    own_m = pitch_m(deployment.cells.side_m)
    for cover in deployment.cover:
        if cover.name in names:
            raise DeploymentError(f"cover: duplicate name {cover.name}; names must be unique")
        names.append(cover.name)
        given_m = cover.pitch_m
        if given_m is None:
            continue
        most_m = _LARGEST_PITCH_FRACTION * own_m
        if given_m < own_m * (1.0 - 1e-6):
            raise DeploymentError(
                f"cover.{cover.name}.pitch_m = {given_m:g}: cells would overlap, as their own pitch is "
                f"{own_m:.4f} m (√3 × cells.side_m); give {own_m:.4f} to {most_m:.4f}, or smaller cells"
            )
        if given_m > most_m:
            raise DeploymentError(
                f"cover.{cover.name}.pitch_m = {given_m:g}: wires would not reach; give {own_m:.4f} to "
                f"{most_m:.4f} for cells of side {deployment.cells.side_m:g} m"
            )


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
    cells, side_m = deployment.cells, deployment.cells.side_m
    skins: dict[tuple[int, ...], _LinkSkin] = {}
    for explicit in deployment.patches:
        if explicit.body in body_names(mj):
            link = link_of_body(mj, body_names(mj)[explicit.body])
            _add(mj, skins, link, place_patch(explicit, cells)).n_explicit += 1
    patches: list[PatchSpec] = []
    taken: list[tuple[CoverSpec, LinkGround, list[PatchSpec]]] = []
    bare: list[str] = []
    for cover in deployment.cover:
        took = 0
        size = CellSize(side_m, cover.pitch_m or pitch_m(side_m), deployment.body.foam.thickness_m)
        links = list(_links(mj, cover))
        for body, link in links:
            skin = _add(mj, skins, link, None)
            fixed = skin.cells_in(*relative_pose(mj, skin.link.body_id, link.body_id))
            found = _cover_link(mj, cover, body, link, size, fixed, home_qpos, layouts.get(cover.name))
            if isinstance(found, str):
                if not _is_pattern(cover):
                    raise DeploymentError(f'cover.{cover.name}.body = "{body}": {found}')
                bare.append(f"{cover.name}: {body}: {found}")
                continue
            ground, position_m, R = found
            label = (cover.name, body) if len(links) > 1 else (cover.name,)
            own = component_patches(patch_name(*label), body, position_m, R, cells, cover.min_component)
            if not own:
                reason = f"no component of the wiring has {cover.min_component} cells (min_component)"
                if not _is_pattern(cover):
                    raise DeploymentError(f'cover.{cover.name}.body = "{body}": {reason}')
                bare.append(f"{cover.name}: {body}: {reason}")
                continue
            took += 1
            for patch in own:
                _add(mj, skins, link, place_patch(patch, cells))
            patches += own
            taken.append((cover, ground, own))
        if not took:
            first = next((line for line in bare if line.startswith(f"{cover.name}: ")), "")
            raise DeploymentError(
                f'cover.{cover.name}.body = "{cover.body}": none of the {len(links)} links takes a cell; '
                f"{first.removeprefix(f'{cover.name}: ')}"
            )
    bridges = [
        bridge
        for skin in skins.values()
        for bridge in bridges_between(skin.patches[skin.n_explicit :], skin.poses[skin.n_explicit :], side_m)
    ]
    measured, figures = [], []
    for cover, ground, own in taken:
        row, own_figures = _link_metrics(mj, cover, ground, own, deployment)
        measured.append(row)
        figures.append(own_figures)
    return Covering(
        patches=tuple(patches),
        bridges=tuple(bridges),
        links=tuple(measured),
        total=covering_metrics(figures, sum(row["wires"] for row in measured)),
        bare=tuple(bare),
    )


def _add(
    mj: Model, skins: dict[tuple[int, ...], _LinkSkin], link: Link, patch: PlacedPatch | None
) -> _LinkSkin:
    skin = skins.setdefault(link.members, _LinkSkin(link))
    if patch is not None:
        skin.patches.append(patch)
        skin.poses.append(relative_pose(mj, skin.link.body_id, link.body_id))
    return skin


def _is_pattern(cover: CoverSpec) -> bool:
    return isinstance(cover.body, str) and any(sign in cover.body for sign in "*?")


def _links(mj: Model, cover: CoverSpec) -> Iterator[tuple[str, Link]]:
    """Links that a cover names, each once, with the name of its body that comes first."""
    known = body_names(mj)
    names: Sequence[str] = (cover.body,) if isinstance(cover.body, str) else cover.body
    if _is_pattern(cover):
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
    size: CellSize,
    fixed: tuple[Floats, Floats],
    home_qpos: Floats,
    layout: Layout | None,
) -> tuple[LinkGround, Floats, Floats] | str:
    """Surface of a link with the positions and rotations of its cells, or why there are none."""
    if not felt_geoms(mj, link.members):
        return _NOT_FELT
    ground = prepare_ground(mj, link, body, cover, size, home_qpos)
    if layout is not None:
        return ground, *cells_of_layout(layout, size.side_m)
    if not ground.n_in_region:
        low_m, high_m = (
            getattr(ground.ground.samples.point_m, end)(axis=0).round(3).tolist() for end in ("min", "max")
        )
        return f"the region holds none of its surface, which reaches from {low_m} to {high_m} m"
    if not ground.ground.asked.any():
        return _ALL_REACHED
    made = cover_ground(ground, *fixed, cover.max_cells)
    if len(made.position_m):
        return ground, made.position_m, made.R_body_cell
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


def _link_metrics(
    mj: Model, cover: CoverSpec, of: LinkGround, patches: Sequence[PatchSpec], deployment: Deployment
) -> tuple[dict[str, Any], CellFigures]:
    placed = [place_patch(patch, deployment.cells) for patch in patches]
    n_wires = sum(len(patch.wires) for patch in placed)
    figures = cell_figures(
        mj,
        of,
        np.concatenate([patch.position_m for patch in placed]),
        np.ascontiguousarray(np.concatenate([patch.R_body_cell for patch in placed])),
        deployment.cells.side_m,
        deployment.body.foam.thickness_m,
    )
    row = {
        "cover": cover.name,
        "body": of.body,
        **covering_metrics([figures], n_wires),
        "wires": n_wires,
        "components": len(patches),
        "patches": [patch.name for patch in patches],
    }
    return row, figures
