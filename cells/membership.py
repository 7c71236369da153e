"""Who is part of the network, as the cells themselves and as the computer see it."""

import numpy as np
from numpy.typing import NDArray

from cells.forest import Forest
from cells.formation_driver import FormationDriver
from cells.formation_gateway import Phase
from cells.wiring import Wiring
from skinnet.messages import Topology

__all__ = ["Membership"]

_SETTLED = (Phase.COMPLETE, Phase.FAILED)


class Membership:
    """The members of a host's network.

    Attributes:
        reached: (cells,) which cells take part: they have power and an ID, also if they are cut off.
        formed_ns: When each group of patches had formed for the first time [ns]; None before.
    """

    def __init__(self, wiring: Wiring, driver: FormationDriver) -> None:
        self.reached: NDArray[np.bool_] = np.zeros(wiring.n_cells, dtype=np.bool_)
        self.formed_ns: list[int | None] = [None] * len(wiring.group_ports)
        self._wiring = wiring
        self._driver = driver
        self._group_of_patch: list[int] = wiring.group_of_patch.tolist()
        self._group_of_cell = wiring.group_of_patch[wiring.patch_of_cell]

    def look(self, t_ns: int) -> None:
        """Sees who takes part at `t_ns`."""
        for group, gateway in enumerate(self._driver.gateways):
            if self.formed_ns[group] is None and gateway.phase in _SETTLED:
                self.formed_ns[group] = t_ns
        formed = np.array([t_ns is not None for t_ns in self.formed_ns])[self._group_of_cell]
        has_id = np.array([agent.network_id > 0 for agent in self._driver.cells])
        self.reached = formed & has_id & self._driver.powered

    def version(self, patch: int) -> int:
        """How often what the computer knows of a patch's network has changed; 0 before it has formed."""
        group = self._group_of_patch[patch]
        gateway = self._driver.gateways[group]
        return gateway.version if gateway.phase in _SETTLED and self.formed_ns[group] is not None else 0

    def topology(self, patch: int, t_ns: int) -> Topology:
        """What the computer knows of a patch."""
        placed, uids = self._wiring.patches[patch], self._uids(patch)
        forest = self._forest(patch)
        return forest.topology(placed.name, int(uids[0]), len(uids), version=self.version(patch), t_ns=t_ns)

    def formed_by_patch(self) -> dict[str, int | None]:
        """When each patch had formed for the first time [ns]."""
        patches = zip(self._wiring.patches, self._group_of_patch, strict=True)
        return {patch.name: self.formed_ns[group] for patch, group in patches}

    def depth(self) -> int:
        """Hops from the cell that is farthest from its gateway."""
        forests = [gateway.forest for gateway in self._driver.gateways]
        return max((forest.members[i].hops for forest in forests for i in forest.joined), default=0)

    def missing(self, patch: int) -> int:
        """Cells of a patch that the computer does not reach."""
        forest = self._forest(patch)
        present = {forest.members[i].uid for i in forest.joined}
        return sum(uid not in present for uid in self._uids(patch).tolist())

    def cut_off(self, patch: int) -> bool:
        """Whether the computer has lost all cells of a patch."""
        return self.missing(patch) == self._wiring.patches[patch].n_cells

    def _forest(self, patch: int) -> Forest:
        return self._driver.gateways[self._group_of_patch[patch]].forest

    def _uids(self, patch: int) -> NDArray[np.int64]:
        first, last = self._wiring.first_cell[patch : patch + 2]
        return self._wiring.uid_of_cell[first:last]
