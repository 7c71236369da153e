"""Supervisor of the processes of a run: starts, monitors and stops them.

A process that fails is reported with its name and its last log lines. If the deployment does not allow its
loss, the others get SIGTERM, then SIGKILL. Their standard input is a pipe of this process: if it is killed,
the pipe closes, and they end by themselves.
"""

import asyncio
import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from skinnet.deployment import Deployment
from skinnet.errors import ProcessFailedError, SkinnetError
from skinnet.protocol.channels import EXTERNAL, RECORDER, Keys, Role
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.run.process_list import ProcessSpec, process_list
from skinnet.run.progress import ProgressDisplay
from skinnet.runtime.outcome import Outcome, ProcessFailure, ProcessReport
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.worker import EXIT_STOPPED
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import join_loop

__all__ = ["run_processes"]

_UNIX_SOCKET_SCHEME = "unixsock-stream/"
_POLL_PERIOD_S = 0.02
_STOP_TIMEOUT_S = 3.0
_N_LAST_LINES = 8
_THREAD_LIMITS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Thread limits of the numerical libraries: one per process, since the processes run in parallel."""


@dataclass
class _ChildProcess:
    spec: ProcessSpec
    process: asyncio.subprocess.Process
    log: Path

    def last_lines(self) -> tuple[str, ...]:
        text = self.log.read_text(errors="replace") if self.log.exists() else ""
        return tuple(text.strip().splitlines()[-_N_LAST_LINES:])

    def exit_description(self) -> str:
        code = self.process.returncode
        assert code is not None
        return f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"


@contextlib.contextmanager
def _hub_endpoint() -> Iterator[str]:
    """Create a private Unix socket endpoint for the hub: no port conflicts, no external clients."""
    with tempfile.TemporaryDirectory(prefix="skinnet-") as folder:
        yield f"{_UNIX_SOCKET_SCHEME}{folder}/hub"


async def run_processes(
    deployment: Deployment,
    base: Path,
    out: Path,
    progress: ProgressDisplay,
    observers: ObserverEndpoint | None,
    record: bool = False,
) -> Outcome:
    """Run `deployment` in separate processes.

    Args:
        deployment: Deployment to run.
        base: Base folder of its relative paths.
        out: Run folder with `deployment.json`; `logs/` and `parts/` are written there.
        progress: Progress display.
        observers: Observer endpoint.
        record: Write a recording.

    Raises:
        ProcessFailedError: a required process failed; names it, with its last log lines.
    """
    for folder in ("parts", "logs"):
        shutil.rmtree(out / folder, ignore_errors=True)  # of an earlier run in this folder
    resolved = out / "deployment.json"
    with _hub_endpoint() as hub:
        children: list[_ChildProcess] = []
        try:
            specs = process_list(deployment, record)
            also = ("--also", RECORDER) if record else ()
            cpus = _assign_cores(specs) if deployment.run.pin else [[]] * len(specs)
            for spec, own in zip(specs, cpus, strict=True):
                children.append(await _start(spec, hub, resolved, base, out, own, also))
            follower = asyncio.create_task(_connect_launcher(deployment, hub, progress, observers))
            pids = {child.spec.name: child.process.pid for child in children}
            async with monitor_processes(pids | {"launcher": os.getpid()}, observers, progress):
                try:
                    faults = await _wait_for_exits(children, progress)
                finally:
                    await _disconnect_launcher(follower, observers)
        finally:
            await _stop_all(children)
    return _outcome(children, faults, out)


def _assign_cores(specs: Sequence[ProcessSpec]) -> list[list[int]]:
    """Assign one core to each process, round robin from an offset by launcher, so that parallel runs spread.

    The recorder may use all cores: no process depends on it.
    """
    if not hasattr(os, "sched_getaffinity"):
        return [[]] * len(specs)
    cores = sorted(os.sched_getaffinity(0))
    return [
        cores if spec.role is Role.RECORDER else [cores[(os.getpid() + i) % len(cores)]]
        for i, spec in enumerate(specs)
    ]


async def _start(
    spec: ProcessSpec,
    hub: str,
    resolved: Path,
    base: Path,
    out: Path,
    cores: list[int],
    extra_arguments: tuple[str, ...],
) -> _ChildProcess:
    log = out / "logs" / f"{spec.name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    role = "--listen" if spec.name == "body" else "--connect"
    arguments = ("--deployment", resolved, "--base", base, "--name", spec.name, "--parts", out / "parts")
    with log.open("wb") as stderr:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            spec.module,
            *map(str, arguments),
            role,
            hub,
            *extra_arguments,
            *(("--cpus", *map(str, cores)) if cores else ()),
            stdin=asyncio.subprocess.PIPE,
            stdout=stderr,
            stderr=stderr,
            env=os.environ | _THREAD_LIMITS,
        )
    return _ChildProcess(spec, process, log)


async def _connect_launcher(
    deployment: Deployment, hub: str, progress: ProgressDisplay, observers: ObserverEndpoint | None
) -> LoopTransport:
    """Connect to the loop for the progress display and the observer endpoint."""
    keys = Keys(deployment.robot)
    await _wait_for_socket(Path(hub.removeprefix(_UNIX_SOCKET_SCHEME)))
    transport = await asyncio.to_thread(join_loop, keys, EXTERNAL, hub)
    transport.enable_recording(1)  # messages of external clients
    progress.subscribe(transport.session, keys)
    if observers is not None:
        observers.attach(transport)
    return transport


async def _wait_for_socket(socket: Path) -> None:
    """Wait for the hub's socket: a Zenoh session that waits for its hub cannot be cancelled."""
    while not socket.exists():  # noqa: ASYNC110, ASYNC240 -- no event for a new file; the check is short
        await asyncio.sleep(_POLL_PERIOD_S)


