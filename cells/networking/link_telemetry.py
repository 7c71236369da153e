"""Link telemetry for observers: traffic and state of links, and cells without power."""

import numpy as np
from numpy.typing import NDArray

from cells.networking.wiring import Wiring
from skinnet.network.packet_network import PacketNetwork
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import encode
from skinnet.protocol.telemetry_messages import LINK_INTO_CELL, LINK_ROW, LINK_UP, LinkLoad

__all__ = ["LinkTelemetry"]


class LinkTelemetry:
    """Link telemetry of a process, grouped by patch; links of a bridge belong to the sender's patch.

    Args:
        wiring: Cells and links of the process.
        keys: Keys of the robot.
    """

    def __init__(self, wiring: Wiring, keys: Keys) -> None:
        self._wiring = wiring
        self._keys = keys
        topology = wiring.topology
        cell_of_node = np.full(topology.n_nodes, -1)
        cell_of_node[wiring.node_of_cell] = np.arange(wiring.n_cells)
        sender, receiver = cell_of_node[topology.src], cell_of_node[topology.dst]
        inwards = sender < 0  # sent by the computer
        self._cell = np.where(inwards, receiver, sender)
        patch = wiring.patch_of_cell[self._cell]
        self._order = np.lexsort((np.arange(len(patch)), patch))
        self._bounds = np.searchsorted(patch[self._order], np.arange(len(wiring.patches) + 1))
        self._rows = np.zeros(topology.n_links, dtype=LINK_ROW)
        self._rows["cell"] = self._cell - wiring.first_cell[patch]
        self._rows["port"] = np.where(inwards, topology.dst_port, topology.src_port)
        self._direction_flag = np.where(inwards, LINK_INTO_CELL, 0).astype(np.uint8)

    def messages(
        self, network: PacketNetwork, powered: NDArray[np.bool_], t_ns: int
    ) -> list[tuple[str, bytes]]:
        """Return keys and encoded `LinkLoad` messages of all patches.

        Args:
            network: Kernel with the state and the counters of the links.
            powered: (cells,) True for cells that have power.
            t_ns: Time up to which the network has been simulated [ns].
        """
        counters = network.link_counters
        for name, column in counters._asdict().items():
            self._rows[name] = column
        self._rows["state"] = self._direction_flag | np.where(network.link_up, LINK_UP, 0).astype(np.uint8)
        rows = self._rows[self._order]
        told = []
        first_cell = self._wiring.first_cell.tolist()
        for number, patch in enumerate(self._wiring.patches):
            dark = np.flatnonzero(~powered[first_cell[number] : first_cell[number + 1]]).tolist()
            links = rows[self._bounds[number] : self._bounds[number + 1]]
            load = LinkLoad(patch=patch.name, t_ns=t_ns, rows=links.tobytes(), unpowered_cells=dark)
            told.append((self._keys.of("links", patch.name), encode(load)))
        return told
