"""Command `skinnet request`: a request to the controller of a live run."""

import re
from typing import Annotated

import typer

from skinnet.cli.console import examples
from skinnet.errors import ProtocolError, SkinnetError, UnreachableError, UsageError

__all__ = ["register"]

_NAME_PATTERN = re.compile(r"[A-Za-z0-9_\-]+")
_EXAMPLES = examples(
    "skinnet request tcp/127.0.0.1:7447 guide force",
    "skinnet request tcp/127.0.0.1:7447 cancel",
    "skinnet request tcp/127.0.0.1:7447 go home --robot hrp2 --timeout 2",
)


def register(app: typer.Typer) -> None:
    """Register the command `request`."""
    app.command(epilog=_EXAMPLES)(request)


def request(
    endpoint: Annotated[
        str, typer.Argument(metavar="ENDPOINT", help="Observer endpoint, which a run prints.")
    ],
    name: Annotated[str, typer.Argument(metavar="REQUEST", help="Name of the request, e.g. cancel.")],
    argument: Annotated[
        str, typer.Argument(metavar="ARGUMENT", help="Argument of the request, one word, e.g. force.")
    ] = "",
    robot: Annotated[
        str | None, typer.Option(help="Name of the robot; any that is there unless given.")
    ] = None,
    timeout: Annotated[
        float, typer.Option(min=0.001, max=3600.0, metavar="S", help="Time to wait for the answer [s].")
    ] = 10.0,
) -> None:
    """Send a request to a live run.

    The controller answers; the exit code is 0 if it accepts the request, 1 if it refuses it.
    """
    for value, hint in ((name, "REQUEST"), (robot or "any", "--robot")):
        if not _NAME_PATTERN.fullmatch(value):
            raise UsageError(f"{hint} {value!r}: names have letters, digits, - and _ only")
    from skinnet.protocol.channels import Keys
    from skinnet.transport.queries import query

    replies = query(endpoint, Keys(robot or "*").of("request", name), argument.encode(), timeout)
    if not replies:
        who = f"no robot {robot}" if robot else "nobody"
        raise UnreachableError(
            f"{endpoint}: {who} serves requests there; give the observer endpoint that a run prints"
        )
    accepted = True
    for reply in replies:
        if reply.error:
            raise SkinnetError(reply.error)
        accepted &= _print_answer(reply.key, reply.payload)
    raise typer.Exit(0 if accepted else 1)


def _print_answer(key: str, payload: bytes) -> bool:
    """Print an answer; return whether the request was accepted."""
    from skinnet.protocol.messages import Answer, decode

    try:
        answer = decode(payload, Answer)
    except ProtocolError as error:
        raise SkinnetError(f"{key}: {error}; the run may have another version of skinnet") from None
    state = f"state {answer.state} at {answer.t_ns * 1e-9:.3f} s"
    typer.echo(f"accepted; {state}" if answer.accepted else f"refused: {answer.reason}; {state}")
    return answer.accepted