async def _disconnect_launcher(
    connecting: "asyncio.Task[LoopTransport]", observers: ObserverEndpoint | None
) -> None:
    if observers is not None:
        observers.detach()
    with contextlib.suppress(asyncio.CancelledError, SkinnetError):
        if not connecting.done():
            connecting.cancel()
        transport = await connecting
        await asyncio.to_thread(transport.close)


async def _wait_for_exits(children: list[_ChildProcess], progress: ProgressDisplay) -> list[ProcessFailure]:
    """Wait for all processes; return the failures that the deployment tolerates.

    Raises:
        ProcessFailedError: a required process failed.
    """
    faults: list[ProcessFailure] = []
    waiting = {asyncio.create_task(child.process.wait()): child for child in children}
    try:
        while waiting:
            ended, _ = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            dead = [child for task in ended if (child := waiting.pop(task)).process.returncode != 0]
            if not dead:
                continue
            culprits = [child for child in dead if not child.spec.loss_tolerated]
            if culprits:
                raise _failure_error(_first_cause(culprits, children))
            for child in dead:
                faults.append(ProcessFailure(child.spec.name, child.exit_description(), child.last_lines()))
                progress.print_line(
                    f"{child.spec.name} {child.exit_description()}; the run goes on without it"
                )
    finally:
        for task in waiting:
            task.cancel()
    return faults


def _first_cause(failed: list[_ChildProcess], children: list[_ChildProcess]) -> _ChildProcess:
    """Select the first cause of simultaneous failures: a process killed by a signal, else the first."""
    killed = [c for c in children if (code := c.process.returncode) is not None and code < 0]
    return (killed or failed)[0]


def _failure_error(child: _ChildProcess) -> ProcessFailedError:
    lines = child.last_lines()
    said = "; its last lines:\n    " + "\n    ".join(lines) if lines else ", and said nothing"
    return ProcessFailedError(f"{child.spec.name} {child.exit_description()}{said}")


async def _stop_all(children: list[_ChildProcess]) -> None:
    """Terminate the running processes (SIGTERM); kill those still running after a timeout (SIGKILL)."""
    running = [child.process for child in children if child.process.returncode is None]
    for process in running:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
    if running:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_STOP_TIMEOUT_S):
                await asyncio.gather(*(process.wait() for process in running))
    for process in running:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()


def _outcome(children: list[_ChildProcess], failures: list[ProcessFailure], out: Path) -> Outcome:
    parts, reports = [], []
    for child in children:
        code = child.process.returncode
        try:
            part = ProcessResult.load(out / "parts", child.spec.name)
        except FileNotFoundError:
            part = ProcessResult(child.spec.name, child.spec.role.value)
        else:
            parts.append(part)
        cpu_s, peak_mb = part.facts.get("cpu_s", 0.0), part.facts.get("peak_mb", 0.0)
        reports.append(
            ProcessReport(child.spec.role.value, child.spec.name, child.process.pid, cpu_s, peak_mb, code)
        )
    failed = [c for c in children if c.process.returncode == EXIT_STOPPED]
    kind = "interrupted" if failed else "completed_with_losses" if failures else "completed"
    return Outcome(kind, parts, reports, failures)
