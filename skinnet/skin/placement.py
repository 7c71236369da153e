"""Patch placement: cell poses on a body and the wires between facing ports."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.deployment.cell_names import parse_port
from skinnet.deployment.network import BridgeSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, LatticeSpec, PatchSpec
from skinnet.errors import DeploymentError
from skinnet.graph_components import connected_components
from skinnet.near_points import near_pairs, near_pairs_between
from skinnet.pinned_linalg import dot, matmul, norm
from skinnet.skin.lattice import N_PORTS, PORT_ANGLES_RAD, lattice_cells, lattice_plane_m, pitch_m
from skinnet.suggestions import known_names

__all__ = ["Bridge", "PlacedPatch", "place_patch", "place_patches", "resolve_bridges"]

_OVERLAP_FRACTION = 0.90
"""Overlap threshold of centres as a fraction of the pitch (a curved lattice shortens chords a little)."""
_WIRE_FRACTION = 1.15
"""Greatest length of a wire as a fraction of the pitch."""
_FACING_COSINE = pinned_math.cos(math.radians(35.0))
"""Cosine of the greatest angle between a port and a neighbour that it faces."""

_OPPOSITE_COSINE = pinned_math.cos(math.radians(170.0))
"""Cosine of the angle between normals beyond which cells of one patch lie on opposite sides of a link."""
_SAME_SIDE_COSINE = -0.5
"""Least cosine of the angle between the normals of neighbours: cells back to back share no edge."""


@dataclass(frozen=True)
class PlacedPatch:
    """Placed patch of cells on a body.

    Attributes:
        name: Name of the patch.
        body: Name of the body that carries it.
        position_m: (n, 3) centres of the cells on the rigid surface, body frame [m].
        R_body_cell: (n, 3, 3) rotations; columns are the cell's x (towards port 0), y and z (outward normal).
        wires: (m, 4) rows of (cell, port, cell, port), each full-duplex wire once.
        interfaces: (g, 2) rows of (cell, port) to which gateways are wired.
    """

    name: str
    body: str
    position_m: NDArray[np.float64]
    R_body_cell: NDArray[np.float64]
    wires: NDArray[np.int64]
    interfaces: NDArray[np.int64]

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.position_m)


@dataclass(frozen=True)
class Bridge:
    """Bridge: a wire between ports of cells of two patches."""

    a_patch: str
    a_cell: int
    a_port: int
    b_patch: str
    b_cell: int
    b_port: int


def place_patch(patch: PatchSpec, cells: CellSpec) -> PlacedPatch:
    """Place the cells of `patch` and wire the ports that face each other.

    Raises:
        DeploymentError: cells overlap, vectors are degenerate, or an interface is not a free port.
    """
    if (patch.lattice is None) == (not patch.cells):
        raise DeploymentError(f"patches.{patch.name}: give either lattice or cells")
    if patch.lattice is not None:
        position_m, rotation = _lattice_poses(patch.name, patch.lattice, cells.side_m)
    else:
        position_m, rotation = _explicit_poses(patch.name, patch.cells)
    pitch = pitch_m(cells.side_m)
    _require_no_overlap(patch.name, position_m, rotation, pitch)
    wires = _wires(position_m, rotation, pitch)
    interfaces = np.array([(i.cell, i.port) for i in patch.interfaces], dtype=np.int64).reshape(-1, 2)
    _require_free_interfaces(patch.name, len(position_m), wires, interfaces)
    return PlacedPatch(patch.name, patch.body, position_m, rotation, wires, interfaces)


def place_patches(
    patches: Iterable[PatchSpec], cells: CellSpec, bridges: Iterable[BridgeSpec] = ()
) -> tuple[PlacedPatch, ...]:
    """Place all `patches` of a robot.

    Raises:
        DeploymentError: as `place_patch` and `resolve_bridges`, or a cell has no path to an interface, or
            cells of two patches on one body overlap.
    """
    placed = tuple(place_patch(patch, cells) for patch in patches)
    if not placed:
        return ()
    _require_connected(placed, resolve_bridges(bridges, placed))
    reach = _OVERLAP_FRACTION * pitch_m(cells.side_m)
    for one, other in combinations(placed, 2):
        if one.body != other.body:
            continue
        for a, b in near_pairs_between(one.position_m, other.position_m, reach):
            if dot(one.R_body_cell[a, :, 2], other.R_body_cell[b, :, 2]) > 0.0:  # else back to back
                raise DeploymentError(
                    f"patches.{other.name}: cell {b} overlaps cell {a} of {one.name} on {one.body}"
                )
    return placed


def _unit(name: str, key: str, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    length = norm(vector)
    if not math.isfinite(length) or length < 1e-9:
        raise DeploymentError(
            f"patches.{name}.{key} = {vector.tolist()}: the vector must have a finite length above zero"
        )
    unit: NDArray[np.float64] = vector / length
    return unit


def _axes(name: str, key: str, x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the right-handed rotation with the given z, and x projected orthogonally to it."""
    across = x - z * dot(x, z)
    x_unit = _unit(name, key, across)
    return np.column_stack([x_unit, np.cross(z, x_unit), z])


