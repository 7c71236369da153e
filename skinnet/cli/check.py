"""Command `skinnet check`: a deployment, validated and listed, and its body settled at home."""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skinnet.cli.console import (
    DeploymentArgument,
    JsonOption,
    SettingsOption,
    console,
    examples,
    write_report,
)
from skinnet.clock import NS_PER_S
from skinnet.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from skinnet.deployment import Deployment

__all__ = ["register"]

_MAX_SETTLE_S = 600.0
_EXAMPLES = examples(
    "skinnet check deployments/hrp2_touch.toml",
    "skinnet check deployments/hrp2_touch.toml --set cell_processes=per_patch --channels",
    "skinnet check deployments/hrp2_touch.toml --resolved > resolved.toml",
    "skinnet check deployments/two_link_arm.toml --settle 0.5 --json -",
)


def register(app: typer.Typer) -> None:
    """Register the command `check`."""
    app.command(epilog=_EXAMPLES)(check)


def check(
    file: DeploymentArgument,
    settings: SettingsOption = None,
    channels: Annotated[
        bool, typer.Option("--channels", help="Lists the channels too: keys, messages, senders, receivers.")
    ] = False,
    resolved: Annotated[
        bool,
        typer.Option(
            "--resolved",
            help="Prints the deployment as TOML instead, with all that it extends, settings and defaults.",
        ),
    ] = False,
    settle: Annotated[
        float | None,
        typer.Option(help="Simulates body and servos at home for so long [s], without network."),
    ] = None,
    json: JsonOption = None,
) -> None:
    """Check a deployment and list its parts.

    All that a run checks is checked, with the model, the skin and the memory. What of the model's file is
    left out or overridden is listed. With --settle, the body is simulated for some time: forces on the skin,
    drift of joints, energy.
    """
    if channels and resolved:
        raise UsageError("--channels and --resolved exclude each other: give one of them")
    if resolved and (settle is not None or json is not None):
        raise UsageError("--resolved prints TOML: leave out --settle and --json")
    if json is not None and settle is None:
        raise UsageError("--json writes the metrics of --settle: give both")
    if settle is not None and not (math.isfinite(settle) and 0.0 < settle <= _MAX_SETTLE_S):
        raise UsageError(f"--settle {settle:g}: must be above 0 and at most {_MAX_SETTLE_S:g} s")
    from skinnet.body.contact.contact_notices import contact_notices
    from skinnet.cli.deployment_listing import (
        print_channels,
        print_deployment,
        print_settling,
        resolved_toml,
    )
    from skinnet.deployment.extends import read_layers
    from skinnet.run.prepare import RunOptions, prepare_run

    prepared = prepare_run(RunOptions(file, tuple(settings or ())))
    deployment = prepared.deployment
    if resolved:
        sys.stdout.write(resolved_toml(deployment, file))
        return
    terminal = console(stderr=json == "-")
    print_deployment(terminal, deployment, [layer.path for layer in reversed(read_layers(file))])
    for line in prepared.left_out:
        said = f"left out of {deployment.body.model}: {line}"
        terminal.print(said, highlight=False, markup=False, soft_wrap=True)
    for line in contact_notices(deployment, prepared.base):
        terminal.print(f"note: {line}", highlight=False, markup=False, soft_wrap=True)
    if channels:
        print_channels(terminal, deployment.robot)
    if settle is not None:
        metrics = _settle(terminal, deployment, file, settle)
        print_settling(terminal, settle, metrics)
        write_report({"deployment": deployment.name, "settle_s": settle, "metrics": metrics}, json)


def _settle(terminal: "Console", deployment: "Deployment", file: Path, duration_s: float) -> dict[str, Any]:
    """Settle the body for `duration_s` [s], rounded to a whole number of physics steps; show the progress."""
    from rich.progress import Progress

    from skinnet.body.settling import settle

    step_ns = deployment.body.timestep_ns
    duration_ns = max(round(duration_s * NS_PER_S / step_ns), 1) * step_ns
    with Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        task = progress.add_task("settling", total=1.0)
        return settle(
            deployment, file.parent, duration_ns, lambda fraction: progress.update(task, completed=fraction)
        )
