"""Run launcher: check a deployment, run it, write its summary and plots."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.body.simulation import Body
from skinnet.channels import Keys
from skinnet.deployment import Deployment, load, resolved_json
from skinnet.deployment.checks import check
from skinnet.deployment.recall import recall
from skinnet.errors import DeploymentError, MemoryFileError
from skinnet.files import write_bytes, write_json
from skinnet.network.faults import check_targets
from skinnet.outside_messages import Deployed
from skinnet.run.in_process import run_in_process
from skinnet.run.outcome import Outcome
from skinnet.run.progress import Progress
from skinnet.run.summary import summarise
from skinnet.run.supervise import run_processes
from skinnet.run.watch import Watch
from skinnet.skin.placement import bridges_of, place_all
from skinnet.skin.sheet import place_sheets
from skinnet.skin.whole import join

__all__ = ["Order", "prepare", "run_once"]


@dataclass(frozen=True)
class Order:
    """Run options of the command line.

    Attributes:
        file: Deployment file.
        overrides: `key=value` settings.
        in_process: Run all processes in one.
        listen: Observer endpoint; a free port on loopback unless given.
        plots: Draw plots and a picture.
        record: Write all recorded channels into a file of the run folder.
        on_watch: Called with the observer endpoint once it is open.
    """

    file: Path
    overrides: tuple[str, ...] = ()
    in_process: bool = False
    listen: str | None = None
    plots: bool = True
    record: bool = False
    on_watch: Callable[[str], None] | None = None


def prepare(order: Order, seed: int | None = None) -> Deployment:
    """Load a deployment and check its consistency, also with its MJCF model and its long-term memory.

    Raises:
        DeploymentError: names file, key, value, what is allowed.
    """
    deployment = load(order.file, order.overrides, seed)
    try:
        check(deployment)
        placed = place_all(deployment.patches, deployment.cells, deployment.bridges)
        check_targets(deployment, placed)
        place_sheets(deployment.surfaces, deployment.sheets)
        if deployment.power is not None:
            join(placed, bridges_of(deployment.bridges, placed)).feeds(deployment.power.feeds)
        body = Body(deployment, order.file.parent)
        recall(deployment, order.file.parent, body.model.range_rad)
    except DeploymentError as error:
        raise DeploymentError(f"{order.file}: {error}") from None
    except MemoryFileError as error:
        raise DeploymentError(f"{order.file}: memory.read: {error}") from None
    return deployment


def run_once(order: Order, deployment: Deployment, out: Path, progress: Progress) -> dict[str, Any]:
    """Run `deployment`, write its run folder and return the summary.

    Raises:
        SkinnetError: the run failed; the text is one line.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "summary.json").unlink(missing_ok=True)  # of an earlier run in this folder
    write_bytes(out / "deployment.json", resolved_json(deployment))
    start_s = time.monotonic()
    base = order.file.parent.resolve()
    with contextlib.ExitStack() as stack:
        watch = _watch(order, deployment, progress)
        if watch is not None:
            stack.callback(watch.close)
            watch.tell_deployment(Deployed(deployment=resolved_json(deployment).decode(), base=str(base)))
            if order.on_watch is not None:
                order.on_watch(watch.endpoint)
        stack.enter_context(progress)
        outcome = asyncio.run(_run(order, deployment, base, out, progress, watch))
    wall_s = time.monotonic() - start_s
    summary = summarise(deployment, base, outcome, wall_s) | {"settings": list(order.overrides)}
    if watch is not None and watch.counters:
        summary["counters"]["watch"] = watch.counters
    write_json(out / "summary.json", summary)
    if order.plots:
        _draw(deployment, base, outcome, out, progress.say)
    return summary


def _watch(order: Order, deployment: Deployment, progress: Progress) -> Watch | None:
    if order.in_process and order.listen is None and order.on_watch is None:
        return None
    watch = Watch(Keys(deployment.robot), order.listen)
    progress.say(
        f"watch with any Zenoh client: connect to {watch.endpoint}, "
        f"subscribe to skinnet/{deployment.robot}/skin/**/events"
    )
    return watch


async def _run(
    order: Order, deployment: Deployment, base: Path, out: Path, progress: Progress, watch: Watch | None
) -> Outcome:
    if order.in_process:
        return await run_in_process(deployment, base, out, progress, watch, order.record)
    return await run_processes(deployment, base, out, progress, watch, order.record)


def _draw(
    deployment: Deployment, base: Path, outcome: Outcome, out: Path, say: Callable[[str], None]
) -> None:
    from skinnet.run.plots import draw  # matplotlib takes a second to import

    for line in draw(deployment, base, outcome, out):
        say(line)
