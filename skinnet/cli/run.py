"""Command `skinnet run`: one deployment, for one seed or several."""

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    OutOption,
    PlotsOption,
    SettingsOption,
    console,
    examples,
    require_extra,
    seed_range,
    write_report,
)
from skinnet.errors import UsageError

if TYPE_CHECKING:
    from skinnet.run.prepare import PreparedRun

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet run deployments/hrp2_touch.toml",
    "skinnet run deployments/hrp2_touch.toml --set controller.reactions.enabled=false --seed 3",
    "skinnet run deployments/hrp2_touch.toml --seeds 1-20 --set run.max_s=20 --json -",
    "skinnet run deployments/hrp2_touch.toml --set cell_processes=per_patch --out runs/seven_processes",
    "skinnet run deployments/hrp2_touch.toml --record --set run.max_s=20",
    "skinnet run deployments/hrp2_touch.toml --pace realtime --view --keep",
)


def register(app: typer.Typer) -> None:
    """Register the command `run`."""
    app.command(epilog=_EXAMPLES)(run)


def run(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, instead of the deployment's.")] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="A-B", help="Runs the deployment once for each seed from A to B.")
    ] = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Runs all processes in one, without Zenoh.")
    ] = False,
    pace: Annotated[
        str | None,
        typer.Option(metavar="lockstep|realtime", help="Pace of the run, instead of the deployment's."),
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    listen: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT", help="Observer endpoint, e.g. tcp/127.0.0.1:7447; a free port unless given."
        ),
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Records all messages in run.mcap of the run folder.")
    ] = False,
    plots: PlotsOption = True,
    view: Annotated[
        bool, typer.Option("--view", help="Serves a web page of the run and prints its address.")
    ] = False,
    control: Annotated[
        bool, typer.Option("--control", help="Adds buttons for requests to the page; needs --view.")
    ] = False,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keeps the page after the end of the run; needs --view.")
    ] = False,
) -> None:
    """Run a deployment.

    The run folder gets the summary, plots, logs and, with --record, a recording.
    """
    if (control or keep) and not view:
        raise UsageError("--control and --keep concern the page: give --view too")
    if keep and seeds is not None:
        raise UsageError("--keep and --seeds exclude each other: a page that is kept shows one run")
    if seed is not None and seeds is not None:
        raise UsageError("--seed and --seeds exclude each other: give one of them")
    numbers = None if seeds is None else seed_range(seeds)
    if record:
        require_extra("record", "mcap", "zstandard", "foxglove")
    from skinnet.cli.summary_table import print_summary
    from skinnet.output_folder import new_folder
    from skinnet.run.observers.page_process import PageProcess
    from skinnet.run.pipeline import run_once
    from skinnet.run.prepare import RunOptions, prepare_run
    from skinnet.run.progress import ProgressDisplay
    from skinnet.run.summary import summarise_seeds
    from skinnet.run.write import check_run_folder, own_seeds_folder, write_summary

    overrides = (*(settings or ()), *((f"run.pace={pace}",) if pace is not None else ()))
    options = RunOptions(file, overrides, in_process, listen, plots, record)
    terminal = console(stderr=json == "-")
    if out is not None:
        check_run_folder(out)
    first = prepare_run(options, seed if numbers is None else numbers[0])
    folder = out or new_folder(Path("runs") / f"{file.stem}-{time.strftime('%Y%m%d-%H%M%S')}")
    with contextlib.ExitStack() as pages:

        def run_prepared(prepared: "PreparedRun", single: Path) -> dict[str, Any]:
            progress = ProgressDisplay(terminal)
            if view:
                page = pages.enter_context(PageProcess(progress.print_line, keep=keep, control=control))
                prepared = replace(prepared, options=replace(options, on_observer_endpoint=page.start))
            return run_once(prepared, single, progress)

        if numbers is None:
            report = run_prepared(first, folder)
            print_summary(terminal, report, folder)
        else:
            with own_seeds_folder(folder, first.deployment) as seeds_folder:
                folders = {number: folder / f"seed-{number}" for number in numbers}
                summaries = {
                    number: run_prepared(first if number == numbers[0] else prepare_run(options, number), one)
                    for number, one in folders.items()
                }
                for number, summary in summaries.items():
                    print_summary(terminal, summary, folders[number])
                report = summarise_seeds(list(summaries.values()))
                write_summary(report, seeds_folder)
        write_report(report, json)
