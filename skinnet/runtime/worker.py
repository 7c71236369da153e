"""Process shell around a logical process: arguments, transport, loop, shutdown, result.

Exit codes: 0 finished, 1 failed with one line on standard error, 3 stopped by the launcher. A process that
lost an upstream also writes which one, for the launcher to find the first cause.
A worker ends when its standard input closes, so that a killed launcher leaves no orphans.
"""

import argparse
import asyncio
import gc
import importlib
import logging
import os
import resource
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Protocol

import msgspec

from skinnet.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.errors import SkinnetError, UpstreamLostError
from skinnet.files import write_json
from skinnet.output_folder import RunIdentity, sha256_of
from skinnet.protocol.channels import Keys
from skinnet.runtime.loop import Closeable, LogicalProcess, run_loop
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.usage import UsageTrace
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import hub_socket, join_loop, listen_for_loop

__all__ = [
    "EXIT_STOPPED",
    "LostUpstream",
    "ProcessModule",
    "build_process",
    "lost_file",
    "main",
    "result_of",
]

EXIT_STOPPED = 3
_STDIN = 0
_POLL_PERIOD_S = 0.02
_LINGER_DEADLINES = 3
"""Deadlines for which the hub stays for its clients: one may wait for another until its own deadline."""
_GC_THRESHOLD = 50_000
"""Garbage-collection threshold: periods allocate many short-lived objects without reference cycles."""
log = logging.getLogger(__name__)


class LostUpstream(msgspec.Struct, frozen=True, kw_only=True):
    """Upstream that a process lost: its name, and whether it was silent rather than gone."""

    process: str
    silent: bool


def lost_file(results: Path, name: str) -> Path:
    """Return the file in the folder of results in which process `name` says which upstream it lost."""
    return results / f"{name}.lost.json"


class ProcessModule(Protocol):
    """Process package: `python -m <package>` runs its logical process."""

    def build(
        self, deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
    ) -> LogicalProcess:
        """Build the logical process `name` of `deployment`, compiled and ready.

        `base` is the deployment's folder, `out` the run folder, to which the process may write files of its
        own. Without one it writes none. `recorded` is true if a recorder takes part in the run.
        """


def build_process(
    module: str, deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
) -> LogicalProcess:
    """Import `<module>.process` and build its logical process."""
    process: ProcessModule = importlib.import_module(f"{module}.process")
    return process.build(deployment, name, base, out, recorded=recorded)


def _arguments(module: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description="One process of a skinnet run.")
    parser.add_argument("--deployment", type=Path, required=True, help="resolved deployment (JSON)")
    parser.add_argument("--base", type=Path, required=True, help="base folder of relative paths")
    parser.add_argument("--name", required=True, help="name of this process in the deployment")
    parser.add_argument("--cpus", type=int, nargs="+", help="CPU cores to pin the process to")
    parser.add_argument(
        "--parts", type=Path, required=True, help="folder for the process result, inside the run folder"
    )
    parser.add_argument("--run", required=True, help="id of the run, which its results carry")
    parser.add_argument("--recorded", action="store_true", help="a recorder takes part in the run")
    end = parser.add_mutually_exclusive_group(required=True)
    end.add_argument("--listen", help="Zenoh endpoint to listen on as the hub")
    end.add_argument("--connect", help="Zenoh endpoint of the hub to connect to")
    return parser.parse_args()


class _StopSignal(BaseException):
    """Stop signal: the launcher stopped this process, or is gone."""


def main(module: str) -> int:
    """Run one process to its end and return its exit code."""
    args = _arguments(module)
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format=f"{args.name}: %(levelname)s %(message)s"
    )
    _install_stop_handlers()
    if args.cpus:
        _pin_to_cores(args.cpus)
    try:
        asyncio.run(_run(module, args))
    except UpstreamLostError as error:
        log.error("%s", error)
        lost = LostUpstream(process=error.process, silent=error.silent)
        write_json(lost_file(args.parts, args.name), msgspec.to_builtins(lost))
        return 1
    except SkinnetError as error:
        log.error("%s", error)
        return 1
    except _StopSignal:
        return EXIT_STOPPED
    return 0


