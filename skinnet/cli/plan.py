"""Command `skinnet plan`: link budget of a deployment before it runs."""

import time
from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    OutOption,
    PlotsOption,
    SettingsOption,
    console,
    examples,
    write_report,
)
from skinnet.errors import DeploymentError

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet plan deployments/hrp2_touch.toml",
    "skinnet plan deployments/h1_1260.toml --encoding periodic --latency-ms 2 --json -",
    "skinnet plan deployments/hrp2_touch.toml --set power.link_ohm=0.2 --voltage 3.1",
)
_DPI = 130


def register(app: typer.Typer) -> None:
    """Register the command `plan`."""
    app.command(epilog=_EXAMPLES)(plan)


def plan(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    latency_ms: Annotated[
        float | None, typer.Option(help="Highest worst-case latency of a cell [ms].")
    ] = None,
    utilisation: Annotated[float | None, typer.Option(help="Highest load of a link, 0 to 1.")] = None,
    voltage: Annotated[float | None, typer.Option(help="Lowest voltage of a cell [V].")] = None,
    encoding: Annotated[
        str | None,
        typer.Option(metavar="periodic|send_on_delta|level_crossing", help="Encoding of the cells."),
    ] = None,
    stimulated: Annotated[
        float | None, typer.Option(help="Fraction of the cells that are stimulated, 0 to 1.")
    ] = None,
    events_hz: Annotated[float | None, typer.Option(help="Event rate of a stimulated cell [1/s].")] = None,
    idle_events_hz: Annotated[float | None, typer.Option(help="Event rate of any other cell [1/s].")] = None,
    out: OutOption = None,
    json: JsonOption = None,
    plots: PlotsOption = True,
) -> None:
    """Compute the link budget of a deployment.

    The budget has link loads, latencies, cell voltages, and the fewest sufficient gateways.
    """
    from skinnet.cli.plan_table import print_plan
    from skinnet.covering.covered_deployment import load_covered
    from skinnet.deployment import resolved_json
    from skinnet.deployment.checks import check
    from skinnet.files import write_json
    from skinnet.output_folder import new_folder, own_folder
    from skinnet.tools.plan.json_report import plan_report
    from skinnet.tools.plan.plan import make_plan

    given = {
        "max_latency_ms": latency_ms,
        "max_utilisation": utilisation,
        "min_voltage_v": voltage,
        "encoding": encoding,
        "stimulated_fraction": stimulated,
        "event_rate_hz": events_hz,
        "idle_event_rate_hz": idle_events_hz,
    }
    options = tuple(f"plan.{key}={value}" for key, value in given.items() if value is not None)
    deployment = load_covered(file, (*(settings or ()), *options))
    try:
        check(deployment)
        if not deployment.patches:
            raise DeploymentError("patches: none; a plan needs a network of cells")
        made = make_plan(deployment)
    except DeploymentError as error:
        raise DeploymentError(f"{file}: {error}") from None
    result = plan_report(made)
    terminal = console(stderr=json == "-")
    write_report(result, json)
    print_plan(terminal, result)
    if not plots and out is None:
        return
    folder = out or new_folder(Path("runs") / f"{file.stem}-plan-{time.strftime('%Y%m%d-%H%M%S')}")
    with own_folder(folder, "skinnet plan", resolved_json(deployment), ("plan.json", "plan.png")):
        write_json(folder / "plan.json", result)
        if plots:
            from skinnet.tools.plan.plan_plot import draw_plan  # matplotlib takes a second to import

            draw_plan(made).savefig(folder / "plan.png", dpi=_DPI)
    terminal.print(f"results in {folder}", highlight=False, soft_wrap=True)
