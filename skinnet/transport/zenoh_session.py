"""Zenoh session settings and reply collection, shared by the loop transport and the public session."""

import json
import threading
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import zenoh

from skinnet.errors import PortInUseError, SkinnetError, UnreachableError

__all__ = ["collect_replies", "open_session"]

_LEASE_MS = 2_000
_WAIT_BEFORE_CLOSE_US = 120_000_000
_CONNECT_TIMEOUT_MS = 60_000


def open_session(
    listen: str | None,
    connect: str | None,
    connect_timeout_ms: int = _CONNECT_TIMEOUT_MS,
    extra_settings: Mapping[str, Any] = MappingProxyType({}),
) -> Any:
    """Open a Zenoh session without scouting: a peer that listens, or a client that connects.

    `extra_settings` are further settings by their configuration key.

    Raises:
        PortInUseError: the endpoint to listen on is in use.
        UnreachableError: nobody answers at the endpoint to connect to.
        SkinnetError: Zenoh cannot listen on the endpoint.
    """
    settings: dict[str, Any] = {
        "mode": "peer" if listen else "client",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": _WAIT_BEFORE_CLOSE_US,
        "connect/timeout_ms": connect_timeout_ms,
        "connect/exit_on_failure": True,
    }
    if listen:
        settings["listen/endpoints"] = [listen]
    if connect:
        settings["connect/endpoints"] = [connect]
    settings |= extra_settings
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        if "in use" in str(error).lower():
            raise PortInUseError(
                f"--listen {listen}: that port is already taken; choose another, or leave --listen out"
            ) from error
        if listen:
            reason = str(error).splitlines()[0][:200]
            raise SkinnetError(f"Zenoh cannot listen on {listen}: {reason}") from error
        raise UnreachableError(
            f"{connect}: no Zenoh endpoint, or nobody answers there; write it as in tcp/127.0.0.1:7447"
        ) from error


def collect_replies(send_query: Callable[[Any], None]) -> list[Any]:
    """Collect all replies to the query that `send_query` sends with the given handler; block until complete.

    Zenoh's default handler holds 256 replies until they are read, and cannot be waited for.
    """
    replies: list[Any] = []
    complete = threading.Event()
    send_query(zenoh.handlers.Callback(replies.append, complete.set))
    complete.wait()
    return replies
