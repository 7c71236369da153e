"""Loop transport over Zenoh, in a star: the hub listens as a peer, all others are its clients.

In a mesh, messages of different senders overtake each other.
"""

from skinnet.protocol.channels import Keys
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.mailbox import ThreadMailbox
from skinnet.transport.zenoh_session import ZenohSession

__all__ = ["join_loop", "listen_for_loop"]


def listen_for_loop(keys: Keys, name: str, endpoint: str) -> LoopTransport:
    """Open the loop transport of process `name` as the hub, which listens on `endpoint`.

    Raises:
        PortInUseError: the endpoint is in use.
        SkinnetError: it is no Zenoh endpoint.
    """
    return LoopTransport(ZenohSession.open_hub(endpoint), keys, name, ThreadMailbox())


def join_loop(keys: Keys, name: str, endpoint: str) -> LoopTransport:
    """Open the loop transport of process `name` as a client of the hub at `endpoint`; wait for the hub.

    Raises:
        UnreachableError: nobody answers there.
    """
    return LoopTransport(ZenohSession.open_member(endpoint), keys, name, ThreadMailbox())
