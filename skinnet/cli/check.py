"""Command `skinnet check`: a deployment, validated, listed and diagnosed, with its body settled at home."""

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from skinnet.cli.console import (
    BAD_INPUT,
    DeploymentArgument,
    JsonOption,
    SettingsOption,
    console,
    examples,
    line_printer,
    write_report,
)
from skinnet.clock import NS_PER_S
from skinnet.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from skinnet.deployment import Deployment
    from skinnet.diagnosis.diagnose import Diagnosis

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
    left out or overridden is listed. Findings follow: errors, warnings, remarks, each with its mend. With
    --settle, the body is simulated for some time: forces on the skin, drift of joints, energy. The exit code
    is 2 if the deployment is refused or a finding is an error.
    """
    if channels and resolved:
        raise UsageError("--channels and --resolved exclude each other: give one of them")
    if resolved and (settle is not None or json is not None):
        raise UsageError("--resolved prints TOML: leave out --settle and --json")
    if settle is not None and not (math.isfinite(settle) and 0.0 < settle <= _MAX_SETTLE_S):
        raise UsageError(f"--settle {settle:g}: must be above 0 and at most {_MAX_SETTLE_S:g} s")
    from skinnet.cli.deployment_listing import (
        print_channels,
        print_deployment,
        print_findings,
        print_settling,
        resolved_toml,
    )
    from skinnet.deployment.extends import read_layers
    from skinnet.diagnosis.finding import as_documents, has_errors
    from skinnet.run.prepare import RunOptions, prepare_run

    prepared = prepare_run(RunOptions(file, tuple(settings or ())))
    deployment = prepared.deployment
    if resolved:
        sys.stdout.write(resolved_toml(deployment, file))
        return
    terminal = console(stderr=json == "-")
    print_deployment(terminal, deployment, [layer.path for layer in reversed(read_layers(file))])
    say = line_printer(terminal)
    for line in prepared.left_out:
        say(f"left out of {deployment.body.model}: {line}")
    if channels:
        print_channels(terminal, deployment.robot)
    diagnosis = _diagnose(terminal, deployment, prepared.base, settle or 0.0)
    if settle is not None:
        print_settling(terminal, settle, diagnosis.metrics)
    print_findings(terminal, diagnosis.findings)
    report = {
        "deployment": deployment.name,
        "settle_s": settle,
        "metrics": diagnosis.metrics,
        "findings": as_documents(diagnosis.findings),
    }
    write_report(report, json)
    if has_errors(diagnosis.findings):
        raise typer.Exit(BAD_INPUT)


def _diagnose(terminal: "Console", deployment: "Deployment", base: Path, settle_s: float) -> "Diagnosis":
    """Diagnose a deployment, settled for `settle_s` [s], whole physics steps, if any; show the progress."""
    from rich.progress import Progress

    from skinnet.diagnosis.diagnose import diagnose

    step_ns = deployment.body.timestep_ns
    settle_ns = max(round(settle_s * NS_PER_S / step_ns), 1) * step_ns if settle_s else 0
    with Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        task = progress.add_task("settling", total=1.0)
        return diagnose(
            deployment, base, settle_ns, lambda fraction: progress.update(task, completed=fraction)
        )
