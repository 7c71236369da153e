"""Outage schedule of links and cells, brown-outs included, computed before the run.

Faults do not depend on the state of the network, so every process computes its own schedule in advance.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cells.networking.wiring import Wiring
from skinnet.deployment.network import PowerSpec
from skinnet.network.power_grid import PowerGrid
from skinnet.protocol.messages import FOREVER_NS

__all__ = ["Outage", "TopologyChange", "compute_topology_changes"]


@dataclass(frozen=True)
class Outage:
    """Outage of links or of a cell from `t_ns` until `until_ns` [ns].

    `cuts_power`: the wires of the links carry no power either.
    """

    t_ns: int
    until_ns: int
    links: tuple[int, ...] = ()
    cell: int | None = None
    cuts_power: bool = True


@dataclass(frozen=True)
class TopologyChange:
    """Topology change at `t_ns` [ns]: links that go down or up, cells that lose or regain power."""

    t_ns: int
    links_down: tuple[int, ...] = ()
    links_up: tuple[int, ...] = ()
    cells_off: tuple[int, ...] = ()
    cells_on: tuple[int, ...] = ()


class _NetworkState:
    """State of links and cells while the schedule is computed."""

    def __init__(self, wiring: Wiring, power: PowerSpec | None, fed_cells: NDArray[np.int64]) -> None:
        self._wiring = wiring
        self._grid = None if power is None else PowerGrid(wiring.n_cells, wiring.skin.wires, fed_cells, power)
        self._link_fault_count: Counter[int] = Counter()
        self._wire_cut_count: Counter[int] = Counter()
        self._cell_fault_count: Counter[int] = Counter()
        self.powered = np.ones(wiring.n_cells, dtype=np.bool_)
        self.link_up = np.ones(wiring.topology.n_links, dtype=np.bool_)

    def apply(self, outage: Outage, increment: int) -> None:
        """Count an outage that begins (`increment` 1) or ends (−1)."""
        for link in outage.links:
            self._link_fault_count[link] += increment
            if outage.cuts_power:
                self._wire_cut_count[link // 2] += increment
        if outage.cell is not None:
            self._cell_fault_count[outage.cell] += increment

    def resolve(self, t_ns: int) -> TopologyChange:
        """Compute which links are up and which cells have power at `t_ns`; return the change."""
        cell_on = np.ones_like(self.powered)
        cell_on[[cell for cell, n in self._cell_fault_count.items() if n]] = False
        if self._grid is not None:
            wire_ok = np.ones(len(self._wiring.skin.wires), dtype=np.bool_)
            wire_ok[[w for w, n in self._wire_cut_count.items() if n and w < len(wire_ok)]] = False
            cell_on &= ~self._grid.solve(cell_on, wire_ok).browned_out
        link_up = np.ones_like(self.link_up)
        link_up[[link for link, n in self._link_fault_count.items() if n]] = False
        topology = self._wiring.topology
        node_on = np.ones(topology.n_nodes, dtype=np.bool_)
        node_on[self._wiring.node_of_cell[~cell_on]] = False
        link_up &= node_on[topology.src] & node_on[topology.dst]
        change = TopologyChange(
            t_ns,
            links_down=_indices(self.link_up & ~link_up),
            links_up=_indices(link_up & ~self.link_up),
            cells_off=_indices(self.powered & ~cell_on),
            cells_on=_indices(cell_on & ~self.powered),
        )
        self.powered, self.link_up = cell_on, link_up
        return change


def _indices(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(np.flatnonzero(mask).tolist())


def compute_topology_changes(
    wiring: Wiring, faults: Iterable[Outage], power: PowerSpec | None, fed_cells: Sequence[int]
) -> tuple[TopologyChange, ...]:
    """Return all topology changes in order of time; the first, at 0, gives the initial state.

    Args:
        wiring: Cells and links.
        faults: Outages from faults.
        power: Power grid; None if every cell has power.
        fed_cells: Cells with a power feed.
    """
    schedule = _NetworkState(wiring, power, np.array(fed_cells, dtype=np.int64))
    at: dict[int, list[tuple[Outage, int]]] = {0: []}
    for outage in faults:
        at.setdefault(outage.t_ns, []).append((outage, 1))
        if outage.until_ns < FOREVER_NS:
            at.setdefault(outage.until_ns, []).append((outage, -1))
    transitions = []
    for t_ns in sorted(at):
        for outage, step in at[t_ns]:
            schedule.apply(outage, step)
        transitions.append(schedule.resolve(t_ns))
    return tuple(transitions)
