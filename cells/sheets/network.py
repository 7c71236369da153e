"""Board network: messages between boards and main PC, over the same packet kernel as cells.

A shared bus is one link: all boards inject their messages at its source node, and the PC is its destination.
Messages of the PC use the same link and are broadcast to every board. Boards of a star or a chain are nodes
with full-duplex wires.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.sheets import BoardNetworkSpec
from skinnet.network.network import Network
from skinnet.network.results import Finished
from skinnet.network.routes import fewest_hops
from skinnet.network.topology import Topology
from skinnet.seeding import StreamName, key_of

__all__ = ["BoardNetwork"]

_PC = 0
_MEDIUM = 1


class BoardNetwork:
    """Network between a set of boards and the main PC.

    Attributes:
        kernel: Packet kernel; link failures and losses are set here.
        node: (boards,) node of each board; on a bus all share one.
    """

    def __init__(self, spec: BoardNetworkSpec, name: str, boards: int, seed: int) -> None:
        """Create the network of `boards` boards; its random streams belong to `name`."""
        number = np.arange(boards)
        self._shared = spec.kind == "bus"
        self.node = np.full(boards, _MEDIUM) if self._shared else number + 1
        # wires lead away from the PC: their odd links lead towards it
        zero = np.zeros_like(number)
        match spec.kind:
            case "bus":
                wires = np.array([[_PC, 0, _MEDIUM, 0]])
            case "star":
                wires = np.column_stack([zero, number, self.node, zero])
            case "chain":
                wires = np.column_stack([number, np.minimum(number, 1), self.node, zero])
        topology = Topology.from_wires(
            int(self.node.max()) + 1,
            wires,
            bits_per_s=spec.bits_per_s,
            bits_per_byte=spec.bits_per_byte,
            delay_ns=round(spec.delay_us * 1e3),
            queue_packets=spec.queue_messages,
            loss_probability=spec.loss,
            jitter_ns=round(spec.jitter_us * 1e3),
        )
        keys = [key_of(seed, StreamName.BOARD_NETWORK, name, node) for node in range(topology.n_nodes)]
        self.kernel = Network(topology, seed=seed, node_keys=np.array(keys, dtype=np.uint64))
        self.kernel.set_routes(0, fewest_hops(topology, np.arange(topology.n_nodes)))

    def send(
        self, t_ns: NDArray[np.int64], board: NDArray[np.int64], size_bytes: ArrayLike, ids: NDArray[np.int64]
    ) -> None:
        """Send messages of boards to the PC, each array (n,); at equal times in this order."""
        self.kernel.offer(t_ns, self.node[board], np.full(len(board), _PC), size_bytes, ids)

    def ask(self, t_ns: int, board: int, size_bytes: int, number: int) -> None:
        """Send a message of the PC to a board at `t_ns`, or now if that is past."""
        t_ns = max(t_ns, self.kernel.now_ns)
        a, b = (_MEDIUM, _PC) if self._shared else (_PC, int(self.node[board]))
        self.kernel.offer([t_ns], [a], [b], [size_bytes], [number])

    def advance(self, until_ns: int) -> Finished:
        """Advance to `until_ns`; return the messages that were delivered or dropped before it."""
        return self.kernel.advance(until_ns)
