"""Run launcher: check a deployment, run it, write its summary and plots."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment, load, resolved_json
from skinnet.deployment.checks import check
from skinnet.deployment.memory_loading import load_memory
from skinnet.errors import DeploymentError, MemoryFileError
from skinnet.files import write_bytes, write_json
from skinnet.network.faults.fault_schedule import check_targets
from skinnet.protocol.channels import Keys
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.run.in_process import run_in_process
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.progress import ProgressDisplay
from skinnet.run.summary import summarise
from skinnet.run.supervisor import run_processes
from skinnet.runtime.outcome import Outcome
from skinnet.skin.placement import place_patches, resolve_bridges
from skinnet.skin.tactile_sheets import place_sheets
from skinnet.skin.whole_skin import join_patches

__all__ = ["RunOptions", "load_and_check", "run_once"]


@dataclass(frozen=True)
class RunOptions:
    """Run options of the command line.

    Attributes:
        deployment_file: Deployment file.
        settings: `key=value` settings.
        in_process: Run all processes in one.
        observer_endpoint: Observer endpoint; a free port on loopback unless given.
        plots: Draw plots and a picture.
        record: Write all recorded channels into a file of the run folder.
        on_observer_endpoint: Called with the observer endpoint once it is open.
    """

    deployment_file: Path
    settings: tuple[str, ...] = ()
    in_process: bool = False
    observer_endpoint: str | None = None
    plots: bool = True
    record: bool = False
    on_observer_endpoint: Callable[[str], None] | None = None


def load_and_check(options: RunOptions, seed: int | None = None) -> Deployment:
    """Load a deployment and check its consistency, also with its MJCF model and its long-term memory.

    Raises:
        DeploymentError: names file, key, value, what is allowed.
    """
    deployment = load(options.deployment_file, options.settings, seed)
    try:
        check(deployment)
        placed = place_patches(deployment.patches, deployment.cells, deployment.bridges)
        check_targets(deployment, placed)
        place_sheets(deployment.surfaces, deployment.sheets)
        if deployment.power is not None:
            join_patches(placed, resolve_bridges(deployment.bridges, placed)).feed_cells(
                deployment.power.feeds
            )
        body = BodySimulation(deployment, options.deployment_file.parent)
        load_memory(deployment, options.deployment_file.parent, body.model.range_rad)
    except DeploymentError as error:
        raise DeploymentError(f"{options.deployment_file}: {error}") from None
    except MemoryFileError as error:
        raise DeploymentError(f"{options.deployment_file}: memory.read: {error}") from None
    return deployment


def run_once(
    options: RunOptions, deployment: Deployment, out: Path, progress: ProgressDisplay
) -> dict[str, Any]:
    """Run `deployment`, write its run folder and return the summary.

    Raises:
        SkinnetError: the run failed; the text is one line.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "summary.json").unlink(missing_ok=True)  # of an earlier run in this folder
    write_bytes(out / "deployment.json", resolved_json(deployment))
    start_s = time.monotonic()
    base = options.deployment_file.parent.resolve()
    with contextlib.ExitStack() as stack:
        watch = _open_observer_endpoint(options, deployment, progress)
        if watch is not None:
            stack.callback(watch.close)
            watch.serve_deployment(
                DeploymentInfo(deployment=resolved_json(deployment).decode(), base_folder=str(base))
            )
            if options.on_observer_endpoint is not None:
                options.on_observer_endpoint(watch.endpoint)
        stack.enter_context(progress)
        outcome = asyncio.run(_run(options, deployment, base, out, progress, watch))
    wall_s = time.monotonic() - start_s
    summary = summarise(deployment, base, outcome, wall_s) | {"settings": list(options.settings)}
    if watch is not None and watch.counters:
        summary["counters"]["observers"] = watch.counters
    write_json(out / "summary.json", summary)
    if options.plots:
        _draw_plots(deployment, base, outcome, out, progress.print_line)
    return summary


def _open_observer_endpoint(
    options: RunOptions, deployment: Deployment, progress: ProgressDisplay
) -> ObserverEndpoint | None:
    if options.in_process and options.observer_endpoint is None and options.on_observer_endpoint is None:
        return None
    watch = ObserverEndpoint(Keys(deployment.robot), options.observer_endpoint)
    progress.print_line(
        f"watch with any Zenoh client: connect to {watch.endpoint}, "
        f"subscribe to skinnet/{deployment.robot}/skin/**/events"
    )
    return watch


async def _run(
    options: RunOptions,
    deployment: Deployment,
    base: Path,
    out: Path,
    progress: ProgressDisplay,
    observers: ObserverEndpoint | None,
) -> Outcome:
    if options.in_process:
        return await run_in_process(deployment, base, out, progress, observers, options.record)
    return await run_processes(deployment, base, out, progress, observers, options.record)


def _draw_plots(
    deployment: Deployment, base: Path, outcome: Outcome, out: Path, print_line: Callable[[str], None]
) -> None:
    from skinnet.analysis.plots import draw_plots  # matplotlib takes a second to import

    for line in draw_plots(deployment, base, outcome, out):
        print_line(line)
