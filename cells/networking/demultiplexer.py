"""Demultiplexing of finished packets: data by patch at the gateways, configurations by cell."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.networking.packet_counters import LatencyHistogram, PacketCounters
from cells.networking.packet_io import read_stream_rows
from cells.networking.packet_pool import PacketKind, PacketPool
from cells.networking.wiring import Wiring
from skinnet.network.packet_network import EndedPackets
from skinnet.network.records import Outcome
from skinnet.protocol.messages import STREAM_ROW, Config

__all__ = ["DeliveredPackets", "PacketDemultiplexer"]

_READING, _DELIVERED = int(PacketKind.READING), int(Outcome.DELIVERED)
_UNDELIVERABLE = (Outcome.LINK_FAILED, Outcome.NO_ROUTE, Outcome.TTL)
"""Outcomes of packets that had no link or no route."""


class DeliveredPackets(NamedTuple):
    """Data packets of one kind that reached the computer from a patch, in order of delivery.

    `rows` are `PAYLOAD` of events, or `STREAM_ROW` of full readings, with cell indices within the process;
    `gateway` is the port of the interface; `t_ns` the time of delivery.
    """

    patch: int
    kind: PacketKind
    rows: NDArray[Any]
    gateway: NDArray[np.int64]
    t_ns: NDArray[np.int64]


class PacketDemultiplexer:
    """Demultiplexer of finished packets: sorts and counts them, measures latency, frees their rows.

    Attributes:
        undeliverable: (groups,) data packets that were dropped for want of a link or a route.
    """

    def __init__(self, wiring: Wiring, pool: PacketPool, counters: PacketCounters) -> None:
        """Start with empty counts; outcomes are counted in `counters`, of `PacketKind`."""
        self.undeliverable = np.zeros(len(wiring.group_ports), dtype=np.int64)
        self._latency = LatencyHistogram()
        self._wiring, self._pool, self._counters = wiring, pool, counters

    @property
    def latency_us(self) -> NDArray[np.int64]:
        """Histogram of the latency of data packets, from sample to gateway, in bins of 1 µs."""
        return self._latency.counts

    @property
    def latency_max_ns(self) -> int:
        """Maximum latency of a data packet [ns]."""
        return self._latency.max_ns

    def demultiplex(self, finished: EndedPackets) -> tuple[list[DeliveredPackets], list[tuple[int, Config]]]:
        """Demultiplex finished packets: data by patch, configurations by cell, in order of delivery.

        Cells are indices within the process.
        """
        packet_id = finished.packet_id
        if not len(packet_id):
            return [], []
        kind = self._pool.rows["kind"][packet_id]
        arrived = finished.outcome == _DELIVERED
        is_reading = arrived & (kind == _READING)
        data: list[DeliveredPackets] = []
        configs: list[tuple[int, Config]] = []
        if is_reading.all():
            self._counters.count_delivered(PacketKind.READING, len(packet_id))
        else:
            self._counters.count_ended(kind, finished.outcome)
            wanting = np.isin(finished.outcome, _UNDELIVERABLE) & (kind != PacketKind.CONFIG)
            np.add.at(self.undeliverable, self._wiring.group_of_node[finished.node[wanting]], 1)
            for i in np.flatnonzero(arrived & (kind == PacketKind.CONFIG)).tolist():
                row = int(packet_id[i])
                configs.append((int(self._pool.rows["cell"][row]), self._pool.objects[row]))
            data += self._events_by_patch(finished, np.flatnonzero(arrived & (kind == PacketKind.EVENT)))
        data += self._readings_by_patch(finished, np.flatnonzero(is_reading))
        self._pool.free(packet_id)
        return data, configs

    def _events_by_patch(self, finished: EndedPackets, index: NDArray[np.int64]) -> list[DeliveredPackets]:
        if not len(index):
            return []
        patch, gateway = self._patch_and_port(finished)
        self._count_latency(finished, index)
        return [
            DeliveredPackets(
                int(p), PacketKind.EVENT, self._pool.rows[finished.packet_id[i]], gateway[i], finished.t_ns[i]
            )
            for p in np.unique(patch[index])
            for i in (index[patch[index] == p],)
        ]

    def _readings_by_patch(self, finished: EndedPackets, index: NDArray[np.int64]) -> list[DeliveredPackets]:
        if not len(index):
            return []
        patch, gateway = self._patch_and_port(finished)
        self._count_latency(finished, index)
        rows = np.empty(len(index), dtype=STREAM_ROW)
        start = np.empty(len(self._wiring.patches) + 1, dtype=np.int64)
        read_stream_rows(
            index, finished.packet_id, finished.t_ns, patch, gateway, self._pool.rows, start, rows
        )
        return [
            DeliveredPackets(
                p, PacketKind.READING, rows[a:b], rows["gateway"][a:b], rows["t_delivered_ns"][a:b]
            )
            for p, (a, b) in enumerate(pairwise(start.tolist()))
            if b > a
        ]

    def _patch_and_port(self, finished: EndedPackets) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the patch of each packet's cell, and the port at which the packet arrived."""
        patch = self._wiring.patch_of_cell[self._pool.rows["cell"][finished.packet_id]]
        return patch, self._wiring.topology.dst_port[finished.link]

    def _count_latency(self, finished: EndedPackets, index: NDArray[np.int64]) -> None:
        sampled_ns = self._pool.rows["t_sampled_ns"][finished.packet_id[index]]
        self._latency.add(finished.t_ns[index] - sampled_ns)