def _lattice_poses(
    name: str, lattice: LatticeSpec, side_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    normal = _unit(name, "lattice.normal", np.array(lattice.normal, dtype=np.float64))
    up = np.array(lattice.up, dtype=np.float64)
    y = _unit(name, "lattice.up (it may not be parallel to normal)", up - normal * dot(up, normal))
    x = np.cross(y, normal)
    origin = np.array(lattice.origin_m, dtype=np.float64)
    plane = lattice_plane_m(lattice_cells(lattice.columns, lattice.rows), side_m)
    if lattice.radius_m is None:
        position_m = origin + plane[:, :1] * x + plane[:, 1:] * y
        rotation = np.repeat(np.column_stack([x, y, normal])[None], len(plane), axis=0)
        return position_m, rotation
    angle = plane[:, :1] / lattice.radius_m
    if np.ptp(angle) > 2 * math.pi - pitch_m(side_m) / lattice.radius_m + 1e-9:
        raise DeploymentError(
            f"patches.{name}.lattice.columns = {lattice.columns}: exceeds the circumference at a radius of "
            f"{lattice.radius_m} m; use fewer columns"
        )
    outward = pinned_math.cos_of(angle) * normal + pinned_math.sin_of(angle) * x
    position_m = origin - lattice.radius_m * normal + lattice.radius_m * outward + plane[:, 1:] * y
    sideways = pinned_math.cos_of(angle) * x - pinned_math.sin_of(angle) * normal
    rotation = np.stack([sideways, np.broadcast_to(y, sideways.shape), outward], axis=2)
    return position_m, rotation


def _explicit_poses(
    name: str, cells: tuple[CellPoseSpec, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    position_m = np.array([cell.position_m for cell in cells], dtype=np.float64)
    rotation = [
        _axes(
            name,
            f"cells[{i}].x_axis",
            np.array(cell.x_axis, dtype=np.float64),
            _unit(name, f"cells[{i}].normal", np.array(cell.normal, dtype=np.float64)),
        )
        for i, cell in enumerate(cells)
    ]
    return position_m, np.array(rotation)


def _require_no_overlap(
    name: str, position_m: NDArray[np.float64], rotation: NDArray[np.float64], pitch: float
) -> None:
    for a, b in near_pairs(position_m, _OVERLAP_FRACTION * pitch):
        if dot(rotation[a, :, 2], rotation[b, :, 2]) < _OPPOSITE_COSINE:  # back to back on a thin link
            continue
        distance = norm(position_m[a] - position_m[b])
        raise DeploymentError(
            f"patches.{name}: cells {a} and {b} overlap, their centres are {distance * 1e3:.1f} mm apart; "
            f"{pitch * 1e3:.1f} mm fit"
        )


def _wires(position_m: NDArray[np.float64], rotation: NDArray[np.float64], pitch: float) -> NDArray[np.int64]:
    """Return wires (m, 4) between ports that face each other across a shared edge, one wire a port.

    Where several neighbours face a port, it is wired to the one that lies straightest ahead of both ports.
    """
    ports = np.array([[pinned_math.cos(a), pinned_math.sin(a), 0.0] for a in PORT_ANGLES_RAD])
    candidates = []
    for a, b in near_pairs(position_m, _WIRE_FRACTION * pitch):
        if dot(rotation[a, :, 2], rotation[b, :, 2]) < _SAME_SIDE_COSINE:
            continue
        towards = position_m[b] - position_m[a]
        towards = towards / norm(towards)
        along_a = matmul(matmul(ports, rotation[a].T), towards)
        along_b = matmul(matmul(ports, rotation[b].T), -towards)
        port_a, port_b = int(np.argmax(along_a)), int(np.argmax(along_b))
        straightness = float(min(along_a[port_a], along_b[port_b]))
        if straightness > _FACING_COSINE:
            # equal up to rounding counts as equal: then the lower numbers win on every machine
            candidates.append((-round(straightness, 6), a, port_a, b, port_b))
    wires: list[tuple[int, int, int, int]] = []
    wired: set[tuple[int, int]] = set()
    for _, a, port_a, b, port_b in sorted(candidates):
        if (a, port_a) not in wired and (b, port_b) not in wired:
            wires.append((a, port_a, b, port_b))
            wired |= {(a, port_a), (b, port_b)}
    return np.array(sorted(wires), dtype=np.int64).reshape(-1, 4)


def resolve_bridges(specs: Iterable[BridgeSpec], placed: Sequence[PlacedPatch]) -> tuple[Bridge, ...]:
    """Resolve the bridges between placed patches.

    Raises:
        DeploymentError: an end is not a free port of a cell, or both ends are on one patch.
    """
    free = {patch.name: _free_ports(patch) for patch in placed}
    bridges = []
    for index, spec in enumerate(specs):
        ends: list[tuple[str, int, int]] = []
        for key, end in (("a", spec.a), ("b", spec.b)):
            name, cell, port = parse_port(end)
            if name not in free:
                known = known_names(name, free)
                raise DeploymentError(f"bridges[{index}].{key} = {end!r}: unknown patch; {known}")
            if (cell, port) not in free[name]:
                ports = [p for c, p in sorted(free[name]) if c == cell]
                raise DeploymentError(
                    f"bridges[{index}].{key} = {end!r}: not a free port; "
                    f"free ports of cell {cell}: {ports or 'none'}"
                )
            free[name].remove((cell, port))
            ends.append((name, cell, port))
        if ends[0][0] == ends[1][0]:
            raise DeploymentError(
                f"bridges[{index}]: both ends are on {ends[0][0]}; a bridge joins two patches"
            )
        bridges.append(Bridge(*ends[0], *ends[1]))
    return tuple(bridges)


def _free_ports(patch: PlacedPatch) -> set[tuple[int, int]]:
    taken = np.vstack([patch.wires[:, :2], patch.wires[:, 2:], patch.interfaces])
    ports = {(cell, port) for cell in range(patch.n_cells) for port in range(N_PORTS)}
    return ports - {(int(cell), int(port)) for cell, port in taken}


def _require_connected(placed: Sequence[PlacedPatch], bridges: Sequence[Bridge]) -> None:
    """Raise `DeploymentError` if a cell has no path over wires to an interface."""
    first = dict(zip((p.name for p in placed), np.cumsum([0, *(p.n_cells for p in placed)]), strict=False))
    ends = [patch.wires[:, [0, 2]] + first[patch.name] for patch in placed]
    ends += [np.array([[first[b.a_patch] + b.a_cell, first[b.b_patch] + b.b_cell]]) for b in bridges]
    a, b = np.vstack(ends).T
    group = connected_components(sum(patch.n_cells for patch in placed), a, b)
    fed = np.concatenate([group[first[patch.name] + patch.interfaces[:, 0]] for patch in placed])
    for patch in placed:
        mine = group[first[patch.name] : first[patch.name] + patch.n_cells]
        cut_off = np.flatnonzero(~np.isin(mine, fed))
        if len(cut_off):
            raise DeploymentError(
                f"patches.{patch.name}: no path leads from cell {cut_off[0]} ({len(cut_off)} in all) to an "
                "interface; ports are on the edges at 0°, 60°, 180° and 240°: add columns, rotate cells, or "
                "wire an interface or a bridge to it"
            )


def _require_free_interfaces(
    name: str, n_cells: int, wires: NDArray[np.int64], interfaces: NDArray[np.int64]
) -> None:
    wired = {(int(a), int(p)) for a, p in np.vstack([wires[:, :2], wires[:, 2:]])}
    seen: set[tuple[int, int]] = set()
    for index, (cell, port) in enumerate(interfaces.tolist()):
        key = f"patches.{name}.interfaces[{index}]"
        if cell >= n_cells:
            raise DeploymentError(f"{key}.cell = {cell}: the patch has cells 0 to {n_cells - 1}")
        free = [p for p in range(N_PORTS) if (cell, p) not in wired and (cell, p) not in seen]
        if port not in free:
            raise DeploymentError(
                f"{key} = cell {cell} port {port}: the port is in use; "
                f"free ports of cell {cell}: {free or 'none'}"
            )
        seen.add((cell, port))
