"""Network membership of cells, as seen by the cells and as known to the computer."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.formation.formation_driver import FormationDriver
from cells.formation.gateway_agent import FormationPhase
from cells.networking.wiring import Wiring
from skinnet.protocol.messages import Topology

__all__ = ["Membership"]

_FINAL_PHASES = (FormationPhase.COMPLETE, FormationPhase.FAILED)


class _GroupSnapshot(NamedTuple):
    """Membership of a group as known to the computer at the end of the last epoch.

    Attributes:
        version: Number of changes; 0 before the group has formed.
        uids: Hardware IDs of the cells in the network.
        depth: Maximum number of hops from a cell to its gateway.
    """

    version: int = 0
    uids: frozenset[int] = frozenset()
    depth: int = 0


class Membership:
    """Network membership of the cells of a process.

    Attributes:
        is_member: (cells,) True for members: cells with power and a network ID, also without a route.
        formed_ns: Time at which each group of patches had first formed [ns]; None before.
    """

    def __init__(self, wiring: Wiring, driver: FormationDriver) -> None:
        self.is_member: NDArray[np.bool_] = np.zeros(wiring.n_cells, dtype=np.bool_)
        self.formed_ns: list[int | None] = [None] * len(wiring.group_ports)
        self._snapshots = [_GroupSnapshot()] * len(wiring.group_ports)
        self._wiring = wiring
        self._driver = driver
        self._group_of_patch: list[int] = wiring.group_of_patch.tolist()
        self._group_of_cell = wiring.group_of_patch[wiring.patch_of_cell]

    def update(self, t_ns: int) -> None:
        """Update the membership at `t_ns` from the agents' states."""
        for group, gateway in enumerate(self._driver.gateways):
            if gateway.has_settled and self.formed_ns[group] is None:  # even if another epoch has begun since
                self.formed_ns[group] = t_ns
            if gateway.phase in _FINAL_PHASES and gateway.version != self._snapshots[group].version:
                forest = gateway.forest
                self._snapshots[group] = _GroupSnapshot(gateway.version, forest.joined_uids(), forest.depth())
        formed = np.array([t_ns is not None for t_ns in self.formed_ns])[self._group_of_cell]
        has_id = np.array([agent.network_id > 0 for agent in self._driver.cells])
        self.is_member = formed & has_id & self._driver.powered

    def switch_off(self, cells: Sequence[int]) -> None:
        """Remove cells whose power has changed; those that are switched on must join again."""
        self.is_member[list(cells)] = False

    def topology_version(self, patch: int) -> int:
        """Return the topology version of a patch, its number of changes; 0 before it has formed."""
        return self._snapshots[self._group_of_patch[patch]].version

    def topology_message(self, patch: int, t_ns: int) -> Topology:
        """Return the topology message of a patch, to be called when its version has changed."""
        placed, uids = self._wiring.patches[patch], self._uids(patch)
        forest = self._driver.gateways[self._group_of_patch[patch]].forest
        return forest.topology_message(
            placed.name, int(uids[0]), len(uids), version=self.topology_version(patch), t_ns=t_ns
        )

    def formed_ns_by_patch(self) -> dict[str, int | None]:
        """Return the first formation time [ns] of each patch by name; None before."""
        patches = zip(self._wiring.patches, self._group_of_patch, strict=True)
        return {patch.name: self.formed_ns[group] for patch, group in patches}

    def tree_depth(self) -> int:
        """Return the tree depth: the maximum number of hops from a cell to its gateway."""
        return max(known.depth for known in self._snapshots)

    def n_unreachable(self, patch: int) -> int:
        """Return the number of cells of a patch that are not in the computer's forest."""
        present = self._snapshots[self._group_of_patch[patch]].uids
        return sum(uid not in present for uid in self._uids(patch).tolist())

    def is_unreachable(self, patch: int) -> bool:
        """Return True if no cell of a patch is in the computer's forest."""
        return self.n_unreachable(patch) == self._wiring.patches[patch].n_cells

    def _uids(self, patch: int) -> NDArray[np.int64]:
        first, last = self._wiring.first_cell[patch : patch + 2]
        return self._wiring.uid_of_cell[first:last]
