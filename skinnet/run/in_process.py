"""Single-process run: all logical processes as tasks of one event loop, over the in-memory transport."""

import asyncio
import os

from skinnet.errors import SkinnetError
from skinnet.protocol.channels import EXTERNAL, RECORDER
from skinnet.run.collect import EndedInProcess
from skinnet.run.context import RunContext
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.runtime.loop import Closeable, LogicalProcess, run_loop
from skinnet.runtime.outcome import ProcessFailure
from skinnet.runtime.worker import build_process
from skinnet.transport.in_memory import InMemoryHub

__all__ = ["run_in_process"]


async def run_in_process(context: RunContext) -> EndedInProcess:
    """Run all logical processes in this process, to their end.

    Raises:
        SkinnetError: a logical process failed.
    """
    hub = InMemoryHub()
    context.attach(hub.connect(EXTERNAL))
    processes = _build(context)
    failures: list[ProcessFailure] = []
    pids = {"all": os.getpid()}
    try:
        async with monitor_processes(pids, context.observers, context.progress), asyncio.TaskGroup() as group:
            for process in processes:
                group.create_task(_run_process(context, process, hub, failures))
    except* SkinnetError as errors:
        raise errors.exceptions[0] from None
    finally:
        for process in processes:
            if isinstance(process, Closeable):
                process.close()
        context.detach()
    return EndedInProcess(tuple(processes), tuple(failures))


def _build(context: RunContext) -> list[LogicalProcess]:
    processes = [
        build_process(spec.module, context.deployment, spec.name, context.base, context.out)
        for spec in context.processes
    ]
    for process in processes:
        process.peers |= {RECORDER} if context.record else frozenset()
    return processes


async def _run_process(
    context: RunContext, process: LogicalProcess, hub: InMemoryHub, failures: list[ProcessFailure]
) -> None:
    """Run one logical process to its end; note the failure of a recorder whose loss is tolerated."""
    run = context.deployment.run
    try:
        await run_loop(
            process,
            hub.connect(process.name),
            context.keys,
            deadline_s=run.deadline_s,
            realtime=run.pace == "realtime",
        )
    except SkinnetError as error:
        if process.name != RECORDER or RECORDER not in run.tolerated_losses:
            raise
        failures.append(ProcessFailure(process.name, str(error)))  # no process depends on it
        context.progress.print_line(f"{process.name}: {error}; the run goes on without it")
