"""Network state of the skin: connected cells, routing tree, link loads and link failures."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.deployment.network import NetworkSpec
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import Topology, unpack
from skinnet.protocol.telemetry_messages import LINK_INTO_CELL, LINK_ROW, LINK_UP, LinkLoad
from skinnet.skin.lattice import N_PORTS
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["NetworkState"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_INFERENCE_WINDOW_NS = 500_000_000
"""Window [ns] over which loads are inferred from delivered packets if there is no `LinkLoad`."""


class NetworkState:
    """Network state from topologies found by the cells and link loads published by cell processes.

    Attributes:
        formed: (patches,) whether the patch has published its topology.
        connected: (cells,) whether the cell is connected to the network.
        depth: (cells,) hops to the cell's gateway.
        parent: (cells,) next cell towards the computer, −1 for the computer itself or none.
        master_port: (cells,) port towards the parent.
        utilisation: (cells, ports) utilisation of the link out of a port in the last interval, 0 to 1.
        utilisation_inwards: (cells, ports) utilisation of the links from the computer.
        dropped: (cells, ports) packets lost on the link out of a port since the run began.
        max_queue_length: (cells, ports) greatest length of its queue in packets.
        link_down: (cells, ports) whether the link is reported down.
        unpowered: (cells,) whether the cell is reported without power.
        measured_ns: Time of the last published link loads [ns], −1 for never: loads are then inferred.
    """

    def __init__(self, layout: SkinLayout, spec: NetworkSpec) -> None:
        n, shape = layout.n_cells, (layout.n_cells, N_PORTS)
        self._layout, self._spec = layout, spec
        self._patch_index = {patch.name: i for i, patch in enumerate(layout.patches)}
        self.formed = np.zeros(len(layout.patches), dtype=np.bool_)
        self.connected = np.zeros(n, dtype=np.bool_)
        self.depth = np.full(n, -1)
        self.parent = np.full(n, -1)
        self.master_port = np.full(n, -1)
        self.utilisation, self.utilisation_inwards = np.zeros(shape), np.zeros(shape)
        self.dropped = np.zeros(shape, dtype=np.int64)
        self.max_queue_length = np.zeros(shape, dtype=np.int64)
        self.link_down = np.zeros(shape, dtype=np.bool_)
        self.unpowered = np.zeros(n, dtype=np.bool_)
        self.measured_ns = -1
        self._known = np.zeros(shape, dtype=np.bool_)
        self._busy_ns = np.zeros((2, *shape), dtype=np.int64)
        self._busy_at_ns = np.full(len(layout.patches), -1)
        self._delivered: deque[tuple[int, Sequence[int], float]] = deque()

    def apply_topology(self, topology: Topology) -> tuple[Ints, Ints]:
        """Apply a patch's topology; return the cells lost from the network, and those gained.

        Raises:
            ProtocolError: the patch is unknown, or the topology does not fit its cells.
        """
        patch, cells = self._require_patch(topology.patch)
        columns = (topology.network_id, topology.master_port, topology.depth, topology.neighbours)
        if any(len(column) != len(cells) for column in columns):
            raise ProtocolError(f"topology of {topology.patch}: expected columns of {len(cells)} cells")
        before = self.connected[cells].copy()
        found = np.array(topology.network_id) > 0
        lost, won = cells[before & ~found], cells[found & ~before]
        self.formed[patch] = True
        self.connected[cells] = found
        self.depth[cells] = topology.depth
        self.master_port[cells] = np.where(found, topology.master_port, -1)
        self._known[cells] = np.array(topology.neighbours).reshape(len(cells), -1)[:, :N_PORTS] >= 0
        for cell, port, _ in topology.bridged_neighbours:
            self._known[cells[cell], port] = True
        ports = self.master_port[cells].tolist()
        self.parent[cells] = [
            self._layout.neighbour(cell, port) for cell, port in zip(cells.tolist(), ports, strict=True)
        ]
        return lost, won

    def apply_load(self, load: LinkLoad) -> int:
        """Apply a patch's link loads; return the number of packets lost since its last report.

        Raises:
            ProtocolError: the patch, a cell or a port is unknown.
        """
        patch, cells = self._require_patch(load.patch)
        rows = unpack(load.rows, LINK_ROW)
        if rows["cell"].max(initial=0) >= len(cells) or rows["port"].max(initial=0) >= N_PORTS:
            raise ProtocolError(f"link loads of {load.patch}: unknown cell or port")
        if any(not 0 <= cell < len(cells) for cell in load.unpowered_cells):
            raise ProtocolError(f"{load.patch} has no cell {max(load.unpowered_cells)}")
        cell, port = cells[rows["cell"]], rows["port"].astype(np.int64)
        inwards = (rows["state"] & LINK_INTO_CELL).astype(bool)
        direction = inwards.astype(np.int64)
        passed_ns = load.t_ns - int(self._busy_at_ns[patch])
        known = self._busy_at_ns[patch] >= 0
        if known and passed_ns > 0:
            share = np.clip((rows["busy_ns"] - self._busy_ns[direction, cell, port]) / passed_ns, 0.0, 1.0)
            self.utilisation[cell[~inwards], port[~inwards]] = share[~inwards]
            self.utilisation_inwards[cell[inwards], port[inwards]] = share[inwards]
        self._busy_ns[direction, cell, port] = rows["busy_ns"]
        self._busy_at_ns[patch] = load.t_ns
        out = ~inwards
        before = int(self.dropped[cells].sum())
        self.dropped[cell[out], port[out]] = rows["dropped"][out]
        self.max_queue_length[cell[out], port[out]] = rows["queue_high_water"][out]
        self.link_down[cell[out], port[out]] = (rows["state"][out] & LINK_UP) == 0
        self.unpowered[cells] = False
        self.unpowered[cells[load.unpowered_cells]] = True
        self.measured_ns = max(self.measured_ns, load.t_ns)
        return max(int(self.dropped[cells].sum()) - before, 0) if known else 0

    def on_delivered(self, t_ns: int, cells: Sequence[int], n_bytes: int) -> None:
        """Note delivered packets of `n_bytes` each, one from each entry of `cells`."""
        if self.measured_ns < 0 and cells:
            self._delivered.append((t_ns, cells, float(n_bytes)))

    def infer_loads(self, t_ns: int) -> None:
        """Infer the loads of links towards the computer from recent deliveries, unless they are published."""
        if self.measured_ns >= 0:
            self._delivered.clear()
            return
        while self._delivered and not t_ns - _INFERENCE_WINDOW_NS <= self._delivered[0][0] <= t_ns:
            self._delivered.popleft()
        self.utilisation[:] = 0.0
        if not self._delivered:
            return
        n_bytes = np.zeros(self._layout.n_cells)
        for _, cells, size in self._delivered:
            np.add.at(n_bytes, cells, size)
        for cell in np.argsort(-self.depth, kind="stable").tolist():  # from the leaves to the gateways
            if (parent := int(self.parent[cell])) >= 0:
                n_bytes[parent] += n_bytes[cell]
        sends = np.flatnonzero(self.master_port >= 0)
        share = n_bytes * self._spec.bits_per_byte / self._spec.bits_per_s / (_INFERENCE_WINDOW_NS * 1e-9)
        self.utilisation[sends, self.master_port[sends]] = np.minimum(share[sends], 1.0)

    @property
    def broken(self) -> Bools:
        """Broken wires (wires,): reported down, or unknown to both of two connected cells."""
        a, port_a, b, port_b = self._layout.wires.T
        both = self.connected[a] & self.connected[b]
        unknown = both & ~self._known[a, port_a] & ~self._known[b, port_b]
        told: Bools = (
            (self.link_down[a, port_a] | self.link_down[b, port_b]) & ~self.unpowered[a] & ~self.unpowered[b]
        )
        return told if self.measured_ns >= 0 else unknown

    @property
    def unreachable(self) -> Bools:
        """Unreachable cells (cells,): without power, or not connected in a patch that has formed."""
        formed = np.repeat(self.formed, [patch.n_cells for patch in self._layout.patches])
        gone: Bools = self.unpowered | (formed & ~self.connected)
        return gone

    @property
    def wire_utilisation(self) -> Floats:
        """Wire load (wires,): the larger of the two directions."""
        a, port_a, b, port_b = self._layout.wires.T
        load: Floats = np.maximum(self.utilisation[a, port_a], self.utilisation[b, port_b])
        return load

    @property
    def in_tree(self) -> Bools:
        """Tree membership (wires,): whether the wire belongs to the routing tree."""
        a, port_a, b, port_b = self._layout.wires.T
        used: Bools = (self.master_port[a] == port_a) | (self.master_port[b] == port_b)
        return used

    def _require_patch(self, name: str) -> tuple[int, Ints]:
        patch = self._patch_index.get(name)
        if patch is None:
            raise ProtocolError(f"unknown patch {name!r}")
        start = self._layout.first_taxel[name]
        return patch, np.arange(start, start + self._layout.patches[patch].n_cells)
