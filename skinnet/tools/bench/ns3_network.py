"""Benchmark network in ns-3: builds and runs the program in tests/data/ns3 of a checkout."""

import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet.tools.bench.workload import Workload

__all__ = ["OUTPUTS", "Ns3Run", "build", "run", "write_inputs"]

_SOURCE = Path(__file__).parents[3] / "tests" / "data" / "ns3" / "skin_network.cc"
OUTPUTS = ("ns3_delivered.csv", "ns3_drops.csv", "ns3_counters.csv")
_LIBRARIES = ("ns3-point-to-point", "ns3-network", "ns3-core")


class Ns3Run(NamedTuple):
    """Results of an ns-3 run.

    Attributes:
        cpu_s: CPU time of the event loop alone.
        hops: Packets that arrived over a link.
        delivered: Rows (packet id, t_ns), in order of time.
        dropped: Rows (packet id, t_ns, node), in order of time.
        counters: Rows (packets, bytes, queue high water), by link.
    """

    cpu_s: float
    hops: int
    delivered: NDArray[np.int64]
    dropped: NDArray[np.int64]
    counters: NDArray[np.int64]


def build(folder: Path) -> tuple[Path | None, str]:
    """Build the ns-3 program in `folder`; return its path, or None and the reason."""
    compiler = shutil.which("g++")
    if not _SOURCE.is_file():
        return None, "the program comes with the source of skinnet, in tests/data/ns3; run from a checkout"
    if compiler is None:
        return None, "no g++; on Debian: apt-get install g++ libns3-dev"
    program = folder / "skin_network"
    line = [compiler, "-O2", "-std=c++17", str(_SOURCE), "-o", str(program), *(f"-l{x}" for x in _LIBRARIES)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        first = next((x for x in done.stderr.splitlines() if "error" in x or "cannot find" in x), "it failed")
        return None, f"ns-3 does not build ({first.strip()}); on Debian: apt-get install libns3-dev"
    return program, ""


def write_inputs(folder: Path, workload: Workload) -> None:
    """Write links.csv, packets.csv and routes.csv as `skinnet network simulate` reads them."""
    topology, routes = workload.topology, workload.routes
    names = ("src", "src_port", "dst", "dst_port", "bits_per_s", "bits_per_byte", "delay_ns", "queue_packets")
    _write(folder / "links.csv", ",".join(names), *(getattr(topology, name) for name in names))
    packets = (
        np.arange(workload.n_packets),
        workload.t_ns,
        workload.node,
        workload.dest,
        workload.size_bytes,
    )
    _write(folder / "packets.csv", "id,t_ns,node,dest,size_bytes", *packets)
    _write(
        folder / "routes.csv", "node,dest,src_port", routes.node, routes.dest, topology.src_port[routes.link]
    )


def run(program: Path, folder: Path, until_ns: int) -> Ns3Run:
    """Run the ns-3 program on the inputs in `folder`, until simulated time `until_ns`.

    Raises:
        subprocess.CalledProcessError: the program failed; its error output is in `stderr`.
    """
    inputs, outputs = ("links.csv", "packets.csv", "routes.csv"), OUTPUTS
    line = [str(program), *inputs, str(until_ns), *outputs]
    done = subprocess.run(line, cwd=folder, capture_output=True, text=True, check=True)
    numbers = dict(word.split("=") for word in done.stdout.split())
    delivered, dropped, counters = (
        _read(folder / name, width) for name, width in zip(outputs, (2, 3, 3), strict=True)
    )
    return Ns3Run(float(numbers["cpu_s"]), int(numbers["hops"]), delivered, dropped, counters)


def _read(path: Path, width: int) -> NDArray[np.int64]:
    numbers = path.read_text(encoding="ascii").partition("\n")[2].replace(",", " ").split()
    return np.array(numbers, dtype=np.int64).reshape(-1, width)


def _write(path: Path, header: str, *columns: NDArray[np.int64]) -> None:
    np.savetxt(path, np.stack(columns, axis=1), fmt="%d", delimiter=",", header=header, comments="")
