"""Network topology: numbered nodes and directed links between their ports."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.graph_components import connected_components

__all__ = ["COLUMN_RANGES", "PROBABILITIES", "UNBOUNDED", "Topology"]

UNBOUNDED = -1
"""Unbounded queue: value of `queue_packets` without a limit."""

PROBABILITIES = ("loss_probability", "bit_error_rate")

COLUMN_RANGES = {
    "src_port": (0, 2**30),
    "dst_port": (0, 2**30),
    "bits_per_s": (1, 2**60),
    "bits_per_byte": (1, 64),
    "delay_ns": (0, 2**60),
    "queue_packets": (UNBOUNDED, 2**30),
    "jitter_ns": (0, 2**50),
    **dict.fromkeys(PROBABILITIES, (0, 1)),
}
"""Allowed range, least and greatest value, of every column of a topology."""


@dataclass(frozen=True, eq=False, init=False)
class Topology:
    """Topology of nodes `0 … n_nodes − 1` and directed links `0 … n_links − 1`, connected or not.

    Every column has one entry per link; a scalar applies to all links. At one node, no two links leave by
    the same port and no two arrive at the same port; one port may serve both directions.

    Attributes:
        n_nodes: Number of nodes.
        src: Source node of the link, (n_links,).
        src_port: Port of `src`, ≥ 0.
        dst: Destination node of the link.
        dst_port: Port of `dst`, ≥ 0; at one instant a node serves its ports in this order.
        bits_per_s: Rate of the link, ≥ 1 [bit/s].
        bits_per_byte: Bits on the wire per byte of a packet, 1 to 64; 10 for a UART with start and stop bit.
        delay_ns: Delay from the end of a transmission to the full arrival at `dst` [ns].
        queue_packets: Queue capacity behind the packet in transmission; `UNBOUNDED` for any number.
        loss_probability: Probability that a packet is destroyed on the link, 0 to 1.
        jitter_ns: Upper bound of an additional delay, uniform in 0 … jitter_ns [ns].
        bit_error_rate: Probability of an error per bit, 0 to 1; the checksum detects it.

    Raises:
        ValueError: A column has the wrong length or a value outside its range, or a port is used twice.
    """

    n_nodes: int
    src: NDArray[np.int64]
    src_port: NDArray[np.int64]
    dst: NDArray[np.int64]
    dst_port: NDArray[np.int64]
    bits_per_s: NDArray[np.int64]
    bits_per_byte: NDArray[np.int64]
    delay_ns: NDArray[np.int64]
    queue_packets: NDArray[np.int64]
    loss_probability: NDArray[np.float64]
    jitter_ns: NDArray[np.int64]
    bit_error_rate: NDArray[np.float64]

    def __init__(
        self,
        n_nodes: int,
        *,
        src: ArrayLike,
        src_port: ArrayLike,
        dst: ArrayLike,
        dst_port: ArrayLike,
        bits_per_s: ArrayLike,
        bits_per_byte: ArrayLike,
        delay_ns: ArrayLike = 0,
        queue_packets: ArrayLike = UNBOUNDED,
        loss_probability: ArrayLike = 0.0,
        jitter_ns: ArrayLike = 0,
        bit_error_rate: ArrayLike = 0.0,
    ) -> None:
        if n_nodes < 1:
            raise ValueError(f"n_nodes is {n_nodes}; a topology has at least one node")
        n_links = np.asarray(src).size
        object.__setattr__(self, "n_nodes", int(n_nodes))
        for name, values in (("src", src), ("dst", dst)):
            object.__setattr__(
                self, name, _validated_column(name, values, n_links, (0, n_nodes - 1)).astype(np.int64)
            )
        for name, values in (
            ("src_port", src_port),
            ("dst_port", dst_port),
            ("bits_per_s", bits_per_s),
            ("bits_per_byte", bits_per_byte),
            ("delay_ns", delay_ns),
            ("queue_packets", queue_packets),
            ("loss_probability", loss_probability),
            ("jitter_ns", jitter_ns),
            ("bit_error_rate", bit_error_rate),
        ):
            column = _validated_column(name, values, n_links, COLUMN_RANGES[name])
            kind = np.float64 if name in PROBABILITIES else np.int64
            object.__setattr__(self, name, column.astype(kind))
        _require_unique_ports("leave", self.src, self.src_port)
        _require_unique_ports("arrive at", self.dst, self.dst_port)

    @classmethod
    def from_wires(
        cls,
        n_nodes: int,
        wires: ArrayLike,
        *,
        bits_per_s: int,
        bits_per_byte: int,
        delay_ns: int = 0,
        queue_packets: ArrayLike = UNBOUNDED,
        loss_probability: float = 0.0,
        jitter_ns: int = 0,
        bit_error_rate: float = 0.0,
    ) -> Self:
        """Build a topology of equal full-duplex wires: wire i is link 2i from a to b and 2i + 1 back.

        Args:
            n_nodes: Number of nodes.
            wires: Columns (node a, port a, node b, port b), shape (n_wires, 4).
            bits_per_s: Rate in each direction [bit/s].
            bits_per_byte: Bits on the wire per byte of a packet.
            delay_ns: Delay from the end of a transmission to the full arrival [ns].
            queue_packets: Queue capacity of each direction; one number, or one per link.
            loss_probability: Probability that a packet is destroyed.
            jitter_ns: Upper bound of an additional delay [ns].
            bit_error_rate: Probability of an error per bit.
        """
        ends = np.asarray(wires, dtype=np.int64).reshape(-1, 4)
        both = np.stack([ends, ends[:, [2, 3, 0, 1]]], axis=1).reshape(-1, 4)
        return cls(
            n_nodes,
            src=both[:, 0],
            src_port=both[:, 1],
            dst=both[:, 2],
            dst_port=both[:, 3],
            bits_per_s=bits_per_s,
            bits_per_byte=bits_per_byte,
            delay_ns=delay_ns,
            queue_packets=queue_packets,
            loss_probability=loss_probability,
            jitter_ns=jitter_ns,
            bit_error_rate=bit_error_rate,
        )

    @property
    def n_links(self) -> int:
        """Number of directed links."""
        return self.src.size

    @cached_property
    def component(self) -> NDArray[np.int64]:
        """Connected component of every node, with links taken as undirected, (n_nodes,)."""
        return connected_components(self.n_nodes, self.src, self.dst)

    @cached_property
    def members(self) -> NDArray[np.int64]:
        """Nodes grouped by component, ascending within each, (n_nodes,)."""
        return np.argsort(self.component, kind="stable")

    @cached_property
    def member_start(self) -> NDArray[np.int64]:
        """Component offsets (n_components + 1,) into `members`: c spans `member_start[c : c + 2]`."""
        return np.concatenate(([0], np.cumsum(np.bincount(self.component)))).astype(np.int64)


def _validated_column(
    name: str, values: ArrayLike, n_links: int, allowed: tuple[int, int]
) -> NDArray[np.generic]:
    lowest, highest = allowed
    column = np.asarray(values)
    if column.ndim > 1 or (column.ndim == 1 and column.size != n_links):
        raise ValueError(
            f"{name} has shape {column.shape}; give a scalar or one entry for each link, ({n_links},)"
        )
    column = np.broadcast_to(column, n_links).copy()
    outside = ~((column >= lowest) & (column <= highest))
    if outside.any():
        link = int(np.argmax(outside))
        raise ValueError(f"{name} of link {link} is {column[link]}; allowed are {lowest} to {highest}")
    return column


def _require_unique_ports(verb: str, node: NDArray[np.int64], port: NDArray[np.int64]) -> None:
    order = np.lexsort((port, node))
    twice = (np.diff(node[order]) == 0) & (np.diff(port[order]) == 0)
    if twice.any():
        at = order[int(np.argmax(twice))]
        raise ValueError(f"two links {verb} port {port[at]} of node {node[at]}; give each its own port")
