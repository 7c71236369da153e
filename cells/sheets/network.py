"""The network between boards and main PC, over the same kernel as the cells' network.

A shared bus is one link: all boards enter their messages where it begins, and the PC is where it ends. What
the PC sends goes over the same link, and every board hears it there. Boards of a star or a chain are
nodes with full-duplex wires.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.sheets import BoardNetworkSpec
from skinnet.network.network import Network
from skinnet.network.results import Finished
from skinnet.network.routes import fewest_hops
from skinnet.network.topology import Topology
from skinnet.seeding import key_of

__all__ = ["BoardNetwork"]

_PC = 0
_MEDIUM = 1


class BoardNetwork:
    """Carries messages between the boards of one network and the main PC.

    Attributes:
        kernel: Nodes and links; link failures and losses are set here.
        node: (boards,) node of each board; on a bus all share one.
    """

    def __init__(self, spec: BoardNetworkSpec, name: str, boards: int, seed: int) -> None:
        """A network for `boards` boards; its random draws belong to `name`."""
        number = np.arange(boards)
        self._shared = spec.kind == "bus"
        self.node = np.full(boards, _MEDIUM) if self._shared else number + 1
        # wires lead from the PC outwards: their odd links lead towards it
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
        keys = [key_of(seed, "boards", name, node) for node in range(topology.n_nodes)]
        self.kernel = Network(topology, seed=seed, node_keys=np.array(keys, dtype=np.uint64))
        self.kernel.set_routes(0, fewest_hops(topology, np.arange(topology.n_nodes)))

    def send(
        self, t_ns: NDArray[np.int64], board: NDArray[np.int64], size_bytes: ArrayLike, ids: NDArray[np.int64]
    ) -> None:
        """Boards send messages to the PC, each array (n,); at equal times in this order."""
        self.kernel.offer(t_ns, self.node[board], np.full(len(board), _PC), size_bytes, ids)

    def ask(self, t_ns: int, board: int, size_bytes: int, number: int) -> None:
        """The PC sends a message to a board, not before now."""
        t_ns = max(t_ns, self.kernel.now_ns)
        a, b = (_MEDIUM, _PC) if self._shared else (_PC, int(self.node[board]))
        self.kernel.offer([t_ns], [a], [b], [size_bytes], [number])

    def advance(self, until_ns: int) -> Finished:
        """Lets time pass; returns the messages that ended before `until_ns`."""
        return self.kernel.advance(until_ns)
