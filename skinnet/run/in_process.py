"""Single-process run: all logical processes as tasks of one event loop, over the in-memory transport."""

import asyncio
import os
from pathlib import Path

from skinnet.channels import OUTSIDE, RECORDER, Keys
from skinnet.deployment import Deployment
from skinnet.errors import SkinnetError
from skinnet.loop import Keeping, Node, run_loop
from skinnet.run.loads import telling_loads
from skinnet.run.outcome import Fault, Outcome, ProcessReport
from skinnet.run.processes import processes
from skinnet.run.progress import Progress
from skinnet.run.watch import Watch
from skinnet.transport.memory import MemoryHub
from skinnet.worker import build_node, part_of

__all__ = ["run_in_process"]


async def run_in_process(
    deployment: Deployment,
    base: Path,
    out: Path,
    progress: Progress,
    watch: Watch | None = None,
    record: bool = False,
) -> Outcome:
    """Run `deployment` in this process.

    Args:
        deployment: Deployment to run.
        base: Base folder of its relative paths.
        out: Run folder.
        progress: Progress display.
        watch: Observer endpoint.
        record: Write a recording.

    Raises:
        SkinnetError: a logical process failed.
    """
    keys = Keys(deployment.robot)
    hub = MemoryHub()
    launcher = hub.connect(OUTSIDE)
    progress.follow(launcher, keys)
    if watch is not None:
        watch.open(launcher)
    nodes = [build_node(p.module, deployment, p.name, base, out) for p in processes(deployment, record)]
    for node in nodes:
        node.peers |= {RECORDER} if record else frozenset()
    faults: list[Fault] = []

    async def live(node: Node) -> None:
        try:
            await run_loop(
                node,
                hub.connect(node.name),
                keys,
                deadline_s=deployment.run.deadline_s,
                realtime=deployment.run.pace == "realtime",
            )
        except SkinnetError as error:
            if node.name != RECORDER or RECORDER not in deployment.run.may_be_lost:
                raise
            faults.append(Fault(node.name, str(error)))  # no process depends on it
            progress.say(f"{node.name}: {error}; the run goes on without it")

    try:
        async with telling_loads({"all": os.getpid()}, watch, progress), asyncio.TaskGroup() as group:
            for node in nodes:
                group.create_task(live(node))
    except* SkinnetError as errors:
        raise errors.exceptions[0] from None
    finally:
        for node in nodes:
            if isinstance(node, Keeping):
                node.end()
        if watch is not None:
            watch.leave()
    lost = {fault.process for fault in faults}
    parts = [part_of(node) for node in nodes if node.name not in lost]
    facts = parts[0].facts
    report = ProcessReport("all", "in_process", os.getpid(), facts["cpu_s"], facts["peak_mb"], 0)
    return Outcome("completed_with_losses" if faults else "completed", parts, [report], faults)
