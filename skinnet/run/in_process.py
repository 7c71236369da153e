"""All processes of a run as tasks of one event loop, over the in-memory transport."""

import asyncio
import os
from pathlib import Path

from skinnet.channels import OUTSIDE, Keys
from skinnet.deployment import Deployment
from skinnet.errors import SkinnetError
from skinnet.loop import run_loop
from skinnet.run.loads import telling_loads
from skinnet.run.outcome import Outcome, ProcessReport
from skinnet.run.processes import processes
from skinnet.run.progress import Progress
from skinnet.run.watch import Watch
from skinnet.transport.memory import MemoryHub
from skinnet.worker import build_node, part_of

__all__ = ["run_in_process"]


async def run_in_process(
    deployment: Deployment, base: Path, out: Path, progress: Progress, watch: Watch | None = None
) -> Outcome:
    """Runs `deployment` in this process.

    Args:
        deployment: What to run.
        base: Folder that relative paths in it start from.
        out: Run folder.
        progress: Where to show how it goes.
        watch: Window for outsiders.

    Raises:
        SkinnetError: what a node could not go on with.
    """
    keys = Keys(deployment.robot)
    hub = MemoryHub()
    launcher = hub.connect(OUTSIDE)
    progress.follow(launcher, keys)
    if watch is not None:
        watch.open(launcher)
    nodes = [build_node(p.module, deployment, p.name, base, out) for p in processes(deployment)]
    try:
        async with telling_loads({"all": os.getpid()}, watch, progress), asyncio.TaskGroup() as group:
            for node in nodes:
                group.create_task(
                    run_loop(
                        node,
                        hub.connect(node.name),
                        keys,
                        deadline_s=deployment.run.deadline_s,
                        realtime=deployment.run.pace == "realtime",
                    )
                )
    except* SkinnetError as errors:
        raise errors.exceptions[0] from None
    finally:
        if watch is not None:
            watch.leave()
    parts = [part_of(node) for node in nodes]
    facts = parts[0].facts
    report = ProcessReport("all", "in_process", os.getpid(), facts["cpu_s"], facts["peak_mb"], 0)
    return Outcome("completed", parts, [report])
