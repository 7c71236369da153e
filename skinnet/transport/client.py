"""A question to whoever listens at an endpoint: what any Zenoh client can do, as a function."""

from typing import NamedTuple

from skinnet.transport.zenoh_session import collect, open_session

__all__ = ["Reply", "ask"]

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
