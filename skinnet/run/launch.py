"""Launch of a prepared run: open the observer endpoint, run the processes to their end, measure the time."""

import asyncio
import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass

from skinnet.deployment import resolved_json
from skinnet.output_folder import OwnedFolder
from skinnet.protocol.channels import Keys
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.run.collect import EndedInProcess, EndedProcesses
from skinnet.run.context import RunContext
from skinnet.run.in_process import run_in_process
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.prepare import PreparedRun
from skinnet.run.progress import ProgressDisplay
from skinnet.run.supervisor import run_processes

__all__ = ["EndedRun", "launch"]


@dataclass(frozen=True)
class EndedRun:
    """Run that has ended.

    Attributes:
        ended: Its processes.
        wall_s: Wall time from the launch to the end of the last process [s].
        observer_counters: Counters of the observer endpoint; empty if there was none or nobody used it.
    """

    ended: EndedInProcess | EndedProcesses
    wall_s: float
    observer_counters: dict[str, int]


def launch(prepared: PreparedRun, folder: OwnedFolder, progress: ProgressDisplay) -> EndedRun:
    """Run a prepared deployment to its end.

    Args:
        prepared: Deployment and options.
        folder: Run folder; it has `deployment.json`.
        progress: Progress display, shown while the run lasts.

    Raises:
        SkinnetError: the endpoint is in use, or a required process failed.
    """
    start_s = time.monotonic()
    with _observer_endpoint(prepared, progress) as observers, progress:
        context = RunContext(
            prepared.deployment, prepared.base, folder, progress, observers, prepared.options.record
        )
        ended = asyncio.run(_run(context, in_process=prepared.options.in_process))
    counters = {} if observers is None else observers.counters
    return EndedRun(ended, time.monotonic() - start_s, counters)


async def _run(context: RunContext, *, in_process: bool) -> EndedInProcess | EndedProcesses:
    return await (run_in_process(context) if in_process else run_processes(context))


@contextlib.contextmanager
def _observer_endpoint(prepared: PreparedRun, progress: ProgressDisplay) -> Iterator[ObserverEndpoint | None]:
    """Open the observer endpoint, serve the deployment at it, and print it; None if nobody can observe."""
    options, deployment = prepared.options, prepared.deployment
    if not options.observable:
        yield None
        return
    with ObserverEndpoint(Keys(deployment.robot), options.observer_endpoint) as observers:
        progress.print_line(
            f"watch with any Zenoh client: connect to {observers.endpoint}, "
            f"subscribe to skinnet/{deployment.robot}/skin/**/events"
        )
        observers.serve_deployment(
            DeploymentInfo(deployment=resolved_json(deployment).decode(), base_folder=str(prepared.base))
        )
        if options.on_observer_endpoint is not None:
            options.on_observer_endpoint(observers.endpoint)
        yield observers
