"""Recovery of the network after topology changes: duration and packet loss of each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cells.formation.formation_driver import FormationDriver
from cells.formation.gateway_agent import FormationPhase
from cells.networking.outages import TopologyChange
from cells.networking.wiring import Wiring

__all__ = ["Recovery", "RecoveryLog"]


@dataclass
class Recovery:
    """Recovery of one group of patches from one topology change.

    Attributes:
        group: Index of the group.
        t_ns: Time of the change [ns].
        rejoined_ns: Time at which the last cell that changed its master had joined [ns]; None if none did.
        topology_complete_ns: Time at which the computer knew the new topology [ns]; None before.
        lost_packets: Data packets dropped for want of a link or a route until then, or until the next
            change; each is counted once.
    """

    group: int
    t_ns: int
    rejoined_ns: int | None = None
    topology_complete_ns: int | None = None
    lost_packets: int = 0


class RecoveryLog:
    """Log of the recoveries from topology changes.

    Attributes:
        recoveries: Recoveries in order of time.
    """

    def __init__(self, wiring: Wiring, driver: FormationDriver, undeliverable: NDArray[np.int64]) -> None:
        """Start an empty log; `undeliverable` (g,) is the live count of undeliverable packets, by group."""
        self.recoveries: list[Recovery] = []
        self._undeliverable = undeliverable
        self._counted = undeliverable.copy()
        self._wiring = wiring
        self._driver = driver
        self._open: list[tuple[Recovery, int]] = []

    def on_topology_change(self, change: TopologyChange) -> None:
        """Open a recovery for each group of patches that a topology change affects."""
        topology, wiring = self._wiring.topology, self._wiring
        links, cells = change.links_down + change.links_up, change.cells_off + change.cells_on
        nodes = [int(topology.src[link]) for link in links] + [int(wiring.node_of_cell[c]) for c in cells]
        for group in sorted({int(wiring.group_of_node[node]) for node in nodes}):
            self._attribute_losses(group)
            recovery = Recovery(group, change.t_ns)
            self.recoveries.append(recovery)
            self._open.append((recovery, self._driver.gateways[group].version))

    def update(self, t_ns: int) -> None:
        """Count lost packets, and complete the recoveries that are over by `t_ns`."""
        for group in sorted({recovery.group for recovery, _ in self._open}):
            self._attribute_losses(group)
        still = []
        for recovery, version in self._open:
            gateway = self._driver.gateways[recovery.group]
            if gateway.version == version or gateway.phase not in (
                FormationPhase.COMPLETE,
                FormationPhase.FAILED,
            ):
                still.append((recovery, version))
                continue
            recovery.topology_complete_ns = t_ns
            recovery.rejoined_ns = self._rejoined_ns(recovery)
        self._open = still

    def _attribute_losses(self, group: int) -> None:
        """Attribute the packets a group has lost since the last call to its latest open recovery."""
        latest = next((recovery for recovery, _ in reversed(self._open) if recovery.group == group), None)
        if latest is not None:
            latest.lost_packets += int(self._undeliverable[group] - self._counted[group])
        self._counted[group] = self._undeliverable[group]

    def _rejoined_ns(self, recovery: Recovery) -> int | None:
        """Return the last time [ns] after the change at which a cell of the group joined; None if none."""
        of_patch = self._wiring.group_of_patch[self._wiring.patch_of_cell] == recovery.group
        uids = self._driver.gateways[recovery.group].forest.joined_uids()
        agents = (self._driver.cells[cell] for cell in of_patch.nonzero()[0].tolist())
        joined = [a.joined_ns for a in agents if a.uid in uids and a.joined_ns is not None]
        return max((t_ns for t_ns in joined if t_ns > recovery.t_ns), default=None)
