"""Zenoh queries of a client to an endpoint, as functions."""

from pathlib import Path

import msgspec

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.errors import ProtocolError, SkinnetError, UnreachableError
from skinnet.protocol.channels import DEPLOYMENT
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.protocol.messages import decode
from skinnet.transport.interface import Reply
from skinnet.transport.zenoh_session import ZenohSession

__all__ = ["query", "query_deployment", "query_values"]

_DEPLOYMENT_TIMEOUT_S = 5.0
"""Timeout [s] for the deployment query."""
_CONNECT_TIMEOUT_S = 2.0
"""Timeout [s] to connect to an endpoint."""


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
    session = ZenohSession.open_client(endpoint, min(timeout_s, _CONNECT_TIMEOUT_S))
    try:
        return session.get(expression, timeout_s, payload)
    finally:
        session.close()


def query_values(session: ZenohSession, expression: str, timeout_s: float) -> dict[str, bytes]:
    """Query `expression`; return the payloads by key, empty if nobody answers within `timeout_s` [s]."""
    return {reply.key: reply.payload for reply in session.get(expression, timeout_s) if not reply.error}


def query_deployment(session: ZenohSession, endpoint: str) -> tuple[Deployment, Path]:
    """Query the deployment of the run at an observer endpoint, and the base folder of its relative paths.

    Args:
        session: Client session at the endpoint.
        endpoint: Name of the endpoint in errors.

    Raises:
        UnreachableError: no run answers there.
        SkinnetError: the run has another version of this program.
    """
    answers = query_values(session, DEPLOYMENT, _DEPLOYMENT_TIMEOUT_S)
    if not answers:
        raise UnreachableError(
            f"{endpoint}: no run serves its deployment there; give the observer endpoint that a run prints"
        )
    try:
        deployed = decode(next(iter(answers.values())), DeploymentInfo)
        raw = msgspec.json.decode(deployed.deployment)
    except (ProtocolError, msgspec.DecodeError) as error:
        raise SkinnetError(f"{endpoint}: the run there has another version of skinnet: {error}") from error
    return from_document(raw, endpoint), Path(deployed.base_folder)
