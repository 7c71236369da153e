"""Commands `skinnet run` and `skinnet check`: one deployment, for one seed or several."""

import contextlib
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    OutOption,
    SettingsOption,
    console,
    require_extra,
    seed_range,
    write_report,
)
from skinnet.cli.deployment_listing import print_deployment
from skinnet.cli.summary_table import print_summary
from skinnet.errors import DeploymentError
from skinnet.run.observers.page_process import PageProcess
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay
from skinnet.run.summary import summarise_seeds
from skinnet.run.write import write_summary

__all__ = ["EXAMPLES", "check", "run"]

EXAMPLES = """
Examples:

  skinnet run deployments/hrp2_touch.toml

  skinnet run deployments/hrp2_touch.toml --set controller.reactions.enabled=false --seed 3

  skinnet run deployments/hrp2_touch.toml --seeds 1-20 --set 'controller.program=["structure"]' --json -

  skinnet run deployments/hrp2_touch.toml --set cell_processes=per_patch --out runs/seven_hosts

  skinnet run deployments/hrp2_touch.toml --record --set run.max_s=20

  skinnet run deployments/hrp2_touch.toml --pace realtime --view --keep

  skinnet check my_robot.toml
"""


def run(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, instead of the deployment's.")] = None,
    seeds: Annotated[str | None, typer.Option(metavar="A-B", help="Runs every seed from A to B.")] = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="Everything in one process, without Zenoh.")
    ] = False,
    pace: Annotated[
        str | None, typer.Option(metavar="lockstep|realtime", help="Instead of the deployment's.")
    ] = None,
    out: OutOption = None,
    json: JsonOption = None,
    listen: Annotated[
        str | None,
        typer.Option(metavar="ENDPOINT", help="Where watchers join, e.g. tcp/127.0.0.1:7447."),
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Writes run.mcap: all that is said, to look at and to replay.")
    ] = False,
    plots: Annotated[bool, typer.Option("--plots/--no-plots", help="Draw plots and a picture.")] = True,
    view: Annotated[bool, typer.Option("--view", help="Serve a live page; prints its address.")] = False,
    control: Annotated[bool, typer.Option("--control", help="The page has buttons for requests.")] = False,
    keep: Annotated[bool, typer.Option("--keep", help="The page stays when the run is over.")] = False,
) -> None:
    """Run a deployment."""
    if (control or keep) and not view:
        raise DeploymentError("--control and --keep are about the live page: give --view too")
    if keep and seeds is not None:
        raise DeploymentError("--keep and --seeds: a page that stays shows one run")
    overrides = (*(settings or ()), *((f"run.pace={pace}",) if pace is not None else ()))
    options = RunOptions(file, overrides, in_process, listen, plots, record)
    if record:
        require_extra("record", "mcap", "zstandard", "foxglove")
    terminal = console(stderr=json == "-")
    folder = out or Path("runs") / f"{file.stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    with contextlib.ExitStack() as pages:

        def run_seed(number: int | None, where: Path) -> dict[str, Any]:
            prepared, progress = prepare_run(options, number), ProgressDisplay(terminal)
            if view:
                page = pages.enter_context(PageProcess(progress.print_line, keep=keep, control=control))
                prepared = replace(prepared, options=replace(options, on_observer_endpoint=page.start))
            return run_once(prepared, where, progress)

        if seeds is None:
            report = run_seed(seed, folder)
            print_summary(terminal, report, folder)
        else:
            if seed is not None:
                raise DeploymentError("--seed and --seeds: give one of them")
            reports = [run_seed(number, folder / f"seed-{number}") for number in seed_range(seeds)]
            for number, single in zip(seed_range(seeds), reports, strict=True):
                print_summary(terminal, single, folder / f"seed-{number}")
            report = summarise_seeds(reports)
            write_summary(report, folder)
        write_report(report, json)


def check(file: DeploymentArgument, settings: SettingsOption = None) -> None:
    """Check a deployment; print its processes, cells, channels and periods."""
    options = RunOptions(file, tuple(settings or ()))
    print_deployment(console(), prepare_run(options).deployment)
