"""Zenoh queries of a client to an endpoint, as functions."""

from pathlib import Path
from typing import NamedTuple

import msgspec

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.errors import ProtocolError, SkinnetError, UnreachableError
from skinnet.protocol.channels import DEPLOYMENT
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.protocol.messages import decode
from skinnet.transport.public_session import PublicSession
from skinnet.transport.zenoh_session import collect_replies, open_session

__all__ = ["Reply", "query", "query_deployment"]

_DEPLOYMENT_TIMEOUT_S = 5.0
"""Timeout [s] for the deployment query."""
_CONNECT_TIMEOUT_S = 2.0
"""Timeout [s] to connect to an endpoint."""


class Reply(NamedTuple):
    """Reply to a query: a payload on a key, or else an error text."""

    key: str
    payload: bytes
    error: str


def query(endpoint: str, expression: str, payload: bytes, timeout_s: float) -> list[Reply]:
    """Query `expression` as a client of `endpoint`.

    Args:
        endpoint: Zenoh endpoint to connect to.
        expression: Key expression of the query.
        payload: Payload of the query.
        timeout_s: Timeout [s] for the replies; also an upper limit for connecting.

    Returns:
        Replies; empty if no queryable there matches.

    Raises:
        UnreachableError: nobody answers at the endpoint.
    """
    connect_ms = max(1, round(1000 * min(timeout_s, _CONNECT_TIMEOUT_S)))
    with open_session(None, endpoint, connect_ms) as session:
        replies = collect_replies(
            lambda handler: session.get(expression, handler, payload=payload, timeout=timeout_s)
        )
    found, late = [], False
    for reply in replies:
        if reply.ok is not None:
            found.append(Reply(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), ""))
        else:
            error = reply.err.payload.to_bytes().decode(errors="replace")
            if error == "Timeout":
                late = True  # each hop of the query may report it
            else:
                found.append(Reply("", b"", error))
    return [*found, Reply("", b"", f"no answer within {timeout_s:g} s")] if late else found


def query_deployment(session: PublicSession, endpoint: str) -> tuple[Deployment, Path]:
    """Query the deployment of the run at an observer endpoint, and the base folder of its relative paths.

    Args:
        session: Client session at the endpoint.
        endpoint: Name of the endpoint in errors.

    Raises:
        UnreachableError: no run answers there.
        SkinnetError: the run has another version of this program.
    """
    answers = session.query(DEPLOYMENT, _DEPLOYMENT_TIMEOUT_S)
    if not answers:
        raise UnreachableError(
            f"{endpoint}: nobody there tells what runs; give an endpoint that a run prints"
        )
    try:
        deployed = decode(next(iter(answers.values())), DeploymentInfo)
        raw = msgspec.json.decode(deployed.deployment)
    except (ProtocolError, msgspec.DecodeError) as error:
        raise SkinnetError(f"{endpoint}: runs another version of skinnet: {error}") from error
    return from_document(raw, endpoint), Path(deployed.base_folder)
