"""Supervisor of the processes of a run: starts, monitors and stops them.

A process that fails is reported with its name and its last log lines. If the deployment does not allow its
loss, the others get SIGTERM, then SIGKILL. Their standard input is a pipe of this process: if it is killed,
the pipe closes, and they end by themselves.
"""

import asyncio
import contextlib
import os
import tempfile
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

from skinnet.errors import SkinnetError
from skinnet.protocol.channels import EXTERNAL
from skinnet.run.child_process import ChildProcess, assign_cores, start_process, stop_processes
from skinnet.run.collect import EndedProcesses
from skinnet.run.context import RunContext
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.run.progress import ProgressDisplay
from skinnet.runtime.outcome import ProcessFailure
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import join_loop

__all__ = ["run_processes"]

_UNIX_SOCKET_SCHEME = "unixsock-stream/"
_POLL_PERIOD_S = 0.02


async def run_processes(context: RunContext) -> EndedProcesses:
    """Run all processes separately, to their end; `logs/` and `parts/` of the run folder are written.

    Raises:
        ProcessFailedError: a required process failed; names it, with its last log lines.
    """
    children: list[ChildProcess] = []
    with _hub_endpoint() as hub:
        try:
            specs = context.processes
            cores = assign_cores(specs) if context.deployment.run.pin else [[]] * len(specs)
            for spec, own in zip(specs, cores, strict=True):
                children.append(await start_process(context, spec, hub, own))
            pids = {child.spec.name: child.process.pid for child in children} | {"launcher": os.getpid()}
            async with (
                monitor_processes(pids, context.observers, context.progress),
                _connected_launcher(context, hub),
            ):
                failures = await _wait_for_exits(children, context.progress)
        finally:
            await stop_processes(children)
    return EndedProcesses(tuple(child.ended() for child in children), tuple(failures))


@contextlib.contextmanager
def _hub_endpoint() -> Iterator[str]:
    """Create a private Unix socket endpoint for the hub: no port conflicts, no external clients."""
    with tempfile.TemporaryDirectory(prefix="skinnet-") as folder:
        yield f"{_UNIX_SOCKET_SCHEME}{folder}/hub"


@contextlib.asynccontextmanager
async def _connected_launcher(context: RunContext, hub: str) -> AsyncIterator[None]:
    """Connect progress display and observers to the loop once the hub listens, while the block runs."""
    connecting = asyncio.create_task(_connect_launcher(context, hub))
    try:
        yield
    finally:
        context.detach()
        with contextlib.suppress(asyncio.CancelledError, SkinnetError):
            if not connecting.done():
                connecting.cancel()
            transport = await connecting
            await asyncio.to_thread(transport.close)


async def _connect_launcher(context: RunContext, hub: str) -> LoopTransport:
    await _wait_for_socket(Path(hub.removeprefix(_UNIX_SOCKET_SCHEME)))
    transport = await asyncio.to_thread(join_loop, context.keys, EXTERNAL, hub)
    context.attach(transport)
    return transport


async def _wait_for_socket(socket: Path) -> None:
    """Wait for the hub's socket: a Zenoh session that waits for its hub cannot be cancelled."""
    while not socket.exists():  # noqa: ASYNC110, ASYNC240 -- no event for a new file; the check is short
        await asyncio.sleep(_POLL_PERIOD_S)


async def _wait_for_exits(children: list[ChildProcess], progress: ProgressDisplay) -> list[ProcessFailure]:
    """Wait for all processes; return the failures that the deployment tolerates.

    Raises:
        ProcessFailedError: a required process failed.
    """
    failures: list[ProcessFailure] = []
    waiting = {asyncio.create_task(child.process.wait()): child for child in children}
    try:
        while waiting:
            ended, _ = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            failed = [child for task in ended if (child := waiting.pop(task)).process.returncode != 0]
            required = [child for child in failed if not child.spec.loss_tolerated]
            if required:
                raise _first_cause(required, children).failure_error()
            for child in failed:
                failures.append(ProcessFailure(child.spec.name, child.exit_description(), child.last_lines()))
                progress.print_line(
                    f"{child.spec.name} {child.exit_description()}; the run goes on without it"
                )
    finally:
        for task in waiting:
            task.cancel()
    return failures


def _first_cause(failed: list[ChildProcess], children: list[ChildProcess]) -> ChildProcess:
    """Select the first cause of simultaneous failures: a process killed by a signal, else the first."""
    killed = [c for c in children if (code := c.process.returncode) is not None and code < 0]
    return (killed or failed)[0]
