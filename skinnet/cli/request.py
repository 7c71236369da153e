"""Command `skinnet request`: a request to the controller of a live run."""

import re
from typing import Annotated

import typer

from skinnet.errors import DeploymentError, ProtocolError, SkinnetError, UnreachableError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Answer, decode
from skinnet.transport.queries import query

__all__ = ["EXAMPLES", "request"]

_NAME_PATTERN = re.compile(r"[A-Za-z0-9_\-]+")

EXAMPLES = """
Examples:

  skinnet request tcp/127.0.0.1:7447 guide force

  skinnet request tcp/127.0.0.1:7447 cancel
"""


def request(
    endpoint: Annotated[str, typer.Argument(metavar="ENDPOINT", help="Where the run can be watched.")],
    name: Annotated[str, typer.Argument(metavar="WHAT", help="What is asked for, e.g. cancel.")],
    argument: Annotated[str, typer.Argument(metavar="ARGUMENT", help="One word for it, e.g. force.")] = "",
    robot: Annotated[
        str | None, typer.Option(help="Name of the robot; whichever is there unless given.")
    ] = None,
    timeout: Annotated[
        float, typer.Option(min=0.001, max=3600.0, metavar="SECONDS", help="How long to wait for an answer.")
    ] = 10.0,
) -> None:
    """Send a request to the controller of a live run; exit code 0 if accepted, 1 if refused."""
    for part, hint in ((name, "WHAT"), (robot or "any", "--robot")):
        if not _NAME_PATTERN.fullmatch(part):
            raise DeploymentError(f"{hint} {part!r}: names have letters, digits, - and _ only")
    replies = query(endpoint, Keys(robot or "*").of("request", name), argument.encode(), timeout)
    if not replies:
        who = f"no robot {robot}" if robot else "nobody"
        raise UnreachableError(f"{endpoint}: {who} takes requests there; a run prints its endpoint")
    accepted = True
    for reply in replies:
        if reply.error:
            raise SkinnetError(reply.error)
        accepted &= _print_answer(reply.key, reply.payload)
    raise typer.Exit(0 if accepted else 1)


def _print_answer(key: str, payload: bytes) -> bool:
    """Print an answer; return whether the request was accepted."""
    try:
        answer = decode(payload, Answer)
    except ProtocolError as error:
        raise SkinnetError(f"{key}: {error}; is another version of skinnet running there?") from None
    state = f"state {answer.state} at {answer.t_ns * 1e-9:.3f} s"
    typer.echo(f"accepted; {state}" if answer.accepted else f"refused: {answer.reason}; {state}")
    return answer.accepted
