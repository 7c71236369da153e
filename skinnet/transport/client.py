"""Questions to whoever listens at an endpoint: what any Zenoh client can do, as functions."""

from pathlib import Path
from typing import NamedTuple

import msgspec

from skinnet.channels import DEPLOYMENT
from skinnet.deployment.load import build
from skinnet.deployment.schema import Deployment
from skinnet.errors import ProtocolError, SkinnetError, UnreachableError
from skinnet.messages import decode
from skinnet.outside_messages import Deployed
from skinnet.transport.open_session import OpenSession
from skinnet.transport.zenoh_session import collect, open_session

__all__ = ["Reply", "ask", "what_runs"]

_TELL_S = 5.0
"""So long a run may take to tell what it is."""
_CALL_S = 2.0
"""So long a client tries to connect before it says that nobody is there."""


class Reply(NamedTuple):
    """What came back for a question: a payload on a key, or else an error in words."""

    key: str
    payload: bytes
    error: str


def ask(endpoint: str, expression: str, payload: bytes, timeout_s: float) -> list[Reply]:
    """Asks `expression` as a client of whoever listens at `endpoint`; empty if nobody there answers such.

    Args:
        endpoint: Where to connect.
        expression: Key expression of the question.
        payload: What is sent along.
        timeout_s: How long to wait for an answer [s], and at most to connect.

    Raises:
        UnreachableError: nobody answers at the endpoint.
    """
    connect_ms = max(1, round(1000 * min(timeout_s, _CALL_S)))
    with open_session(None, endpoint, connect_ms) as session:
        replies = collect(
            lambda handler: session.get(expression, handler, payload=payload, timeout=timeout_s)
        )
    found, late = [], False
    for reply in replies:
        if reply.ok is not None:
            found.append(Reply(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), ""))
        else:
            error = reply.err.payload.to_bytes().decode(errors="replace")
            if error == "Timeout":
                late = True  # each hop of the question may say so
            else:
                found.append(Reply("", b"", error))
    return [*found, Reply("", b"", f"no answer within {timeout_s:g} s")] if late else found


def what_runs(session: OpenSession, endpoint: str) -> tuple[Deployment, Path]:
    """The deployment that the run at a watch endpoint tells, and the folder that its paths start from.

    Args:
        session: Client of the endpoint.
        endpoint: What to call it in errors.

    Raises:
        UnreachableError: who is there tells of no run.
        SkinnetError: it runs another version of this program.
    """
    answers = session.ask(DEPLOYMENT, _TELL_S)
    if not answers:
        raise UnreachableError(
            f"{endpoint}: nobody there tells what runs; give an endpoint that a run prints"
        )
    try:
        deployed = decode(next(iter(answers.values())), Deployed)
        raw = msgspec.json.decode(deployed.deployment)
    except (ProtocolError, msgspec.DecodeError) as error:
        raise SkinnetError(f"{endpoint}: runs another version of skinnet: {error}") from error
    return build(raw, endpoint), Path(deployed.base)
