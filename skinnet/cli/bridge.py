"""Command `skinnet bridge ros2`: a run as topics of a ROS 2 system."""

from typing import Annotated

import typer

from skinnet.cli.console import BaseOption, console, examples, line_printer
from skinnet.errors import SkinnetError

__all__ = ["register"]

_EXAMPLES = examples(
    "skinnet run deployments/hrp2_touch.toml --pace realtime --listen tcp/127.0.0.1:7448",
    "skinnet bridge ros2 tcp/127.0.0.1:7448",
    "skinnet bridge ros2 tcp/127.0.0.1:7448 --domain 3 --router tcp/192.168.0.7:7447 --rate 20",
    "# They need rmw_zenohd, the router of rmw_zenoh. This one is the router itself:",
    "skinnet bridge ros2 tcp/127.0.0.1:7448 --listen tcp/127.0.0.1:7447",
    "# With --control, ROS 2 may send joint velocities. The run must accept them:",
    "skinnet run deployments/hrp2_touch.toml --pace realtime --set controller.external_velocity=true",
)

_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Bridge a run to another middleware.")


def register(app: typer.Typer) -> None:
    """Register the command group `bridge`."""
    app.add_typer(_app, name="bridge", epilog=_EXAMPLES)


@_app.callback()
def _group() -> None:
    """Bridge a run to another middleware."""


@_app.command(name="ros2", epilog=_EXAMPLES)
def _ros2(
    endpoint: Annotated[
        str, typer.Argument(metavar="ENDPOINT", help="Observer endpoint, which the run prints.")
    ],
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID of the ROS 2 system.")] = 0,
    router: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Zenoh router of the ROS 2 system.")
    ] = "tcp/localhost:7447",
    listen: Annotated[
        str | None,
        typer.Option(metavar="ENDPOINT", help="Serves as the router at this endpoint, instead of --router."),
    ] = None,
    rate: Annotated[
        float, typer.Option(min=0.1, max=1000.0, help="Highest publication rate [Hz]; that of markers is 10.")
    ] = 50.0,
    control: Annotated[
        bool, typer.Option("--control", help="Forwards joint velocities from ROS 2, if the run accepts them.")
    ] = False,
    base: BaseOption = None,
) -> None:
    """Bridge a run to ROS 2 over rmw_zenoh.

    Topics are joint states, transforms, skin, markers and diagnostics. ROS 2 need not be installed here.
    """
    try:
        from skinnet.ros2.bridge import BridgeOptions, bridge
    except ModuleNotFoundError as error:
        raise SkinnetError(
            f"module {error.name} is not installed; install the extra: pip install 'skinnet[ros2]'"
        ) from error
    print_line = line_printer(console())
    options = BridgeOptions(endpoint, domain, router, listen, rate, base, control)
    for topic, count in bridge(options, print_line).items():
        print_line(f"  {topic}: {count} messages")
