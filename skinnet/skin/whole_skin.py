"""Whole-skin graph: the cells of all patches in one numbering, with bridges between patches."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.cell_names import parse_port
from skinnet.errors import DeploymentError
from skinnet.graph_components import connected_components
from skinnet.skin.gateway_placement import MAX_GATEWAY_PORTS
from skinnet.skin.placement import Bridge, PlacedPatch
from skinnet.suggestions import known_names

__all__ = ["WholeSkin", "join_patches", "require_gateway_ports"]


@dataclass(frozen=True)
class WholeSkin:
    """Whole skin of a robot as one graph.

    Attributes:
        patches: All patches in order; cells are numbered patch by patch.
        first_cell: (p + 1,) index of the first cell of each patch, then the number of all cells.
        wires: (m, 4) rows of (cell, port, cell, port): those of the patches in order, then the bridges.
        bridges: (b, 4) the last rows of `wires`.
        gateways: (g, 2) rows of (cell, port): the interfaces of the patches in order.
    """

    patches: tuple[PlacedPatch, ...]
    first_cell: NDArray[np.int64]
    wires: NDArray[np.int64]
    bridges: NDArray[np.int64]
    gateways: NDArray[np.int64]

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return int(self.first_cell[-1])

    @cached_property
    def patch_of_cell(self) -> NDArray[np.int64]:
        """Patch index (n,) of every cell."""
        return np.repeat(np.arange(len(self.patches)), np.diff(self.first_cell))

    @cached_property
    def component_of_patch(self) -> NDArray[np.int64]:
        """Connected component (p,) of each patch over the bridges."""
        ends = self.patch_of_cell[self.bridges[:, [0, 2]]]
        return connected_components(len(self.patches), ends[:, 0], ends[:, 1])

    def cell_name(self, cell: int) -> str:
        """Return the cell name "patch/cell"."""
        patch = int(self.patch_of_cell[cell])
        return f"{self.patches[patch].name}/{cell - int(self.first_cell[patch])}"

    def feed_cells(self, feed_points: Iterable[str]) -> NDArray[np.int64]:
        """Return the feed cells (f,) of "patch/cell:port" in `power.feed_cells`; all gateway cells if empty.

        Raises:
            DeploymentError: unknown patch or cell.
        """
        named = [self._cell_index(f"power.feeds[{index}]", name) for index, name in enumerate(feed_points)]
        return np.array(named, dtype=np.int64) if named else self.gateways[:, 0]

    def _cell_index(self, key: str, name: str) -> int:
        patch_name, cell, _ = parse_port(name)
        for patch, first in zip(self.patches, self.first_cell.tolist(), strict=False):
            if patch.name == patch_name and cell < patch.n_cells:
                return int(first + cell)
            if patch.name == patch_name:
                raise DeploymentError(f"{key} = {name!r}: {patch_name} has cells 0 to {patch.n_cells - 1}")
        known = known_names(patch_name, [patch.name for patch in self.patches])
        raise DeploymentError(f"{key} = {name!r}: unknown patch; {known}")


def join_patches(patches: tuple[PlacedPatch, ...], bridges: Sequence[Bridge] = ()) -> WholeSkin:
    """Join all `patches` and `bridges` into one graph."""
    first_cell = np.concatenate([[0], np.cumsum([patch.n_cells for patch in patches])]).astype(np.int64)
    shifts = np.zeros((len(patches), 1, 4), dtype=np.int64)
    shifts[:, 0, [0, 2]] = first_cell[:-1, None]
    inner = [patch.wires + shift for patch, shift in zip(patches, shifts, strict=True)]
    gateways = [patch.interfaces + shift[:, :2] for patch, shift in zip(patches, shifts, strict=True)]
    first = {patch.name: int(cell) for patch, cell in zip(patches, first_cell, strict=False)}
    across = [(first[b.a_patch] + b.a_cell, b.a_port, first[b.b_patch] + b.b_cell, b.b_port) for b in bridges]
    ends = np.array(across, dtype=np.int64).reshape(-1, 4)
    return WholeSkin(patches, first_cell, np.vstack([*inner, ends]), ends, np.vstack(gateways))


def require_gateway_ports(skin: WholeSkin) -> None:
    """Refuse groups of patches with more interfaces than a gateway has ports.

    Raises:
        DeploymentError: a group has too many; names its patches.
    """
    patch = skin.patch_of_cell[skin.gateways[:, 0]]
    counts = np.bincount(skin.component_of_patch[patch]) if len(patch) else np.zeros(0, dtype=np.int64)
    for group in np.flatnonzero(counts > MAX_GATEWAY_PORTS).tolist():
        names = [skin.patches[k].name for k in np.flatnonzero(skin.component_of_patch == group).tolist()]
        raise DeploymentError(
            f"patches.{', '.join(names)}: {counts[group]} interfaces, but a gateway has at most "
            f"{MAX_GATEWAY_PORTS} ports; give fewer, or make patches without a bridge between them"
        )
