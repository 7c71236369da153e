"""Benchmark workload: cells in patches of 50 behind one interface each, at 250 Hz.

Rates and sizes are chosen so that transmissions take whole nanoseconds, which every simulator can represent:
23 bytes of 10 bits at 10 Mbit/s are 23 µs [T11, UCD: 12 Mbit/s]. Every cell has a phase of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.network.packet_network import PacketNetwork
from skinnet.network.routes import Routes, min_hop_routes
from skinnet.network.topology import Topology
from skinnet.random_streams import StreamName, generator

__all__ = ["CELLS_PER_PATCH", "PERIOD_NS", "Workload", "make_workload"]

CELLS_PER_PATCH = 50
PERIOD_NS = 4_000_000  # 250 Hz [M14]
_SIZE_BYTES = 23  # all modalities [UCD]
_BITS_PER_S = 10_000_000
_BITS_PER_BYTE = 10  # UART with start and stop bit
_DELAY_NS = 100_000  # assumption: forwarding in a cell; published is 300 µs under full load [T11]
_QUEUE_PACKETS = 32  # assumption, never full here
_COLUMNS = 10
_LEFT, _RIGHT, _ABOVE, _BELOW = range(4)


@dataclass(frozen=True, eq=False)
class Workload:
    """Topology, routes and packets of a benchmark, packets in order of time; arrays are (n_packets,)."""

    topology: Topology
    routes: Routes
    t_ns: NDArray[np.int64]
    node: NDArray[np.int64]
    dest: NDArray[np.int64]
    size_bytes: NDArray[np.int64]

    @property
    def n_packets(self) -> int:
        """Number of packets; they are numbered from 0."""
        return self.t_ns.size

    def make_network(self) -> PacketNetwork:
        """Packet network with these routes, idle."""
        network = PacketNetwork(self.topology)
        network.set_routes(0, self.routes)
        return network


def make_workload(n_cells: int, n_periods: int) -> Workload:
    """Workload of `n_cells` four-port cells in trees, each sending to its interface in every period.

    Node p × 51 is the interface of patch p; the cells of its patch follow it, breadth first.
    """
    cells = np.arange(n_cells)
    patch, place = np.divmod(cells, CELLS_PER_PATCH)
    row, column = np.divmod(place, _COLUMNS)
    interface = patch * (CELLS_PER_PATCH + 1)
    node = interface + 1 + place
    # formed breadth first from the corner: along the first column, then along the rows
    up = np.where(column > 0, node - 1, np.where(row > 0, node - _COLUMNS, interface))
    up_port = np.where(column > 0, _RIGHT, np.where(row > 0, _BELOW, 0))
    port = np.where(column > 0, _LEFT, _ABOVE)
    topology = Topology.from_wires(
        n_cells + int(patch[-1]) + 1,
        np.stack([node, port, up, up_port], axis=1),
        bits_per_s=_BITS_PER_S,
        bits_per_byte=_BITS_PER_BYTE,
        delay_ns=_DELAY_NS,
        queue_packets=_QUEUE_PACKETS,
    )
    phase_ns = generator(1, StreamName.BENCHMARK, n_cells).integers(PERIOD_NS, size=n_cells)
    order = np.argsort(phase_ns, kind="stable")
    t_ns = (np.arange(n_periods)[:, None] * PERIOD_NS + phase_ns[order]).ravel()
    return Workload(
        topology,
        min_hop_routes(topology, np.unique(interface)),
        t_ns,
        np.tile(node[order], n_periods),
        np.tile(interface[order], n_periods),
        np.full(t_ns.size, _SIZE_BYTES, dtype=np.int64),
    )
