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

from skinnet.errors import SkinnetError, UnreachableError
from skinnet.protocol.channels import EXTERNAL
from skinnet.run.child_process import ChildProcess, assign_cores, start_process, stop_processes
from skinnet.run.collect import RESULT_FOLDER, EndedProcesses
from skinnet.run.context import RunContext
from skinnet.run.exits import ExitWatch
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import hub_socket, join_loop, socket_endpoint

__all__ = ["run_processes"]

_POLL_PERIOD_S = 0.02
_ATTEMPT_TIMEOUT_S = 1.0


async def run_processes(context: RunContext) -> EndedProcesses:
    """Run all processes separately, to their end; `logs/` and `parts/` of the run folder are written.

    Raises:
        ProcessFailedError: a required process failed or is silent; names the first cause.
    """
    children: list[ChildProcess] = []
    with _hub_endpoint() as hub:
        try:
            specs = context.processes
            cores = assign_cores(specs) if context.deployment.run.pin else [[]] * len(specs)
            for spec, own in zip(specs, cores, strict=True):
                children.append(await start_process(context, spec, hub, own))
            pids = {child.spec.name: child.process.pid for child in children} | {"launcher": os.getpid()}
            deadline_s, results = context.deployment.run.deadline_s, context.out / RESULT_FOLDER
            watch = ExitWatch(children, results, deadline_s, _socket(hub), context.progress)
            async with (
                monitor_processes(pids, context.observers, context.progress),
                _connected_launcher(context, hub, watch),
            ):
                failures = await watch.wait()
        finally:
            await stop_processes(children)
    return EndedProcesses(tuple(child.ended() for child in children), tuple(failures))


@contextlib.contextmanager
def _hub_endpoint() -> Iterator[str]:
    """Create a private Unix socket endpoint for the hub: no port conflicts, no external clients."""
    with tempfile.TemporaryDirectory(prefix="skinnet-") as folder:
        yield socket_endpoint(f"{folder}/hub")


def _socket(hub: str) -> Path:
    socket = hub_socket(hub)
    assert socket is not None
    return socket


@contextlib.asynccontextmanager
async def _connected_launcher(context: RunContext, hub: str, watch: ExitWatch) -> AsyncIterator[None]:
    """Connect progress display and observers to the loop once the hub listens, while the block runs.

    The watch learns which processes join the run, and which are silent.
    """
    connecting = asyncio.create_task(_connect_launcher(context, hub, watch))
    try:
        yield
    finally:
        context.detach()
        with contextlib.suppress(asyncio.CancelledError, SkinnetError):
            if not connecting.done():
                connecting.cancel()
            transport = await connecting
            await asyncio.to_thread(transport.close)


async def _connect_launcher(context: RunContext, hub: str, watch: ExitWatch) -> LoopTransport:
    """Connect to the hub once it listens; in short attempts, since one that waits cannot be cancelled."""
    deadline_s = context.deployment.run.deadline_s
    while True:
        await _wait_for_socket(_socket(hub))
        with contextlib.suppress(UnreachableError):
            transport = await asyncio.to_thread(
                join_loop, context.keys, EXTERNAL, hub, deadline_s, _ATTEMPT_TIMEOUT_S
            )
            break
    context.attach(transport)

    def on_process(key: str, present: bool) -> None:
        if present:
            watch.joined.add(key.rsplit("/", 1)[-1])

    def on_silent(key: str, _payload: bytes) -> None:
        loop.call_soon_threadsafe(watch.kill_silent, key.rsplit("/", 1)[-1])

    loop = asyncio.get_running_loop()
    transport.session.declare_subscriber(context.keys.silent("*"), on_silent)
    transport.session.declare_liveliness_subscriber(context.keys.liveliness("*", "*"), on_process)
    return transport


async def _wait_for_socket(socket: Path) -> None:
    """Wait for the hub's socket: a Zenoh session that waits for its hub cannot be cancelled."""
    while not socket.exists():  # noqa: ASYNC110, ASYNC240 -- no event for a new file; the check is short
        await asyncio.sleep(_POLL_PERIOD_S)
