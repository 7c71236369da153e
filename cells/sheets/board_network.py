"""Board network: messages between boards and main PC, over the same packet kernel as cells.

A shared bus is one link: all boards inject their messages at its source node, and the PC is its destination.
Messages of the PC use the same link and are broadcast to every board. Boards of a star or a chain are nodes
with full-duplex wires.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.skin.sheets import BoardNetworkSpec
from skinnet.network.packet_network import PacketNetwork
from skinnet.network.packet_results import EndedPackets
from skinnet.network.routes import min_hop_routes
from skinnet.network.topology import Topology
from skinnet.random_streams import StreamName, stream_key

__all__ = ["BoardNetwork"]

_STREAM = "boards"
"""Name of the network in its random streams; frozen, as streams do not change with names."""
_PC = 0
_MEDIUM = 1


class BoardNetwork:
    """Network between a set of boards and the main PC.

    Attributes:
        kernel: Packet kernel; link failures and losses are set here.
        node_of_board: (boards,) node of each board; on a bus all share one.
    """

    def __init__(self, spec: BoardNetworkSpec, n_boards: int, seed: int) -> None:
        """Create the network of `n_boards` boards."""
        number = np.arange(n_boards)
        self._is_bus = spec.kind == "bus"
        self.node_of_board = np.full(n_boards, _MEDIUM) if self._is_bus else number + 1
        # wires lead away from the PC: their odd links lead towards it
        zero = np.zeros_like(number)
        match spec.kind:
            case "bus":
                wires = np.array([[_PC, 0, _MEDIUM, 0]])
            case "star":
                wires = np.column_stack([zero, number, self.node_of_board, zero])
            case "chain":
                wires = np.column_stack([number, np.minimum(number, 1), self.node_of_board, zero])
        topology = Topology.from_wires(
            int(self.node_of_board.max()) + 1,
            wires,
            bits_per_s=spec.bits_per_s,
            bits_per_byte=spec.bits_per_byte,
            delay_ns=round(spec.propagation_delay_us * 1e3),
            queue_packets=spec.queue_messages,
            loss_probability=spec.loss,
            jitter_ns=round(spec.jitter_us * 1e3),
        )
        keys = [stream_key(seed, StreamName.BOARD_NETWORK, _STREAM, node) for node in range(topology.n_nodes)]
        self.kernel = PacketNetwork(topology, seed=seed, node_keys=np.array(keys, dtype=np.uint64))
        self.kernel.set_routes(0, min_hop_routes(topology, np.arange(topology.n_nodes)))

    def send_to_pc(
        self, t_ns: NDArray[np.int64], board: NDArray[np.int64], size_bytes: ArrayLike, ids: NDArray[np.int64]
    ) -> None:
        """Send messages of boards to the PC, each array (n,); at equal times in this order."""
        self.kernel.enqueue(t_ns, self.node_of_board[board], np.full(len(board), _PC), size_bytes, ids)

    def send_to_board(self, t_ns: int, board: int, size_bytes: int, message_id: int) -> None:
        """Send a message of the PC to a board at `t_ns`, or now if that is past."""
        t_ns = max(t_ns, self.kernel.now_ns)
        a, b = (_MEDIUM, _PC) if self._is_bus else (_PC, int(self.node_of_board[board]))
        self.kernel.enqueue([t_ns], [a], [b], [size_bytes], [message_id])

    def advance(self, until_ns: int) -> EndedPackets:
        """Advance to `until_ns`; return the messages that were delivered or dropped before it."""
        return self.kernel.advance(until_ns)
