"""Skin layout of a deployment: numbering and wiring of cells, and their positions on the flattened skin."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.deployment import Deployment
from skinnet.skin.flattening import FlattenedSkin, flatten_skin
from skinnet.skin.lattice import N_PORTS
from skinnet.skin.placement import PlacedPatch, place_patches, resolve_bridges
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets
from skinnet.skin.whole_skin import join_patches

__all__ = ["SkinLayout", "build_skin_layout"]

Ints = NDArray[np.int64]

_PANEL_ASPECT_RATIO = 0.86
"""Aspect ratio of the panels beside the body, width to height."""


@dataclass(frozen=True)
class SkinLayout:
    """Skin layout; its taxels (*spots* in names) are all cells, then all elements of tactile sheets.

    Attributes:
        patches: Patches of cells.
        sheets: Tactile sheets.
        taxel_names: (spots,) "patch/cell" or "sheet/element".
        first_taxel: Index of the first taxel of each patch and sheet, by name.
        n_cells: Number of cells.
        wires: (m, 4) rows of (cell, port, cell, port), with the bridges between patches last.
        n_bridges: Number of bridges.
        gateways: (g, 2) rows of (cell, port).
        flattening: Flattened skin.
    """

    patches: tuple[PlacedPatch, ...]
    sheets: tuple[PlacedSheet, ...]
    taxel_names: tuple[str, ...]
    first_taxel: Mapping[str, int]
    n_cells: int
    wires: Ints
    n_bridges: int
    gateways: Ints
    flattening: FlattenedSkin

    def __deepcopy__(self, _memo: dict[int, Any]) -> "SkinLayout":
        return self

    @property
    def n_taxels(self) -> int:
        """Number of taxels: cells and sheet elements."""
        return len(self.taxel_names)

    @property
    def n_elements(self) -> int:
        """Number of elements of all tactile sheets."""
        return self.n_taxels - self.n_cells

    @cached_property
    def wire_at_port(self) -> Ints:
        """Wire index (cells, ports) at each port, −1 for none."""
        found = np.full((self.n_cells, N_PORTS), -1)
        found[self.wires[:, 0], self.wires[:, 1]] = np.arange(len(self.wires))
        found[self.wires[:, 2], self.wires[:, 3]] = np.arange(len(self.wires))
        return found

    def neighbour(self, cell: int, port: int) -> int:
        """Neighbour cell at the other end of a port's wire, −1 if there is none."""
        if not 0 <= port < N_PORTS or (wire := int(self.wire_at_port[cell, port])) < 0:
            return -1
        a, port_a, b, _ = self.wires[wire].tolist()
        return int(b if (a, port_a) == (cell, port) else a)


def build_skin_layout(deployment: Deployment) -> SkinLayout:
    """Build the skin layout of a deployment.

    Raises:
        DeploymentError: cells, wires or sheets contradict each other.
    """
    patches = place_patches(deployment.patches, deployment.cells, deployment.bridges)
    sheets = place_sheets(deployment.surfaces, deployment.sheets)
    pieces = [(patch.name, patch.n_cells) for patch in patches]
    pieces += [(sheet.name, sheet.n_elements) for sheet in sheets]
    starts = np.cumsum([0, *(count for _, count in pieces)]).tolist()
    wires, bridges = np.empty((0, 4), dtype=np.int64), np.empty((0, 4), dtype=np.int64)
    gateways = np.empty((0, 2), dtype=np.int64)
    if patches:
        skin = join_patches(patches, resolve_bridges(deployment.bridges, patches))
        wires, bridges, gateways = skin.wires, skin.bridges, skin.gateways
    return SkinLayout(
        patches=patches,
        sheets=sheets,
        taxel_names=tuple(f"{name}/{i}" for name, count in pieces for i in range(count)),
        first_taxel={name: start for (name, _), start in zip(pieces, starts, strict=False)},
        n_cells=sum(patch.n_cells for patch in patches),
        wires=wires,
        n_bridges=len(bridges),
        gateways=gateways,
        flattening=flatten_skin(patches, sheets, _PANEL_ASPECT_RATIO),
    )
