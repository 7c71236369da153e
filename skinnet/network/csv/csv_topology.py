"""CSV topology: links and optional routes read from files; errors name file and line."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import DeploymentError
from skinnet.network.csv.csv_tables import INT64_RANGE, ColumnSpec, Table, read_table
from skinnet.network.routes import NO_LINK, Routes
from skinnet.network.topology import COLUMN_RANGES, PROBABILITIES, UNBOUNDED, Topology

__all__ = ["NODE_RANGE", "CsvTopology", "read_links", "read_routes"]

NODE_RANGE = INT64_RANGE
"""Range of node numbers: any 64-bit integer."""

_LINK_COLUMNS = (
    ColumnSpec("src", *NODE_RANGE),
    ColumnSpec("src_port", *COLUMN_RANGES["src_port"]),
    ColumnSpec("dst", *NODE_RANGE),
    ColumnSpec("dst_port", *COLUMN_RANGES["dst_port"]),
    ColumnSpec("bits_per_s", *COLUMN_RANGES["bits_per_s"]),
    ColumnSpec("bits_per_byte", *COLUMN_RANGES["bits_per_byte"]),
    ColumnSpec("delay_ns", *COLUMN_RANGES["delay_ns"]),
    ColumnSpec("queue_packets", *COLUMN_RANGES["queue_packets"], default=UNBOUNDED),
    ColumnSpec(
        "loss_probability", *COLUMN_RANGES["loss_probability"], is_integer=False, default=0, required=False
    ),
    ColumnSpec("jitter_ns", *COLUMN_RANGES["jitter_ns"], default=0, required=False),
    ColumnSpec(
        "bit_error_rate", *COLUMN_RANGES["bit_error_rate"], is_integer=False, default=0, required=False
    ),
)
_ROUTE_COLUMNS = (
    ColumnSpec("node", *NODE_RANGE),
    ColumnSpec("dest", *NODE_RANGE),
    ColumnSpec("src_port", *COLUMN_RANGES["src_port"]),
)


@dataclass(frozen=True, eq=False)
class CsvTopology:
    """Topology of a links file, with the file's node numbers.

    Attributes:
        file: Source file.
        topology: Topology with nodes numbered in the order of `nodes`; link i is row i of the file.
        nodes: Node numbers of the file, ascending, (n_nodes,).
    """

    file: Path
    topology: Topology
    nodes: NDArray[np.int64]

    def node_indices(self, table: Table, column: str) -> NDArray[np.int64]:
        """Map the node numbers in a column of another file to topology nodes, (n,).

        Raises:
            DeploymentError: A node has no link.
        """
        wanted = table.integers(column)
        at = np.minimum(np.searchsorted(self.nodes, wanted), self.nodes.size - 1)
        unknown = self.nodes[at] != wanted
        if unknown.any():
            row = int(np.argmax(unknown))
            table.reject_row(row, f"{column} {wanted[row]} has no link; allowed are the nodes of {self.file}")
        return at.astype(np.int64)


def read_links(path: Path) -> CsvTopology:
    """Read the topology of a links file.

    Raises:
        DeploymentError: The file is invalid; names file, line and error.
    """
    table = read_table(path, _LINK_COLUMNS)
    if len(table) == 0:
        raise DeploymentError(f"{path}:2: no links; give at least one")
    src, dst = table.integers("src"), table.integers("dst")
    _require_unique_ports(table, "leaves", src, table.integers("src_port"))
    _require_unique_ports(table, "arrives at", dst, table.integers("dst_port"))
    nodes = np.unique(np.concatenate((src, dst)))
    columns = {name: table.columns[name] for name in (*COLUMN_RANGES, *PROBABILITIES)}
    columns |= {"src": np.searchsorted(nodes, src), "dst": np.searchsorted(nodes, dst)}
    return CsvTopology(path, Topology(nodes.size, **columns), nodes)


def read_routes(path: Path, csv_topology: CsvTopology) -> Routes:
    """Read the routes of a file: at `node`, a packet for `dest` leaves by `src_port`.

    Raises:
        DeploymentError: The file is invalid, an entry has no link or is duplicated, or the routes to a
            destination form a loop; names file, line and error.
    """
    table = read_table(path, _ROUTE_COLUMNS)
    topology = csv_topology.topology
    node, dest, port = (
        csv_topology.node_indices(table, "node"),
        csv_topology.node_indices(table, "dest"),
        table.integers("src_port"),
    )
    link = _links_at_ports(topology, node, port)
    if (nowhere := link == NO_LINK).any():
        row = int(np.argmax(nowhere))
        ports = np.sort(topology.src_port[topology.src == node[row]])
        shown = ", ".join(map(str, ports[:16].tolist())) + (" …" if ports.size > 16 else "")
        table.reject_row(
            row,
            f"no link leaves port {port[row]} of node {csv_topology.nodes[node[row]]}; "
            + (f"its links leave ports {shown}" if ports.size else "no link leaves this node"),
        )
    apart = topology.component[node] != topology.component[dest]
    if apart.any():
        row = int(np.argmax(apart))
        table.reject_row(
            row,
            f"no path between node {csv_topology.nodes[node[row]]} and dest {csv_topology.nodes[dest[row]]}",
        )
    by_entry = np.lexsort((node, dest))
    twice = (np.diff(dest[by_entry]) == 0) & (np.diff(node[by_entry]) == 0)
    if twice.any():
        at = int(np.argmax(twice))
        first, second = by_entry[at], by_entry[at + 1]
        table.reject_row(
            int(second),
            f"a route from {csv_topology.nodes[node[second]]} to {csv_topology.nodes[dest[second]]} is "
            f"already on line {table.line[first]}; give one route per node and dest",
        )
    _require_loop_free(table, csv_topology, node[by_entry], dest[by_entry], link[by_entry], by_entry)
    return Routes(node, dest, link)


def _require_unique_ports(table: Table, verb: str, node: NDArray[np.int64], port: NDArray[np.int64]) -> None:
    order = np.lexsort((port, node))
    twice = (np.diff(node[order]) == 0) & (np.diff(port[order]) == 0)
    if twice.any():
        rows = order[1:][twice]
        row = int(rows.min())
        first = order[np.flatnonzero(order == row)[0] - 1]
        table.reject_row(
            row,
            f"a second link {verb} port {port[row]} of node {node[row]}, the first is on line "
            f"{table.line[first]}; give each its own port",
        )


def _links_at_ports(
    topology: Topology, node: NDArray[np.int64], port: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the links (n,) that leave these ports of these nodes; `NO_LINK` where there is none."""
    order = np.lexsort((topology.src_port, topology.src))
    span = int(max(port.max(initial=0), topology.src_port.max())) + 1
    keys = topology.src[order] * span + topology.src_port[order]
    wanted = node * span + port
    at = np.minimum(np.searchsorted(keys, wanted), keys.size - 1)
    return np.where(keys[at] == wanted, order[at], NO_LINK)


def _require_loop_free(
    table: Table,
    csv_topology: CsvTopology,
    node: NDArray[np.int64],
    dest: NDArray[np.int64],
    link: NDArray[np.int64],
    row: NDArray[np.int64],
) -> None:
    """Refuse routing loops by pointer doubling over all routes; entries are in order of (dest, node)."""
    n_nodes, end = csv_topology.topology.n_nodes, node.size
    keys = dest * n_nodes + node
    onward = csv_topology.topology.dst[link]
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
    names = [str(csv_topology.nodes[node[e]]) for e in around]
    shown = names if len(names) <= 12 else [*names[:6], "…", *names[-5:]]
    table.reject_row(
        int(row[around[0]]),
        f"the routes to {csv_topology.nodes[dest[around[0]]]} form a loop: {' → '.join([*shown, names[0]])}; "
        "every route must end at its dest, or at a node without a route to it",
    )
