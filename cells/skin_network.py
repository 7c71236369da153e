"""The cell-to-cell network of a host while it runs: formation, data upwards, configuration downwards."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.encoding import Emission
from cells.exchange import enter, take_readings
from cells.formation_driver import FormationDriver
from cells.formation_gateway import Phase
from cells.formation_packets import handshake_ns
from cells.packets import PacketKind, PacketPool
from cells.routing import formed_routes
from cells.wiring import Wiring
from skinnet.deployment.schema import CellSpec, NetworkSpec
from skinnet.messages import STREAM_ROW, Config, Topology
from skinnet.network.network import Finished
from skinnet.network.records import Outcome

__all__ = ["Delivered", "SkinNetwork"]

_READING, _DELIVERED = int(PacketKind.READING), int(Outcome.DELIVERED)
_LATENCY_BINS = 100_001
"""Microseconds up to 0.1 s; the last bin takes what is longer."""


class Delivered(NamedTuple):
    """Data of one kind that reached the interface of a patch, in the order of delivery.

    `rows` are `PAYLOAD` of events, or `STREAM_ROW` of full readings, whose cells are host-wide numbers;
    `gateway` is the interface's port.
    """

    patch: int
    kind: PacketKind
    rows: NDArray[Any]
    gateway: NDArray[np.int64]
    t_ns: NDArray[np.int64]


class SkinNetwork:
    """Carries the packets of all patches of a host over the modelled links."""

    def __init__(self, wiring: Wiring, cells: CellSpec, spec: NetworkSpec, seed: int) -> None:
        self.wiring = wiring
        self.kernel = wiring.network(seed)
        self._spec = spec
        self._pool = PacketPool()
        reaction_ns = round(cells.reaction_us * 1e3)
        self.formation = FormationDriver(
            wiring,
            self.kernel,
            self._pool,
            reaction_ns=reaction_ns,
            handshake_ns=handshake_ns(spec, reaction_ns),
            size_bytes=spec.control_bytes,
        )
        self.formed_ns: list[int | None] = [None] * len(wiring.patches)
        self.reached = np.zeros(wiring.n_cells, dtype=np.bool_)
        self._interface_of_cell = wiring.interface[wiring.patch_of_node[wiring.node_of_cell]]
        self.latency_us = np.zeros(_LATENCY_BINS, dtype=np.int64)
        self.latency_max_ns = 0
        self._offered = np.zeros(len(PacketKind), dtype=np.int64)
        self._ended = np.zeros((len(PacketKind), len(Outcome)), dtype=np.int64)

    def start(self, t_ns: int) -> None:
        """The network begins to form."""
        self.formation.start(t_ns)

    def send_data(
        self, t_sampled_ns: NDArray[np.int64], emission: Emission, readings: NDArray[np.float32]
    ) -> None:
        """Cells send what they have to say of the samples that they took at `t_sampled_ns` (cells,)."""
        n_events = len(emission.cell)
        n = n_events + len(emission.full)
        ids = self._pool.take(n)
        cell, t_ns = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
        enter(*emission, readings, t_sampled_ns, ids, self._pool.rows, cell, t_ns)
        self._offered[PacketKind.EVENT] += n_events
        self._offered[PacketKind.READING] += n - n_events
        size = np.full(n, self._spec.stream_bytes)
        size[:n_events] = self._spec.event_bytes
        self.kernel.offer(t_ns, self.wiring.node_of_cell[cell], self._interface_of_cell[cell], size, ids)

    def send_config(self, t_ns: int, cell: int, config: Config) -> None:
        """The interface sends a configuration down to a cell (host-wide number)."""
        node = int(self.wiring.node_of_cell[cell])
        interface = int(self.wiring.interface[self.wiring.patch_of_node[node]])
        row = self._pool.put_content(PacketKind.CONFIG, cell, config)
        self._offered[PacketKind.CONFIG] += 1
        self.kernel.offer([t_ns], [interface], [node], [self._spec.control_bytes], [row])

    def advance(self, until_ns: int) -> tuple[list[Delivered], list[tuple[int, Config]]]:
        """Lets time pass; returns data by patch, and configurations by cell, in the order of delivery."""
        if all(t_ns is not None for t_ns in self.formed_ns):
            finished = self.kernel.advance(until_ns)
            return self._sort(finished if self._at_rest else self._let_form(finished))
        rest = []
        while self.kernel.now_ns < until_ns:
            step_ns = self.formation.horizon_ns(until_ns)
            rest.append(self._let_form(self.kernel.advance(step_ns)))
            self.formation.ring(step_ns)
        self._note_formed(until_ns)
        # as one: what a formed patch says may not depend on others that still form
        return self._sort(Finished._make(map(np.concatenate, zip(*rest, strict=True))))

    @property
    def _at_rest(self) -> bool:
        """No packet of formation is on its way."""
        return self.formation.sent == int(self._ended[PacketKind.FORMATION].sum())

    def topology(self, patch: int, t_ns: int) -> Topology:
        """What the cells of a formed patch found out."""
        placed = self.wiring.patches[patch]
        forest = self.formation.gateways[patch].forest()
        return forest.topology(placed.name, placed.n_cells, version=1, t_ns=t_ns)

    def counters(self) -> dict[str, dict[str, int]]:
        """Packets by kind: offered, delivered, dropped by cause, in flight."""
        result = {}
        self._offered[PacketKind.FORMATION] = self.formation.sent
        for kind in PacketKind:
            ended = self._ended[kind]
            offered = int(self._offered[kind])
            entry = {"offered": offered, "in_flight": offered - int(ended.sum())}
            entry |= {outcome.name.lower(): int(ended[outcome]) for outcome in Outcome}
            result[kind.name.lower()] = entry
        return result

    def _note_formed(self, t_ns: int) -> None:
        for patch, gateway in enumerate(self.formation.gateways):
            if self.formed_ns[patch] is None and gateway.phase in (Phase.COMPLETE, Phase.FAILED):
                self.formed_ns[patch] = t_ns
                self.kernel.set_routes(t_ns, formed_routes(self.wiring, self.formation, patch))
                cells = np.array(gateway.forest().uid, dtype=np.int64)
                self.reached[cells + self.wiring.first_cell[patch]] = True

    def _let_form(self, finished: Finished) -> Finished:
        """Hands the packets of formation to the agents that they reached; returns the others."""
        forming = self._pool.rows["kind"][finished.packet_id] == PacketKind.FORMATION
        if not forming.any():
            return finished
        heard = Finished._make(column[forming] for column in finished)
        np.add.at(self._ended[PacketKind.FORMATION], heard.outcome, 1)
        for i in np.flatnonzero(heard.outcome == Outcome.DELIVERED).tolist():
            self.formation.receive(
                int(heard.t_ns[i]), int(heard.node[i]), int(heard.link[i]), int(heard.packet_id[i])
            )
        self._pool.free(heard.packet_id)
        return Finished._make(column[~forming] for column in finished)

    def _sort(self, finished: Finished) -> tuple[list[Delivered], list[tuple[int, Config]]]:
        """Takes data and configurations that ended apart, and frees their rows."""
        packet_id = finished.packet_id
        if not len(packet_id):
            return [], []
        kind = self._pool.rows["kind"][packet_id]
        arrived = finished.outcome == _DELIVERED
        is_reading = arrived & (kind == _READING)
        data: list[Delivered] = []
        configs: list[tuple[int, Config]] = []
        if is_reading.all():
            self._ended[_READING, _DELIVERED] += len(packet_id)
        else:
            np.add.at(self._ended, (kind, finished.outcome), 1)
            for i in np.flatnonzero(arrived & (kind == PacketKind.CONFIG)).tolist():
                row = int(packet_id[i])
                configs.append((int(self._pool.rows["cell"][row]), self._pool.contents[row]))
            data += self._events_by_patch(finished, np.flatnonzero(arrived & (kind == PacketKind.EVENT)))
        data += self._readings_by_patch(finished, np.flatnonzero(is_reading))
        self._pool.free(packet_id)
        return data, configs

    def _events_by_patch(self, finished: Finished, index: NDArray[np.int64]) -> list[Delivered]:
        if not len(index):
            return []
        patch, gateway = self._ends(finished)
        self._note_latency(finished, index)
        return [
            Delivered(
                int(p), PacketKind.EVENT, self._pool.rows[finished.packet_id[i]], gateway[i], finished.t_ns[i]
            )
            for p in np.unique(patch[index])
            for i in (index[patch[index] == p],)
        ]

    def _readings_by_patch(self, finished: Finished, index: NDArray[np.int64]) -> list[Delivered]:
        if not len(index):
            return []
        patch, gateway = self._ends(finished)
        self._note_latency(finished, index)
        rows = np.empty(len(index), dtype=STREAM_ROW)
        start = np.empty(len(self.wiring.patches) + 1, dtype=np.int64)
        take_readings(index, finished.packet_id, finished.t_ns, patch, gateway, self._pool.rows, start, rows)
        return [
            Delivered(p, PacketKind.READING, rows[a:b], rows["gateway"][a:b], rows["t_delivered_ns"][a:b])
            for p, (a, b) in enumerate(pairwise(start.tolist()))
            if b > a
        ]

    def _ends(self, finished: Finished) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Patch in which each packet ended, and the port of the node at which it came in."""
        return self.wiring.patch_of_node[finished.node], self.wiring.topology.dst_port[finished.link]

    def _note_latency(self, finished: Finished, index: NDArray[np.int64]) -> None:
        sampled_ns = self._pool.rows["t_sampled_ns"][finished.packet_id[index]]
        latency_ns = finished.t_ns[index] - sampled_ns
        np.add.at(self.latency_us, np.minimum(latency_ns // 1000, _LATENCY_BINS - 1), 1)
        self.latency_max_ns = max(self.latency_max_ns, int(latency_ns.max()))
