"""A skin network whose cells stream while its links are cut."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from small_robot import small

from cells.networking.link_faults import Impairment
from cells.networking.outages import Outage, compute_topology_changes
from cells.networking.skin_network import SkinNetwork
from cells.networking.wiring import Wiring, wire_cells
from cells.sensing.encoding import EncoderOutput
from skinnet.deployment.network import PowerSpec
from skinnet.network.records import Outcome
from skinnet.protocol.messages import FOREVER_NS
from skinnet.skin.placement import place_patch, resolve_bridges

PERIOD_NS = 4_000_000


NEVER = np.empty(0, dtype=np.int64)


FAST = {"bits_per_s": 12_000_000}


class Streaming:
    """A host's network whose cells stream at 250 Hz, each at its own time."""

    def __init__(
        self,
        *patches: dict[str, Any],
        found: Any = (),
        power: PowerSpec | None = None,
        feeds: Sequence[int] = (),
        impairments: Sequence[Impairment] = (),
        **tables: Any,
    ) -> None:
        deployment = small(*patches, **tables)
        placed = {one.name: place_patch(one, deployment.cells) for one in deployment.patches}
        groups = [[placed[name] for name in group] for group in deployment.bridged_patches()]
        bridges = resolve_bridges(deployment.bridges, tuple(placed.values()))
        self.wiring = wire_cells(groups, deployment.network, bridges)
        found = found(self.wiring) if callable(found) else found
        self.network = SkinNetwork(
            self.wiring,
            deployment.cells,
            deployment.network,
            1,
            topology_changes=compute_topology_changes(self.wiring, found, power, feeds),
            impairments=impairments,
        )
        self.network.start(0)
        self._phase_ns = np.arange(self.wiring.n_cells) * PERIOD_NS // self.wiring.n_cells
        self.received: list[NDArray[np.int64]] = []
        self.sent = 0

    def run(self, until_ns: int, step_ns: int = PERIOD_NS) -> "Streaming":
        """Rows of what is heard: cell, when it was sampled, when it was delivered."""
        network = self.network
        while network.kernel.now_ns < until_ns:
            t_ns = network.kernel.now_ns
            times_ns = t_ns + self._phase_ns
            cells = np.flatnonzero(network.membership.is_member & network.powered_at(times_ns))
            byte = NEVER.astype(np.uint8)
            words = EncoderOutput(NEVER, byte, byte, byte, byte, NEVER.astype(np.float32), cells)
            network.send_samples(times_ns, words, np.zeros((self.wiring.n_cells, 8), dtype=np.float32))
            self.sent += len(cells)
            data = []
            for end_ns in range(t_ns + step_ns, t_ns + PERIOD_NS + 1, step_ns):
                data += network.advance(end_ns)[0]
            self.received += [
                np.column_stack([one.rows["cell"], one.rows["t_sampled_ns"], one.t_ns]) for one in data
            ]
            self.check()
        return self

    def rows(self) -> NDArray[np.int64]:
        return np.vstack(self.received) if self.received else np.empty((0, 3), dtype=np.int64)

    def check(self) -> None:
        """Offered = delivered + dropped by cause + in flight, of every kind."""
        for entry in self.network.counters().values():
            assert entry["offered"] == entry["in_flight"] + sum(entry[o.name.lower()] for o in Outcome)
            assert entry["in_flight"] >= 0
        kernel = self.network.kernel.counters
        assert kernel.offered == kernel.delivered + sum(kernel.dropped.values()) + kernel.in_flight

    @property
    def dropped(self) -> int:
        reading = self.network.counters()["reading"]
        return sum(reading[o.name.lower()] for o in Outcome if o is not Outcome.DELIVERED)


def cut(wiring: Wiring, cell: int, port: int, t_ns: int, until_ns: int = FOREVER_NS) -> Outage:
    """A link that is cut in both directions."""
    link = int(wiring.link_out[wiring.node_of_cell[cell], port])
    assert link >= 0
    return Outage(t_ns, until_ns, (link, link ^ 1))
