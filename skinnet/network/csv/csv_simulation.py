"""CSV simulation: files of links and packets to files of deliveries and drops, in streaming memory."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from gzip import GzipFile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.errors import DeploymentError
from skinnet.files import atomic_replacement
from skinnet.network.csv.csv_tables import INT64_RANGE, ColumnSpec, Table, read_blocks
from skinnet.network.csv.csv_topology import NODE_RANGE, CsvTopology, read_links, read_routes
from skinnet.network.kernel import MAX_SIZE_BYTES
from skinnet.network.latency_histogram import LatencyHistogram
from skinnet.network.packet_ids import IdSet, PacketSlots
from skinnet.network.packet_network import EndedPackets, PacketNetwork
from skinnet.network.records import NEVER_NS, Outcome
from skinnet.network.routes import min_hop_routes

__all__ = ["SimulationFiles", "simulate_csv"]

_PACKET_COLUMNS = (
    ColumnSpec("id", *INT64_RANGE),
    ColumnSpec("t_ns", 0, NEVER_NS - 1),
    ColumnSpec("node", *NODE_RANGE),
    ColumnSpec("dest", *NODE_RANGE),
    ColumnSpec("size_bytes", 1, MAX_SIZE_BYTES),
)
_ROUTES_PER_PORTION = 2**22
_CAUSES = np.array([outcome.name.lower() for outcome in Outcome])


@dataclass(frozen=True)
class SimulationFiles:
    """Input and output files; names that end in `.gz` are gzipped.

    Attributes:
        links: Input `src,src_port,dst,dst_port,bits_per_s,bits_per_byte,delay_ns,queue_packets`, optionally
            `loss_probability,jitter_ns,bit_error_rate`.
        packets: Input `id,t_ns,node,dest,size_bytes`, in order of time.
        delivered: Output `id,t_delivered_ns`, by time, then node, then order of handling.
        routes: Input `node,dest,src_port`; routes of fewest hops if None.
        drops: Output `id,t_ns,node,cause` in the same order; not written if None.
    """

    links: Path
    packets: Path
    delivered: Path
    routes: Path | None = None
    drops: Path | None = None


def simulate_csv(
    files: SimulationFiles,
    until_ns: int,
    *,
    seed: int = 0,
    progress: Callable[[float], None] = lambda _: None,
) -> dict[str, Any]:
    """Simulate packets of a file in a network until `until_ns`, exclusive; return flat metrics.

    Args:
        files: Input and output files; outputs are replaced atomically at the end.
        until_ns: End of the simulation [ns].
        seed: Seed of loss, jitter and bit errors.
        progress: Called repeatedly with the fraction of the packets file read, 0 to 1.

    Raises:
        DeploymentError: A file is invalid; names file, line and error.
    """
    _require_distinct(files)
    wired = read_links(files.links)
    with ExitStack() as stack:
        run = _CsvSimulation(files, wired, until_ns, seed)
        out = stack.enter_context(_open_output(files.delivered, "id,t_delivered_ns"))
        drops = stack.enter_context(_open_output(files.drops, "id,t_ns,node,cause")) if files.drops else None
        for table, share in _read_packets(files.packets):
            now_ns = run.enqueue(table)
            run.write(run.advance(now_ns), out, drops)
            progress(share)
        run.write(run.advance(until_ns), out, drops)
        progress(1.0)
    return run.metrics()


class _CsvSimulation:
    """CSV simulation run: the network, the ids of its packets and their latencies."""

    def __init__(self, files: SimulationFiles, wired: CsvTopology, until_ns: int, seed: int) -> None:
        topology = wired.topology
        self._csv_topology, self._until_ns = wired, until_ns
        self._network = PacketNetwork(
            topology, seed=seed, node_keys=wired.nodes.view(np.uint64), hop_limit=topology.n_nodes
        )
        self._routed = np.zeros(topology.n_nodes, dtype=np.bool_)
        if files.routes is not None:
            self._network.set_routes(0, read_routes(files.routes, wired))
            self._routed[:] = True
        self._ids, self._slots, self._latencies = IdSet(), PacketSlots(), LatencyHistogram()
        self._last_ns, self._n_not_offered, self._total_bytes = 0, 0, 0

    def enqueue(self, table: Table) -> int:
        """Enqueue the packets of a table before `until_ns`; return the time to which to advance [ns]."""
        t_ns = table.integers("t_ns")
        backwards = np.diff(t_ns, prepend=self._last_ns) < 0
        if backwards.any():
            row = int(np.argmax(backwards))
            before = t_ns[row - 1] if row else self._last_ns
            table.reject_row(row, f"t_ns is {t_ns[row]} after {before}; packets must be in order of time")
        if (again := self._ids.add(table.integers("id"))) is not None:
            table.reject_row(
                again, f"id {table.integers('id')[again]} is duplicated; give each packet its own"
            )
        node, dest = (self._csv_topology.node_indices(table, name) for name in ("node", "dest"))
        self._last_ns = int(t_ns[-1]) if t_ns.size else self._last_ns
        n = int(np.searchsorted(t_ns, self._until_ns))
        self._n_not_offered += t_ns.size - n
        size_bytes = table.integers("size_bytes")[:n]
        self._require_time_range(table, size_bytes)
        self._find_routes(dest[:n])
        slots = self._slots.allocate(table.integers("id")[:n], t_ns[:n])
        self._network.enqueue(t_ns[:n], node[:n], dest[:n], size_bytes, slots)
        return min(self._last_ns, self._until_ns)

    def advance(self, until_ns: int) -> EndedPackets:
        """Advance the network; return the packets that ended before `until_ns`."""
        return self._network.advance(until_ns)

    def write(self, finished: EndedPackets, out: IO[bytes], drops: IO[bytes] | None) -> None:
        """Write deliveries, and drops if wanted."""
        ids, entered_ns = self._slots.release(finished.packet_id)
        arrived = finished.outcome == Outcome.DELIVERED
        self._latencies.add(finished.t_ns[arrived] - entered_ns[arrived])
        out.write(_format_rows("%d,%d\n", ids[arrived], finished.t_ns[arrived]))
        if drops is not None:
            lost = ~arrived
            nodes, causes = self._csv_topology.nodes[finished.node[lost]], _CAUSES[finished.outcome[lost]]
            drops.write(_format_rows("%d,%d,%d,%s\n", ids[lost], finished.t_ns[lost], nodes, causes))

    def metrics(self) -> dict[str, Any]:
        """Return all metrics by flat name."""
        counters, links = self._network.counters, self._network.link_counters
        dropped = sum(counters.dropped.values())
        return {
            "nodes": self._csv_topology.topology.n_nodes,
            "links": self._csv_topology.topology.n_links,
            "until_ns": self._until_ns,
            "packets.offered": counters.offered,
            "packets.delivered": counters.delivered,
            "packets.dropped": dropped,
            **{f"packets.dropped.{c.name.lower()}": n for c, n in counters.dropped.items()},
            "packets.in_flight": counters.in_flight,
            "packets.conserved": counters.are_conserved,
            "packets.not_before_until": self._n_not_offered,
            "packet_hops": int(links.packets.sum()),
            **self._latencies.metrics(),
            "links.utilisation.largest": float(links.busy_ns.max() / max(self._until_ns, 1)),
            "links.queue_high_water": int(links.queue_high_water.max()),
        }

    def _find_routes(self, dest: NDArray[np.int64]) -> None:
        """Compute routes to new destinations, in portions of bounded memory."""
        fresh = np.unique(dest[~self._routed[dest]])
        self._routed[fresh] = True
        portion = max(1, _ROUTES_PER_PORTION // self._csv_topology.topology.n_nodes)
        for start in range(0, fresh.size, portion):
            routes = min_hop_routes(self._csv_topology.topology, fresh[start : start + portion])
            self._network.set_routes(self._network.now_ns, routes)

    def _require_time_range(self, table: Table, size_bytes: NDArray[np.int64]) -> None:
        """Refuse packets that could be in flight at the end of 64-bit time, 146 years from the start."""
        topology = self._csv_topology.topology
        self._total_bytes += int(size_bytes.sum())
        bits = self._total_bytes * int(topology.bits_per_byte.max())
        hop_ns = int(topology.delay_ns.max()) + int(topology.jitter_ns.max())
        waits_ns = (bits * 10**9 // int(topology.bits_per_s.min()) + hop_ns) * topology.n_nodes
        if self._last_ns + waits_ns >= NEVER_NS and len(table):
            table.reject_row(
                len(table) - 1,
                "packets up to this line could keep a link busy beyond the 64-bit time range of 146 years; "
                "raise bits_per_s, or lower delay_ns or size_bytes",
            )


def _read_packets(path: Path) -> Iterator[tuple[Table, float]]:
    """Yield the packets table by table, and the fraction of the file read."""
    try:
        raw = path.open("rb")
        size = path.stat().st_size
    except OSError as error:
        raise DeploymentError(f"{path}: {error.strerror}; give a readable CSV file") from error
    for table in read_blocks(path, _PACKET_COLUMNS, raw):
        yield table, (min(raw.tell() / size, 1.0) if size and not raw.closed else 0.0)


def _format_rows(form: str, *columns: ArrayLike) -> bytes:
    rows = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    return "".join(map(form.__mod__, rows)).encode()


@contextmanager
def _open_output(path: Path, header: str) -> Iterator[IO[bytes]]:
    """Open an output file with this header; it replaces `path` when the block succeeds."""
    with atomic_replacement(path) as file:
        if path.suffix == ".gz":
            with GzipFile(filename="", mode="wb", fileobj=file, mtime=0, compresslevel=5) as packed:
                packed.write(header.encode() + b"\n")
                yield packed  # type: ignore[misc]
        else:
            file.write(header.encode() + b"\n")
            yield file


def _require_distinct(files: SimulationFiles) -> None:
    written = [path for path in (files.delivered, files.drops) if path is not None]
    read = [path for path in (files.links, files.packets, files.routes) if path is not None]
    for path in written:
        if path.is_dir():
            raise DeploymentError(f"{path}: is a directory; give an output file")
        if [other.resolve() for other in (*read, *written)].count(path.resolve()) > 1:
            raise DeploymentError(f"{path}: used more than once; give every output file its own name")
