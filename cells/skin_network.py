"""Cell-to-cell network of a process: formation, data to the gateways, configurations to the cells."""

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cells.babbling import Babbling
from cells.damage import Impairment
from cells.deliveries import Delivered, Deliveries
from cells.encoding import Emission
from cells.exchange import enter
from cells.formation_driver import FormationDriver
from cells.formation_packets import round_trip_ns
from cells.membership import Membership
from cells.outages import Transition, outages
from cells.packets import PAYLOAD, PacketKind, PacketPool
from cells.recovery import Recoveries
from cells.wiring import Wiring
from skinnet.deployment.schema import CellSpec, NetworkSpec
from skinnet.messages import FOREVER_NS, Config
from skinnet.network.network import Finished
from skinnet.network.records import Outcome

__all__ = ["SkinNetwork"]


class SkinNetwork:
    """Network of all patches of a process over the modelled links.

    Attributes:
        wiring: Nodes and links.
        kernel: Packet kernel.
        formation: Driver of the formation agents.
        members: Network membership of the cells.
        recoveries: Recoveries from topology changes.
        deliveries: Demultiplexer, with counters and latencies of packets.
    """

    def __init__(
        self,
        wiring: Wiring,
        cells: CellSpec,
        spec: NetworkSpec,
        seed: int,
        *,
        transitions: Sequence[Transition] = (),
        impairments: Iterable[Impairment] = (),
    ) -> None:
        """Create a network that has not begun to form.

        Args:
            wiring: Nodes and links.
            cells: Specification of cells, for their reaction time.
            spec: Specification of links and packets.
            seed: Seed of loss and jitter.
            transitions: Topology changes; the first at 0, as `outages` returns them.
            impairments: Changes of loss and bit errors of links, in order of time.
        """
        self.wiring = wiring
        self.kernel = wiring.network(seed)
        self._spec = spec
        self._pool = PacketPool()
        reaction_ns = round(cells.reaction_us * 1e3)
        resend_ns = round_trip_ns(spec, reaction_ns)
        self.formation = FormationDriver(
            wiring,
            self.kernel,
            self._pool,
            reaction_ns=reaction_ns,
            resend_ns=resend_ns,
            settle_ns=2 * resend_ns,
            detect_ns=round(spec.detect_us * 1e3),
            size_bytes=spec.control_bytes,
        )
        self.members = Membership(wiring, self.formation)
        self.deliveries = Deliveries(wiring, self._pool)
        self.recoveries = Recoveries(wiring, self.formation, self.deliveries.lost)
        self._restarted: list[int] = []
        self._transitions = deque(transitions or outages(wiring, (), None, ()))
        self._impairments = iter(impairments)
        self._impairment = next(self._impairments, None)
        self._interface_of_cell = wiring.interface[wiring.group_of_patch[wiring.patch_of_cell]]
        self._offered = np.zeros(len(PacketKind), dtype=np.int64)
        for change in self._transitions:
            for link in change.links_down:
                self.kernel.fail_link(change.t_ns, link)
            for link in change.links_up:
                self.kernel.repair_link(change.t_ns, link)

    def start(self, t_ns: int) -> None:
        """Switch on all powered nodes at `t_ns`; the network begins to form."""
        first = self._transitions.popleft()
        on, up = (
            np.ones(self.wiring.n_cells, dtype=np.bool_),
            np.ones(self.wiring.topology.n_links, dtype=np.bool_),
        )
        on[list(first.cells_off)] = False
        up[list(first.links_down)] = False
        self.formation.start(t_ns, np.flatnonzero(on).tolist(), up.tolist())

    def restarted(self) -> NDArray[np.int64]:
        """Return the cells that were switched on again since the last call."""
        cells = np.array(self._restarted, dtype=np.int64)
        self._restarted.clear()
        return cells

    def changes_before(self, t_ns: int) -> bool:
        """Return True if a topology change is due before `t_ns`."""
        return bool(self._transitions) and self._transitions[0].t_ns < t_ns

    def has_power(self, t_sampled_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which cells have power when they sample, at `t_sampled_ns` (cells,), in the next period."""
        powered = self.formation.powered.copy()
        end_ns = int(t_sampled_ns.max(initial=0))
        for change in self._transitions:
            if change.t_ns > end_ns:
                break
            later = t_sampled_ns >= change.t_ns
            off, on = list(change.cells_off), list(change.cells_on)
            powered[off] &= ~later[off]
            powered[on] |= later[on]
        return powered

    def send_data(
        self, t_sampled_ns: NDArray[np.int64], emission: Emission, readings: NDArray[np.float32]
    ) -> None:
        """Send the events and readings of cells that were sampled at `t_sampled_ns` (cells,) [ns]."""
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

    def send_babble(self, babble: Babbling) -> None:
        """Send the spurious events of babbling-idiot cells that are members of the network."""
        heard = self.members.reached[babble.cell]
        if not heard.any():
            return
        cell, t_ns, *columns = (column[heard] for column in babble)
        ids = self._pool.take(len(cell))
        rows = np.zeros(len(cell), dtype=PAYLOAD)
        rows["t_sampled_ns"], rows["cell"], rows["kind"] = t_ns, cell, PacketKind.EVENT
        for name, column in zip(
            ("modality", "channel", "event_kind", "level", "value"), columns, strict=True
        ):
            rows[name] = column
        self._pool.rows[ids] = rows
        self._offered[PacketKind.EVENT] += len(cell)
        size = np.full(len(cell), self._spec.event_bytes)
        self.kernel.offer(t_ns, self.wiring.node_of_cell[cell], self._interface_of_cell[cell], size, ids)

    def send_config(self, t_ns: int, cell: int, config: Config) -> None:
        """Send a configuration from the interface to a cell (index within the process) at `t_ns`."""
        node, interface = int(self.wiring.node_of_cell[cell]), int(self._interface_of_cell[cell])
        row = self._pool.put_content(PacketKind.CONFIG, cell, config)
        self._offered[PacketKind.CONFIG] += 1
        self.kernel.offer([t_ns], [interface], [node], [self._spec.control_bytes], [row])

    def advance(self, until_ns: int) -> tuple[list[Delivered], list[tuple[int, Config]]]:
        """Advance to `until_ns`; return data by patch and configurations by cell, in order of delivery."""
        self._impair(until_ns)
        rest: list[Finished] = []
        busy = False
        while self.kernel.now_ns < until_ns or not rest:
            step_ns = min(self.formation.horizon_ns(until_ns), self._next_change_ns())
            busy |= not self.formation.at_rest
            rest.append(self._let_form(self.kernel.advance(step_ns)))
            self._change(step_ns)
            self.formation.ring(step_ns)
        # demultiplexed as one: the output of a formed patch must not depend on patches that still form
        finished = rest[0] if len(rest) == 1 else Finished._make(map(np.concatenate, zip(*rest, strict=True)))
        received = self.deliveries.sort(finished)
        if busy or not self.formation.at_rest:
            self.members.look(until_ns)
        self.recoveries.look(until_ns)
        return received

    def counters(self) -> dict[str, dict[str, int]]:
        """Count packets by kind: offered, delivered, dropped by cause, in flight."""
        result = {}
        self._offered[PacketKind.FORMATION] = self.formation.sent
        for kind in PacketKind:
            ended = self.deliveries.ended[kind]
            offered = int(self._offered[kind])
            entry = {"offered": offered, "in_flight": offered - int(ended.sum())}
            entry |= {outcome.name.lower(): int(ended[outcome]) for outcome in Outcome}
            result[kind.name.lower()] = entry
        return result

    def _next_change_ns(self) -> int:
        change_ns = self._transitions[0].t_ns if self._transitions else FOREVER_NS
        return max(self.kernel.now_ns, change_ns)

    def _impair(self, until_ns: int) -> None:
        """Hand the impairments up to `until_ns` to the kernel."""
        while self._impairment is not None and self._impairment.t_ns <= until_ns:
            at_ns, link, loss, bit_errors = self._impairment
            self.kernel.impair_link(at_ns, link, loss_probability=loss, bit_error_rate=bit_errors)
            self._impairment = next(self._impairments, None)

    def _change(self, t_ns: int) -> None:
        """Apply the topology changes up to `t_ns`: power of agents and carriers of links."""
        while self._transitions and self._transitions[0].t_ns <= t_ns:
            change = self._transitions.popleft()
            for cell in change.cells_off + change.cells_on:
                self.formation.switch(cell, cell in change.cells_on)
                self.members.reached[cell] = False
            self._restarted += change.cells_on
            for link in change.links_down + change.links_up:
                self.formation.line(change.t_ns, link, link in change.links_up)
            self.recoveries.note(change)

    def _let_form(self, finished: Finished) -> Finished:
        """Dispatch formation packets to the agents that they reached; return the other packets."""
        forming = self._pool.rows["kind"][finished.packet_id] == PacketKind.FORMATION
        if not forming.any():
            return finished
        heard = Finished._make(column[forming] for column in finished)
        np.add.at(self.deliveries.ended[PacketKind.FORMATION], heard.outcome, 1)
        self.formation.in_flight -= len(heard.outcome)
        for i in np.flatnonzero(heard.outcome == Outcome.DELIVERED).tolist():
            self.formation.receive(
                int(heard.t_ns[i]), int(heard.node[i]), int(heard.link[i]), int(heard.packet_id[i])
            )
        self.formation.flush()
        self._pool.free(heard.packet_id)
        return Finished._make(column[~forming] for column in finished)
