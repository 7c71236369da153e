"""The cell-to-cell network of a host while it runs: formation, data upwards, configuration downwards."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.encoding import Emission
from cells.formation_driver import FormationDriver
from cells.formation_gateway import Phase
from cells.formation_packets import handshake_ns
from cells.packets import PacketKind, PacketPool
from cells.routing import formed_routes
from cells.wiring import Wiring
from skinnet.deployment.schema import CellSpec, NetworkSpec
from skinnet.messages import Config, Topology
from skinnet.network.network import Finished
from skinnet.network.records import Outcome

__all__ = ["Delivered", "SkinNetwork"]

_LATENCY_BINS = 100_001
"""Microseconds up to 0.1 s; the last bin takes what is longer."""


class Delivered(NamedTuple):
    """Data of one kind that reached the interface of a patch, in the order of delivery.

    `rows` are rows of `PAYLOAD` whose cells are host-wide numbers; `gateway` is the interface's port.
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
        cells = np.concatenate([emission.cell, emission.full])
        n_events = len(emission.cell)
        ids = self._pool.take(len(cells))
        rows = np.zeros(len(cells), dtype=self._pool.rows.dtype)
        rows["t_sampled_ns"] = t_sampled_ns[cells]
        rows["cell"] = cells
        rows["kind"][n_events:] = PacketKind.READING
        events = rows[:n_events]
        events["modality"], events["channel"] = emission.modality, emission.channel
        events["event_kind"], events["level"], events["value"] = emission.kind, emission.level, emission.value
        rows["values"][n_events:] = readings[emission.full]
        self._pool.rows[ids] = rows
        self._offered[PacketKind.EVENT] += n_events
        self._offered[PacketKind.READING] += len(cells) - n_events
        size = np.full(len(cells), self._spec.stream_bytes)
        size[:n_events] = self._spec.event_bytes
        node = self.wiring.node_of_cell[cells]
        dest = self.wiring.interface[self.wiring.patch_of_node[node]]
        self.kernel.offer(rows["t_sampled_ns"], node, dest, size, ids)

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
            return self._sort(self._let_form(self.kernel.advance(until_ns)))
        rest = []
        while self.kernel.now_ns < until_ns:
            step_ns = self.formation.horizon_ns(until_ns)
            rest.append(self._let_form(self.kernel.advance(step_ns)))
            self.formation.ring(step_ns)
        self._note_formed(until_ns)
        # as one: what a formed patch says may not depend on others that still form
        return self._sort(Finished._make(map(np.concatenate, zip(*rest, strict=True))))

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
        if not len(finished.packet_id):
            return [], []
        rows = self._pool.rows[finished.packet_id]
        kind = rows["kind"]
        np.add.at(self._ended, (kind, finished.outcome), 1)
        arrived = finished.outcome == Outcome.DELIVERED
        configs: list[tuple[int, Config]] = [
            (int(rows["cell"][i]), self._pool.contents[int(finished.packet_id[i])])
            for i in np.flatnonzero(arrived & (kind == PacketKind.CONFIG))
        ]
        data = [
            one
            for wanted in (PacketKind.EVENT, PacketKind.READING)
            for one in self._by_patch(wanted, rows, finished, arrived & (kind == wanted))
        ]
        self._pool.free(finished.packet_id)
        return data, configs

    def _by_patch(
        self, kind: PacketKind, rows: NDArray[Any], finished: Finished, chosen: NDArray[np.bool_]
    ) -> list[Delivered]:
        index = np.flatnonzero(chosen)
        if not len(index):
            return []
        patch = self.wiring.patch_of_node[finished.node[index]]
        order = np.argsort(patch, kind="stable")
        index, patch = index[order], patch[order]
        rows, t_ns = rows[index], finished.t_ns[index]
        gateway = self.wiring.topology.dst_port[finished.link[index]]
        latency_ns = t_ns - rows["t_sampled_ns"]
        np.add.at(self.latency_us, np.minimum(latency_ns // 1000, _LATENCY_BINS - 1), 1)
        self.latency_max_ns = max(self.latency_max_ns, int(latency_ns.max()))
        bounds = [0, *(np.flatnonzero(patch[1:] != patch[:-1]) + 1).tolist(), len(patch)]
        return [
            Delivered(int(patch[a]), kind, rows[a:b], gateway[a:b], t_ns[a:b]) for a, b in pairwise(bounds)
        ]
