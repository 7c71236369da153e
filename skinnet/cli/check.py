"""Command `skinnet check`: a deployment, validated and listed."""

import sys
from typing import Annotated

import typer

from skinnet.cli.console import DeploymentArgument, SettingsOption, console, examples
from skinnet.errors import UsageError

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet check deployments/hrp2_touch.toml",
    "skinnet check deployments/hrp2_touch.toml --set cell_processes=per_patch --channels",
    "skinnet check deployments/hrp2_touch.toml --resolved > resolved.toml",
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
) -> None:
    """Check a deployment and list its parts.

    All that a run checks is checked, with the model, the skin and the memory. What of the model's file is
    left out or overridden is listed.
    """
    if channels and resolved:
        raise UsageError("--channels and --resolved exclude each other: give one of them")
    from skinnet.cli.deployment_listing import print_channels, print_deployment, resolved_toml
    from skinnet.deployment.extends import read_layers
    from skinnet.run.prepare import RunOptions, prepare_run

    prepared = prepare_run(RunOptions(file, tuple(settings or ())))
    deployment = prepared.deployment
    if resolved:
        sys.stdout.write(resolved_toml(deployment, file))
        return
    terminal = console()
    print_deployment(terminal, deployment, [layer.path for layer in reversed(read_layers(file))])
    for line in prepared.left_out:
        said = f"left out of {deployment.body.model}: {line}"
        terminal.print(said, highlight=False, markup=False, soft_wrap=True)
    if channels:
        print_channels(terminal, deployment.robot)