def _pin_to_cores(cores: list[int]) -> None:
    """Pin this process to cores and set the scheduling policy SCHED_BATCH.

    Each period end wakes threads in several processes. If they preempt each other, all compute with cold
    caches (measurements in docs/decisions.md).
    """
    os.sched_setaffinity(0, cores)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _install_stop_handlers() -> None:
    """Stop on SIGTERM and when standard input closes; ignore SIGINT, which the launcher handles."""

    def stop(_signal: int, _frame: object) -> None:
        raise _StopSignal

    def outlive_nobody() -> None:
        while os.read(_STDIN, 1):  # not through a buffer, whose lock would outlive the interpreter
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, stop)
    threading.Thread(target=outlive_nobody, name="launcher", daemon=True).start()


async def _run(module: str, args: argparse.Namespace) -> None:
    document = args.deployment.read_bytes()
    deployment = from_document(msgspec.json.decode(document), str(args.deployment))
    keys = Keys(deployment.robot)
    deadline_s = deployment.run.deadline_s
    if args.listen:
        transport = listen_for_loop(keys, args.name, args.listen, deadline_s)
    else:
        _wait_for_hub(args.connect)
        transport = join_loop(keys, args.name, args.connect, deadline_s)
    statistics = transport.statistics
    node: LogicalProcess | None = None
    try:
        node = build_process(
            module, deployment, args.name, args.base, args.parts.parent, recorded=args.recorded
        )
        usage = UsageTrace(lambda: (statistics.received_bytes, statistics.sent_bytes))
        gc.freeze()
        gc.set_threshold(_GC_THRESHOLD)
        present = await run_loop(
            node,
            transport,
            keys,
            deadline_s=deadline_s,
            realtime=deployment.run.pace == "realtime",
            on_period=usage.sample,
        )
        if statistics.malformed_batches:
            node.counters["malformed_batches"] += statistics.malformed_batches
        part = result_of(node)
        part.arrays |= {"usage": usage.rows, "transit_us": statistics.transit_histogram}
        part.save(args.parts, RunIdentity(args.run, sha256_of(document)))
        if args.listen:
            await _wait_for_clients(transport, present - {node.name}, _LINGER_DEADLINES * deadline_s)
    finally:
        if isinstance(node, Closeable):
            node.close()
        transport.close()


def _wait_for_hub(endpoint: str) -> None:
    """Wait for the socket of the hub; a Zenoh session that waits for it would not stop on a signal."""
    socket = hub_socket(endpoint)
    while socket is not None and not socket.exists():
        time.sleep(_POLL_PERIOD_S)


async def _wait_for_clients(transport: LoopTransport, present: set[str], timeout_s: float) -> None:
    """Keep the hub, which relays for the others, open until their liveliness tokens are gone."""
    deadline_s = time.monotonic() + timeout_s
    while present and time.monotonic() < deadline_s:
        for key, payload in await transport.receive(0.1):
            if payload is None:
                present.discard(key.rsplit("/", 1)[-1])


def result_of(process: LogicalProcess) -> ProcessResult:
    """Return the process result with CPU time [s], peak memory [MB] and counters added."""
    part = process.result()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    part.facts["cpu_s"] = usage.ru_utime + usage.ru_stime
    part.facts["peak_mb"] = _peak_mb(usage.ru_maxrss)
    part.facts["counters"] = dict(sorted(process.counters.items()))
    return part


def _peak_mb(maxrss: int) -> float:
    """Return the peak memory [MB]; on Linux, `maxrss` includes that of the launcher before the fork."""
    status = Path("/proc/self/status")
    if status.exists():
        peaks = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM:")]
        if peaks:
            return int(peaks[0]) / 1024.0
    return maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
