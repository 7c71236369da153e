"""Loop transport over Zenoh, in a star: the hub listens as a peer, all others are its clients.

In a mesh, messages of different senders overtake each other.
"""

from pathlib import Path

from skinnet.protocol.channels import Keys
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.mailbox import ThreadMailbox
from skinnet.transport.zenoh_session import HUB_TIMEOUT_S, ZenohSession

__all__ = ["hub_socket", "join_loop", "listen_for_loop", "socket_endpoint"]

_DEADLINE_S = 10.0
"""Deadline [s] of a run unless given."""
_UNIX_SOCKET_SCHEME = "unixsock-stream/"


def socket_endpoint(path: str) -> str:
    """Return the Zenoh endpoint of a Unix socket: no port conflicts, no external clients."""
    return f"{_UNIX_SOCKET_SCHEME}{path}"


def hub_socket(endpoint: str) -> Path | None:
    """Return the Unix socket of an endpoint, which exists once the hub listens; None for any other one."""
    return (
        Path(endpoint.removeprefix(_UNIX_SOCKET_SCHEME)) if endpoint.startswith(_UNIX_SOCKET_SCHEME) else None
    )


def listen_for_loop(keys: Keys, name: str, endpoint: str, deadline_s: float = _DEADLINE_S) -> LoopTransport:
    """Open the loop transport of process `name` as the hub, which listens on `endpoint`.

    `deadline_s` is the deadline of the run, of which the leases of its sessions are made.

    Raises:
        PortInUseError: the endpoint is in use.
        SkinnetError: it is no Zenoh endpoint.
    """
    return LoopTransport(ZenohSession.open_hub(endpoint, deadline_s), keys, name, ThreadMailbox())


def join_loop(
    keys: Keys,
    name: str,
    endpoint: str,
    deadline_s: float = _DEADLINE_S,
    timeout_s: float = HUB_TIMEOUT_S,
) -> LoopTransport:
    """Open the loop transport of process `name` as a client of the hub at `endpoint`; wait for the hub.

    Raises:
        UnreachableError: nobody answers there within `timeout_s`.
    """
    session = ZenohSession.open_member(endpoint, deadline_s, timeout_s)
    return LoopTransport(session, keys, name, ThreadMailbox())
