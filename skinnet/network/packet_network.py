"""Packet network simulator: arrays of packets in, arrays of deliveries and drops out, exact in time."""

import copy
import heapq

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.network import kernel
from skinnet.network.memory_layout import bucket_shifts, build_state, with_capacity, with_routes
from skinnet.network.packet_checks import require_range, survey_packets
from skinnet.network.packet_results import EndedPackets, LinkCounters, PacketCounters
from skinnet.network.records import ENDED, IN_FLIGHT, NEVER_NS, NULL, KernelScratch, Outcome, Records
from skinnet.network.routes import NO_LINK, Routes
from skinnet.network.scheduled_events import (
    LinkFailure,
    LinkImpairment,
    LinkRepair,
    NetworkSnapshot,
    ScheduledEvent,
)
from skinnet.network.topology import Topology

__all__ = ["EndedPackets", "LinkCounters", "NetworkSnapshot", "PacketCounters", "PacketNetwork"]


class PacketNetwork:
    """Store-and-forward network of serial links with queues, routes, loss, jitter, bit errors and failures.

    A packet enqueued on a link at `a` is fully sent at
    `max(a, busy) + ⌈size × bits_per_byte × 10⁹ / bits_per_s⌉` and arrives after `delay_ns` and its jitter,
    never before the packet ahead of it. It is dropped if the queue behind the packet in transmission is full.
    Events at one instant are ordered: first scheduled events (failures, repairs, routes) in the order of the
    calls, then ends of transmissions, then a node's own packets in the order of offering, then those of its
    input ports in the order of ports.

    Results do not depend on how time is divided into calls to `advance`, nor, with `node_keys`, on how
    unconnected components are distributed over several networks with one seed.

    Args:
        topology: Nodes and links.
        seed: Seed of loss, jitter and bit errors.
        node_keys: Key of every node for its random draws, (n_nodes,); its number by default.
        hop_limit: Greatest number of links; a packet not at its destination after them is dropped (`TTL`).
    """

    def __init__(
        self,
        topology: Topology,
        *,
        seed: int = 0,
        node_keys: NDArray[np.uint64] | None = None,
        hop_limit: int = 255,
    ) -> None:
        keys = np.arange(topology.n_nodes, dtype=np.uint64) if node_keys is None else node_keys
        if keys.shape != (topology.n_nodes,) or keys.dtype != np.uint64:
            raise ValueError(f"node_keys is {keys.dtype} {keys.shape}; give one uint64 per node")
        arrays, self._rank = build_state(topology, seed, keys)
        self.topology = topology
        self._hop_limit = hop_limit
        self._scratch = KernelScratch(
            buckets=np.full(kernel.BUCKETS, NULL, dtype=np.uint32),
            keys=np.empty(0, dtype=np.int64),
            ended=np.empty(0, dtype=ENDED),
            n_ended=np.zeros(1, dtype=np.int64),
        )
        self._no_packets = _columns(self._scratch.ended, np.empty(0, dtype=np.int64))
        self._state = NetworkSnapshot(arrays)

    @property
    def now_ns(self) -> int:
        """Time to which the network has advanced [ns]."""
        return self._state.now_ns

    @property
    def next_event_ns(self) -> int:
        """Lower bound of the next event time, unless more is offered or scheduled [ns]."""
        changes = self._state.scheduled_events
        return min(self._state.next_event_ns, changes[0][0]) if changes else self._state.next_event_ns

    @property
    def counters(self) -> PacketCounters:
        """Packet counters up to now; those in flight are counted where they are, in the queues."""
        state = self._state
        ended = {outcome: int(state.arrays.outcome_counts[outcome]) for outcome in Outcome}
        delivered = ended.pop(Outcome.DELIVERED)
        return PacketCounters(state.offered, delivered, ended, self.pending_packet_id.size)

    @property
    def pending_packet_id(self) -> NDArray[np.int64]:
        """Ids of the packets that are queued or on a link now, by walking the queues; (n,)."""
        packet_id = np.empty(self._state.arrays.packets.size, dtype=np.int64)
        return packet_id[: kernel.pending_packets(self._state.arrays, packet_id)]

    @property
    def link_counters(self) -> LinkCounters:
        """Link counters up to now."""
        links = self._state.arrays.links[self._rank]
        # A link transmits without a break until `busy_ns`, so its remaining work is known.
        busy_ns = links["committed_ns"] - np.maximum(links["busy_ns"] - self._state.now_ns, 0)
        high_water = links["queue_high_water"].astype(np.int64)
        return LinkCounters(links["packets"], links["bytes"], busy_ns, high_water, links["dropped"])

    @property
    def memory_bytes(self) -> int:
        """Memory of the state and scratch arrays, without the topology [bytes]."""
        return sum(array.nbytes for array in (*self._state.arrays, *self._scratch))

    @property
    def link_up(self) -> NDArray[np.bool_]:
        """Link status (n_links,): True where the link is up."""
        return np.asarray(self._state.arrays.links["up"][self._rank], dtype=np.bool_)

    def enqueue(
        self,
        t_ns: ArrayLike,
        node: ArrayLike,
        dest: ArrayLike,
        size_bytes: ArrayLike,
        packet_id: ArrayLike,
        link: ArrayLike | None = None,
    ) -> None:
        """Enqueue packets at their nodes, each array (n,), in any order of time.

        Args:
            t_ns: Time of entry, not before `now_ns` [ns]. Equal times keep the order of offering.
            node: Node of entry.
            dest: Destination node; ignored where `link` is given.
            size_bytes: Packet size [bytes], at least 1.
            packet_id: Any number, returned with the packet; may be reused once its packet has ended.
            link: Link of `node` for link-local packets, delivered at its far end, or `NO_LINK`.

        Raises:
            ValueError: A value is outside its range; no packet was enqueued.
        """
        state = self._state
        t_ns, node, dest, size_bytes, packet_id = (
            np.ascontiguousarray(column, dtype=np.int64)
            for column in (t_ns, node, dest, size_bytes, packet_id)
        )
        n = t_ns.size
        rank = np.full(n, NULL, dtype=np.int64)
        link = np.full(n, NO_LINK) if link is None else np.ascontiguousarray(link, dtype=np.int64)
        if any(column.shape != (n,) for column in (node, dest, size_bytes, packet_id, link)):
            raise ValueError("packet columns differ in length; give arrays of equal length")
        if n == 0:
            return
        local = link != NO_LINK
        last_node = self.topology.n_nodes - 1
        sound, sorted_, any_local, least = survey_packets(
            t_ns, node, dest, size_bytes, link, state.now_ns, last_node
        )
        if not sound:
            require_range("t_ns", t_ns, state.now_ns, NEVER_NS - 1)
            require_range("node", node, 0, last_node)
            require_range("dest", np.where(local, 0, dest), 0, last_node)
            require_range("size_bytes", size_bytes, 1, kernel.MAX_SIZE_BYTES)
        if any_local:
            require_range("link", link, NO_LINK, self.topology.n_links - 1)
            if (self.topology.src[link[local]] != node[local]).any():
                raise ValueError("a link-local packet names a link that does not leave its node")
            rank[local] = self._rank[link[local]]
        if not sorted_:
            order = np.argsort(t_ns, kind="stable")
            t_ns, node, dest, size_bytes, packet_id, rank = (
                column[order] for column in (t_ns, node, dest, size_bytes, packet_id, rank)
            )
        if least < state.min_size_bytes:
            state.min_size_bytes = least
            state.arrays.components["bucket_shift"] = bucket_shifts(self.topology, least)
        state.arrays = with_capacity(state.arrays, n)
        kernel.enqueue(t_ns, node, dest, size_bytes, packet_id, rank, state.arrays)
        state.offered += n
        state.next_event_ns = min(state.next_event_ns, int(t_ns[0]))

    def advance(self, until_ns: int) -> EndedPackets:
        """Advance to `until_ns`; return the packets that ended before.

        Raises:
            ValueError: `until_ns` is before `now_ns`.
        """
        state = self._state
        if until_ns < state.now_ns:
            raise ValueError(f"until_ns is {until_ns}; the network is already at {state.now_ns}")
        if self.next_event_ns >= until_ns:
            state.now_ns = until_ns
            return self._no_packets
        if (in_flight := int(state.arrays.pool[IN_FLIGHT])) > self._scratch.keys.size:
            self._scratch = self._scratch._replace(
                keys=np.empty(2 * in_flight, dtype=np.int64), ended=np.empty(2 * in_flight, dtype=ENDED)
            )
        self._scratch.n_ended[0] = 0
        while state.scheduled_events and state.scheduled_events[0][0] < until_ns:
            t_ns, _, change = heapq.heappop(state.scheduled_events)
            self._run(t_ns)
            self._apply(t_ns, change)
        self._run(until_ns)
        ended = self._scratch.ended[: self._scratch.n_ended[0]]
        return _columns(ended, np.lexsort((ended["node"], ended["t_ns"])))

    def fail_link(self, t_ns: int, link: int) -> None:
        """Schedule a link failure at `t_ns`: packets not fully arrived, and later ones, are dropped."""
        self._schedule_event(t_ns, LinkFailure(self._rank_of(link)))

    def repair_link(self, t_ns: int, link: int) -> None:
        """Schedule a link repair at `t_ns`; the link is then empty."""
        self._schedule_event(t_ns, LinkRepair(self._rank_of(link)))

    def impair_link(
        self,
        t_ns: int,
        link: int,
        *,
        loss_probability: float | None = None,
        jitter_ns: int | None = None,
        bit_error_rate: float | None = None,
    ) -> None:
        """Schedule a link impairment from `t_ns` on; None leaves a value unchanged.

        Loss and bit errors apply to packets that arrive from `t_ns` on, jitter [ns] to those that depart.

        Raises:
            ValueError: A value is outside its range.
        """
        given = {
            "loss_probability": loss_probability,
            "jitter_ns": jitter_ns,
            "bit_error_rate": bit_error_rate,
        }
        values = {name: value for name, value in given.items() if value is not None}
        self._schedule_event(t_ns, LinkImpairment(self._rank_of(link), values))

    def set_routes(self, t_ns: int, routes: Routes) -> None:
        """Schedule new route table entries at `t_ns`; queued packets stay in their queue.

        Raises:
            ValueError: An entry leads to another component, or over a link that does not leave its node.
        """
        component, node, dest = self.topology.component, routes.node, routes.dest
        if (component[node] != component[dest]).any():
            raise ValueError("a route leads to another connected component, to which there is no path")
        leads = routes.link != NO_LINK
        if (self.topology.src[routes.link[leads]] != node[leads]).any():
            raise ValueError("a route uses a link that does not leave its node")
        rank = np.full(node.size, NULL, dtype=np.int64)
        rank[leads] = self._rank[routes.link[leads]]
        change = Routes(node.copy(), dest.copy(), rank)
        if t_ns == self.now_ns and not (
            self._state.scheduled_events and self._state.scheduled_events[0][0] <= t_ns
        ):
            self._apply(t_ns, change)  # no earlier event: apply at once
        else:
            self._schedule_event(t_ns, change)

    def snapshot(self) -> NetworkSnapshot:
        """Return a copy of the time-varying state."""
        return copy.deepcopy(self._state)

    def restore(self, snapshot: NetworkSnapshot) -> None:
        """Restore the state of `snapshot`, taken from a network of the same topology."""
        self._state = copy.deepcopy(snapshot)

    def _rank_of(self, link: int) -> int:
        if not 0 <= link < self.topology.n_links:
            raise ValueError(f"link is {link}; allowed are 0 to {self.topology.n_links - 1}")
        return int(self._rank[link])

    def _schedule_event(self, t_ns: int, event: ScheduledEvent) -> None:
        state = self._state
        if t_ns < state.now_ns:
            raise ValueError(f"t_ns is {t_ns}; the network is already at {state.now_ns}")
        heapq.heappush(state.scheduled_events, (t_ns, state.n_scheduled, event))
        state.n_scheduled += 1

    def _run(self, until_ns: int) -> None:
        state = self._state
        if state.next_event_ns < until_ns:
            state.next_event_ns = kernel.advance(until_ns, self._hop_limit, state.arrays, self._scratch)
        state.now_ns = until_ns

    def _apply(self, t_ns: int, event: ScheduledEvent) -> None:
        state = self._state
        links = state.arrays.links
        match event:
            case LinkFailure(rank):
                kernel.fail_link(rank, t_ns, state.arrays, self._scratch)
            case LinkRepair(rank):
                links["up"][rank] = 1
            case LinkImpairment(rank, values):
                for name, value in values.items():
                    links[name][rank] = value
            case Routes(node, dest, rank):
                state.arrays = with_routes(state.arrays, self.topology, node, dest, rank)


def _columns(ended: Records, order: NDArray[np.int64]) -> EndedPackets:
    """Return the columns of `ENDED` records in this order; column-wise, faster than whole records."""
    return EndedPackets(*(ended[name][order].astype(np.int64) for name in EndedPackets._fields))
