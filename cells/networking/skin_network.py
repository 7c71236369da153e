"""Cell-to-cell network of a process: formation, data to the gateways, configurations to the cells."""

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cells.formation.formation_driver import FormationDriver, FormationTiming
from cells.formation.membership import Membership
from cells.formation.recovery import RecoveryLog
from cells.networking.demultiplexer import DeliveredPackets, PacketDemultiplexer
from cells.networking.link_faults import Impairment
from cells.networking.outages import TopologyChange, compute_topology_changes
from cells.networking.packet_counters import PacketCounters
from cells.networking.packet_io import write_packets
from cells.networking.packet_pool import PACKET_ROW, PacketKind, PacketPool
from cells.networking.wiring import Wiring
from cells.sensing.babbling_idiots import SpuriousEvents
from cells.sensing.encoding import EncoderOutput
from skinnet.deployment.network import NetworkSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.network.packet_network import EndedPackets
from skinnet.protocol.messages import FOREVER_NS, Config

__all__ = ["SkinNetwork"]


class SkinNetwork:
    """Network of all patches of a process over the modelled links.

    Attributes:
        wiring: Nodes and links.
        kernel: Packet kernel.
        formation_driver: Driver of the formation agents.
        membership: Network membership of the cells.
        recovery_log: Recoveries from topology changes.
        demultiplexer: Demultiplexer, with counters and latencies of packets.
    """

    def __init__(
        self,
        wiring: Wiring,
        cells: CellSpec,
        spec: NetworkSpec,
        seed: int,
        *,
        topology_changes: Sequence[TopologyChange] = (),
        impairments: Iterable[Impairment] = (),
    ) -> None:
        """Create a network that has not begun to form.

        Args:
            wiring: Nodes and links.
            cells: Specification of cells, for their reaction time.
            spec: Specification of links and packets.
            seed: Seed of loss and jitter.
            topology_changes: Topology changes; the first at 0, as `compute_topology_changes` returns them.
            impairments: Changes of loss and bit errors of links, in order of time.
        """
        self.wiring = wiring
        self.kernel = wiring.packet_network(seed)
        self._spec = spec
        self._pool = PacketPool()
        self._counters = PacketCounters(PacketKind)
        timing = FormationTiming.build(cells, spec)
        self.formation_driver = FormationDriver(wiring, self.kernel, self._pool, timing, spec.control_bytes)
        self.membership = Membership(wiring, self.formation_driver)
        self.demultiplexer = PacketDemultiplexer(wiring, self._pool, self._counters)
        self.recovery_log = RecoveryLog(wiring, self.formation_driver, self.demultiplexer.undeliverable)
        self._restarted: list[int] = []
        self._topology_changes = deque(topology_changes or compute_topology_changes(wiring, (), None, ()))
        self._impairments = iter(impairments)
        self._next_impairment = next(self._impairments, None)
        self._interface_of_cell = wiring.interface_node[wiring.group_of_patch[wiring.patch_of_cell]]
        for change in self._topology_changes:
            for link in change.links_down:
                self.kernel.fail_link(change.t_ns, link)
            for link in change.links_up:
                self.kernel.repair_link(change.t_ns, link)

    def start(self, t_ns: int) -> None:
        """Switch on all powered nodes at `t_ns`; the network begins to form."""
        first = self._topology_changes.popleft()
        on, up = (
            np.ones(self.wiring.n_cells, dtype=np.bool_),
            np.ones(self.wiring.topology.n_links, dtype=np.bool_),
        )
        on[list(first.cells_off)] = False
        up[list(first.links_down)] = False
        self.formation_driver.start(t_ns, np.flatnonzero(on).tolist(), up.tolist())

    def take_restarted(self) -> NDArray[np.int64]:
        """Return the cells that were switched on again since the last call."""
        cells = np.array(self._restarted, dtype=np.int64)
        self._restarted.clear()
        return cells

    def has_change_before(self, t_ns: int) -> bool:
        """Return True if a topology change is due before `t_ns`."""
        return bool(self._topology_changes) and self._topology_changes[0].t_ns < t_ns

    def powered_at(self, t_sampled_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which cells have power when they sample, at `t_sampled_ns` (cells,), in the next period."""
        powered = self.formation_driver.powered.copy()
        end_ns = int(t_sampled_ns.max(initial=0))
        for change in self._topology_changes:
            if change.t_ns > end_ns:
                break
            later = t_sampled_ns >= change.t_ns
            off, on = list(change.cells_off), list(change.cells_on)
            powered[off] &= ~later[off]
            powered[on] |= later[on]
        return powered

    def send_samples(
        self, t_sampled_ns: NDArray[np.int64], output: EncoderOutput, readings: NDArray[np.float32]
    ) -> None:
        """Send the events and readings of cells that were sampled at `t_sampled_ns` (cells,) [ns]."""
        n_events = len(output.cell)
        n = n_events + len(output.full_cell)
        ids = self._pool.allocate(n)
        cell, t_ns = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
        write_packets(output, readings, t_sampled_ns, ids, self._pool.rows, cell, t_ns)
        self._counters.count_offered(PacketKind.EVENT, n_events)
        self._counters.count_offered(PacketKind.READING, n - n_events)
        size = np.full(n, self._spec.stream_bytes)
        size[:n_events] = self._spec.event_bytes
        self.kernel.enqueue(t_ns, self.wiring.node_of_cell[cell], self._interface_of_cell[cell], size, ids)

    def send_spurious_events(self, events: SpuriousEvents) -> None:
        """Send the spurious events of babbling-idiot cells that are members of the network."""
        heard = self.membership.is_member[events.cell]
        if not heard.any():
            return
        cell, t_ns, *columns = (column[heard] for column in events)
        ids = self._pool.allocate(len(cell))
        rows = np.zeros(len(cell), dtype=PACKET_ROW)
        rows["t_sampled_ns"], rows["cell"], rows["kind"] = t_ns, cell, PacketKind.EVENT
        for name, column in zip(
            ("modality", "channel", "event_kind", "level", "value"), columns, strict=True
        ):
            rows[name] = column
        self._pool.rows[ids] = rows
        self._counters.count_offered(PacketKind.EVENT, len(cell))
        size = np.full(len(cell), self._spec.event_bytes)
        self.kernel.enqueue(t_ns, self.wiring.node_of_cell[cell], self._interface_of_cell[cell], size, ids)

    def send_config(self, t_ns: int, cell: int, config: Config) -> None:
        """Send a configuration from the interface to a cell (index within the process) at `t_ns`."""
        node, interface = int(self.wiring.node_of_cell[cell]), int(self._interface_of_cell[cell])
        row = self._pool.allocate_object(PacketKind.CONFIG, cell, config)
        self._counters.count_offered(PacketKind.CONFIG, 1)
        self.kernel.enqueue([t_ns], [interface], [node], [self._spec.control_bytes], [row])

    def advance(self, until_ns: int) -> tuple[list[DeliveredPackets], list[tuple[int, Config]]]:
        """Advance to `until_ns`; return data by patch and configurations by cell, in order of delivery."""
        self._apply_impairments(until_ns)
        rest: list[EndedPackets] = []
        busy = False
        while self.kernel.now_ns < until_ns or not rest:
            step_ns = min(self.formation_driver.horizon_ns(until_ns), self._next_change_ns())
            busy |= not self.formation_driver.is_idle
            rest.append(self._dispatch_formation_packets(self.kernel.advance(step_ns)))
            self._apply_topology_changes(step_ns)
            self.formation_driver.process_timers(step_ns)
        # demultiplexed as one: the output of a formed patch must not depend on patches that still form
        finished = (
            rest[0] if len(rest) == 1 else EndedPackets._make(map(np.concatenate, zip(*rest, strict=True)))
        )
        received = self.demultiplexer.demultiplex(finished)
        if busy or not self.formation_driver.is_idle:
            self.membership.update(until_ns)
        self.recovery_log.update(until_ns)
        return received

    def counters(self) -> dict[str, dict[str, int]]:
        """Count packets by kind: offered, delivered, dropped by cause, in flight."""
        counts = self._counters.as_dict(self._pool.rows["kind"][self.kernel.pending_packet_id])
        return counts | {"formation": counts["formation"] | {"offered": self.formation_driver.sent}}

    def _next_change_ns(self) -> int:
        change_ns = self._topology_changes[0].t_ns if self._topology_changes else FOREVER_NS
        return max(self.kernel.now_ns, change_ns)

    def _apply_impairments(self, until_ns: int) -> None:
        """Hand the impairments up to `until_ns` to the kernel."""
        while self._next_impairment is not None and self._next_impairment.t_ns <= until_ns:
            at_ns, link, loss, bit_errors = self._next_impairment
            self.kernel.impair_link(at_ns, link, loss_probability=loss, bit_error_rate=bit_errors)
            self._next_impairment = next(self._impairments, None)

    def _apply_topology_changes(self, t_ns: int) -> None:
        """Apply the topology changes up to `t_ns`: power of agents and carriers of links."""
        while self._topology_changes and self._topology_changes[0].t_ns <= t_ns:
            change = self._topology_changes.popleft()
            for cell in change.cells_off + change.cells_on:
                self.formation_driver.set_power(cell, cell in change.cells_on)
            self.membership.switch_off(change.cells_off + change.cells_on)
            self._restarted += change.cells_on
            for link in change.links_down + change.links_up:
                self.formation_driver.schedule_carrier(change.t_ns, link, link in change.links_up)
            self.recovery_log.on_topology_change(change)

    def _dispatch_formation_packets(self, finished: EndedPackets) -> EndedPackets:
        """Dispatch formation packets to the agents that they reached; return the other packets."""
        forming = self._pool.rows["kind"][finished.packet_id] == PacketKind.FORMATION
        if not forming.any():
            return finished
        heard = EndedPackets._make(column[forming] for column in finished)
        self._counters.count_ended(PacketKind.FORMATION, heard.outcome)
        self.formation_driver.receive(heard)
        return EndedPackets._make(column[~forming] for column in finished)
