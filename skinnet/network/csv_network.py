"""CSV topology: links and optional routes read from files; errors name file and line."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import DeploymentError
from skinnet.network.csv_files import INT64, Column, Table, read_whole
from skinnet.network.routes import NO_LINK, Routes
from skinnet.network.topology import ALLOWED, PROBABILITIES, UNBOUNDED, Topology

__all__ = ["NODE", "Wired", "read_links", "read_routes"]

NODE = INT64
"""Range of node numbers: any 64-bit integer."""

_LINKS = (
    Column("src", *NODE),
    Column("src_port", *ALLOWED["src_port"]),
    Column("dst", *NODE),
    Column("dst_port", *ALLOWED["dst_port"]),
    Column("bits_per_s", *ALLOWED["bits_per_s"]),
    Column("bits_per_byte", *ALLOWED["bits_per_byte"]),
    Column("delay_ns", *ALLOWED["delay_ns"]),
    Column("queue_packets", *ALLOWED["queue_packets"], empty=UNBOUNDED),
    Column("loss_probability", *ALLOWED["loss_probability"], whole=False, empty=0, required=False),
    Column("jitter_ns", *ALLOWED["jitter_ns"], empty=0, required=False),
    Column("bit_error_rate", *ALLOWED["bit_error_rate"], whole=False, empty=0, required=False),
)
_ROUTES = (Column("node", *NODE), Column("dest", *NODE), Column("src_port", *ALLOWED["src_port"]))


@dataclass(frozen=True, eq=False)
class Wired:
    """Topology of a links file, with the file's node numbers.

    Attributes:
        file: Source file.
        topology: Topology with nodes numbered in the order of `nodes`; link i is row i of the file.
        nodes: Node numbers of the file, ascending, (n_nodes,).
    """

    file: Path
    topology: Topology
    nodes: NDArray[np.int64]

    def index(self, table: Table, column: str) -> NDArray[np.int64]:
        """Map the node numbers in a column of another file to topology nodes, (n,).

        Raises:
            DeploymentError: A node has no link.
        """
        wanted = table.whole(column)
        at = np.minimum(np.searchsorted(self.nodes, wanted), self.nodes.size - 1)
        unknown = self.nodes[at] != wanted
        if unknown.any():
            row = int(np.argmax(unknown))
            table.refuse(
                row, f"{column} {wanted[row]} is at no link; allowed are nodes that stand in {self.file}"
            )
        return at.astype(np.int64)


def read_links(path: Path) -> Wired:
    """Read the topology of a links file.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    table = read_whole(path, _LINKS)
    if len(table) == 0:
        raise DeploymentError(f"{path}:2: no link; give at least one")
    src, dst = table.whole("src"), table.whole("dst")
    _require_own_ports(table, "leaves", src, table.whole("src_port"))
    _require_own_ports(table, "arrives at", dst, table.whole("dst_port"))
    nodes = np.unique(np.concatenate((src, dst)))
    columns = {name: table.columns[name] for name in (*ALLOWED, *PROBABILITIES)}
    columns |= {"src": np.searchsorted(nodes, src), "dst": np.searchsorted(nodes, dst)}
    return Wired(path, Topology(nodes.size, **columns), nodes)


def read_routes(path: Path, wired: Wired) -> Routes:
    """Read the routes of a file: at `node`, a packet for `dest` leaves by `src_port`.

    Raises:
        DeploymentError: The file is invalid, an entry has no link or is duplicated, or the routes to a
            destination form a loop; names file, line and error.
    """
    table = read_whole(path, _ROUTES)
    topology = wired.topology
    node, dest, port = wired.index(table, "node"), wired.index(table, "dest"), table.whole("src_port")
    link = _leaving(topology, node, port)
    if (nowhere := link == NO_LINK).any():
        row = int(np.argmax(nowhere))
        ports = np.sort(topology.src_port[topology.src == node[row]])
        shown = ", ".join(map(str, ports[:16].tolist())) + (" …" if ports.size > 16 else "")
        table.refuse(
            row,
            f"no link leaves port {port[row]} of node {wired.nodes[node[row]]}; "
            + (f"its links leave ports {shown}" if ports.size else "no link leaves this node at all"),
        )
    apart = topology.component[node] != topology.component[dest]
    if apart.any():
        row = int(np.argmax(apart))
        table.refuse(row, f"no links join node {wired.nodes[node[row]]} and dest {wired.nodes[dest[row]]}")
    by_entry = np.lexsort((node, dest))
    twice = (np.diff(dest[by_entry]) == 0) & (np.diff(node[by_entry]) == 0)
    if twice.any():
        at = int(np.argmax(twice))
        first, second = by_entry[at], by_entry[at + 1]
        table.refuse(
            int(second),
            f"a route from {wired.nodes[node[second]]} to {wired.nodes[dest[second]]} is already on line "
            f"{table.line[first]}; give one way for each node and dest",
        )
    _require_no_round(table, wired, node[by_entry], dest[by_entry], link[by_entry], by_entry)
    return Routes(node, dest, link)


def _require_own_ports(table: Table, verb: str, node: NDArray[np.int64], port: NDArray[np.int64]) -> None:
    order = np.lexsort((port, node))
    twice = (np.diff(node[order]) == 0) & (np.diff(port[order]) == 0)
    if twice.any():
        rows = order[1:][twice]
        row = int(rows.min())
        first = order[np.flatnonzero(order == row)[0] - 1]
        table.refuse(
            row,
            f"a second link {verb} port {port[row]} of node {node[row]}, the first is on line "
            f"{table.line[first]}; give each its own port",
        )


def _leaving(topology: Topology, node: NDArray[np.int64], port: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the links (n,) that leave these ports of these nodes; `NO_LINK` where there is none."""
    order = np.lexsort((topology.src_port, topology.src))
    span = int(max(port.max(initial=0), topology.src_port.max())) + 1
    keys = topology.src[order] * span + topology.src_port[order]
    wanted = node * span + port
    at = np.minimum(np.searchsorted(keys, wanted), keys.size - 1)
    return np.where(keys[at] == wanted, order[at], NO_LINK)


def _require_no_round(
    table: Table,
    wired: Wired,
    node: NDArray[np.int64],
    dest: NDArray[np.int64],
    link: NDArray[np.int64],
    row: NDArray[np.int64],
) -> None:
    """Refuse routing loops by pointer doubling over all routes; entries are in order of (dest, node)."""
    n_nodes, end = wired.topology.n_nodes, node.size
    keys = dest * n_nodes + node
    onward = wired.topology.dst[link]
    wanted = dest * n_nodes + onward
    at = np.minimum(np.searchsorted(keys, wanted), max(end - 1, 0))
    goes_on = (keys[at] == wanted) & (onward != dest)
    following = np.append(np.where(goes_on, at, end), end)
    far = following
    for _ in range(int(n_nodes).bit_length()):
        far = far[far]
    endless = np.flatnonzero((far[:-1] != end) & (node != dest))
    if endless.size == 0:
        return
    entry = int(far[endless[0]])  # far enough to be on the loop itself
    around = [entry]
    while (entry := int(following[entry])) != around[0]:
        around.append(entry)
    start = int(np.argmin(row[around]))
    around = around[start:] + around[:start]
    names = [str(wired.nodes[node[e]]) for e in around]
    shown = names if len(names) <= 12 else [*names[:6], "…", *names[-5:]]
    table.refuse(
        int(row[around[0]]),
        f"the routes to {wired.nodes[dest[around[0]]]} go round: {' → '.join([*shown, names[0]])}; "
        "every route must end at its dest, or at a node that has no route to it",
    )
