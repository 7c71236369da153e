"""Command `skinnet bridge ros2`: a run as topics of a ROS 2 system."""

from pathlib import Path
from typing import Annotated

import typer

from skinnet.cli.console import console
from skinnet.errors import SkinnetError

__all__ = ["EXAMPLES", "app"]

EXAMPLES = """
Examples:

  skinnet run deployments/hrp2_touch.toml --pace realtime --listen tcp/127.0.0.1:7448

  skinnet bridge ros2 tcp/127.0.0.1:7448

  skinnet bridge ros2 tcp/127.0.0.1:7448 --domain 3 --router tcp/192.168.0.7:7447 --rate 20

They need a router of ROS 2, rmw_zenohd. This one is the router itself:

  skinnet bridge ros2 tcp/127.0.0.1:7448 --listen tcp/127.0.0.1:7447

With --control, joint velocities come in. The run must let them:

  skinnet run deployments/hrp2_touch.toml --pace realtime --set controller.external_velocity=true
"""

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="A run as part of another system.")


@app.callback()
def _group() -> None:
    """Bridge a run to another middleware."""


@app.command(name="ros2", epilog=EXAMPLES)
def _ros2(
    endpoint: Annotated[str, typer.Argument(metavar="ENDPOINT", help="Watch endpoint that the run prints.")],
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID.")] = 0,
    router: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Zenoh router of the ROS 2 system.")
    ] = "tcp/localhost:7447",
    listen: Annotated[
        str | None, typer.Option(metavar="ENDPOINT", help="Be that router, at this endpoint.")
    ] = None,
    rate: Annotated[
        float, typer.Option(min=0.1, max=1000.0, help="Publishes at most so often [Hz]; markers at 10.")
    ] = 50.0,
    control: Annotated[
        bool, typer.Option("--control", help="Let ROS move the robot, if the run lets it.")
    ] = False,
    base: Annotated[
        Path | None, typer.Option(help="Folder with the model; the one that the run names unless given.")
    ] = None,
) -> None:
    """Bridge a run to ROS 2 over rmw_zenoh: joint states, transforms, skin, markers, diagnostics.

    ROS 2 need not be installed here.
    """
    try:
        from skinnet.ros2.bridge import BridgeOptions, bridge
    except ModuleNotFoundError as error:
        raise SkinnetError(
            f"{error.name} is missing; install the extra: pip install 'skinnet[ros2]'"
        ) from error
    terminal = console()

    def say(line: str) -> None:
        terminal.print(line, highlight=False, markup=False, soft_wrap=True)

    for topic, sent in bridge(
        BridgeOptions(endpoint, domain, router, listen, rate, base, control), say
    ).items():
        say(f"  {topic}: {sent} messages")
