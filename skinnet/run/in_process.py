"""Single-process run: all logical processes as tasks of one event loop, over the in-memory transport."""

import asyncio
import os
from pathlib import Path

from skinnet.deployment import Deployment
from skinnet.errors import SkinnetError
from skinnet.protocol.channels import EXTERNAL, RECORDER, Keys
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.run.process_list import process_list
from skinnet.run.progress import ProgressDisplay
from skinnet.runtime.loop import Closeable, LogicalProcess, run_loop
from skinnet.runtime.outcome import Outcome, ProcessFailure, ProcessReport
from skinnet.runtime.worker import build_process, result_of
from skinnet.transport.in_memory import InMemoryHub

__all__ = ["run_in_process"]


async def run_in_process(
    deployment: Deployment,
    base: Path,
    out: Path,
    progress: ProgressDisplay,
    observers: ObserverEndpoint | None = None,
    record: bool = False,
) -> Outcome:
    """Run `deployment` in this process.

    Args:
        deployment: Deployment to run.
        base: Base folder of its relative paths.
        out: Run folder.
        progress: Progress display.
        observers: Observer endpoint.
        record: Write a recording.

    Raises:
        SkinnetError: a logical process failed.
    """
    keys = Keys(deployment.robot)
    hub = InMemoryHub(keys)
    launcher = hub.connect(EXTERNAL)
    launcher.enable_recording(1)  # messages of external clients
    progress.subscribe(launcher.session, keys)
    if observers is not None:
        observers.attach(launcher)
    nodes = [build_process(p.module, deployment, p.name, base, out) for p in process_list(deployment, record)]
    for node in nodes:
        node.peers |= {RECORDER} if record else frozenset()
    faults: list[ProcessFailure] = []

    async def live(node: LogicalProcess) -> None:
        try:
            await run_loop(
                node,
                hub.connect(node.name),
                keys,
                deadline_s=deployment.run.deadline_s,
                realtime=deployment.run.pace == "realtime",
            )
        except SkinnetError as error:
            if node.name != RECORDER or RECORDER not in deployment.run.tolerated_losses:
                raise
            faults.append(ProcessFailure(node.name, str(error)))  # no process depends on it
            progress.print_line(f"{node.name}: {error}; the run goes on without it")

    try:
        async with monitor_processes({"all": os.getpid()}, observers, progress), asyncio.TaskGroup() as group:
            for node in nodes:
                group.create_task(live(node))
    except* SkinnetError as errors:
        raise errors.exceptions[0] from None
    finally:
        for node in nodes:
            if isinstance(node, Closeable):
                node.close()
        if observers is not None:
            observers.detach()
    lost = {fault.process for fault in faults}
    parts = [result_of(node) for node in nodes if node.name not in lost]
    facts = parts[0].facts
    report = ProcessReport("all", "in_process", os.getpid(), facts["cpu_s"], facts["peak_mb"], 0)
    return Outcome("completed_with_losses" if faults else "completed", parts, [report], faults)
