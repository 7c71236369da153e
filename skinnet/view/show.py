"""Web page service: builds source, page and proxy from the command-line options."""

import re
import secrets
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from skinnet.body.shapes import Figure
from skinnet.errors import DeploymentError
from skinnet.view.atlas import draw_atlas
from skinnet.view.gate import Gate, is_loopback
from skinnet.view.live import LiveSource
from skinnet.view.page import Page
from skinnet.view.recorded import RecordedSource
from skinnet.view.source import Source

__all__ = ["Order", "show"]

_TOKEN_BYTES = 16
_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws|unixsock-stream|serial)/")


@dataclass(frozen=True)
class Order:
    """Options of the page's command line.

    Attributes:
        what: Observer endpoint of a run, or path of a recording.
        host: Address of the page.
        port: Port of the page; 0 for any free one.
        token: Access token; None for a random one, or for none if the page is on loopback.
        control: Show request buttons of the controller.
        keep: Keep serving after the end of the run.
        base: Folder with the model, if it differs from the run's.
    """

    what: str
    host: str = "127.0.0.1"
    port: int = 0
    token: str | None = None
    control: bool = False
    keep: bool = False
    base: Path | None = None


def show(order: Order, say: Callable[[str], None]) -> None:
    """Serve the page until the run is over or it is stopped.

    Raises:
        SkinnetError: the source is unusable, or the address is taken.
    """
    token = order.token
    if token is None and not is_loopback(order.host):
        token = secrets.token_urlsafe(_TOKEN_BYTES)
    if token == "" and not is_loopback(order.host):
        raise DeploymentError(f"--token: the page at {order.host} is not for this machine only; it needs one")
    with ExitStack() as stack:
        source = _source(order)
        stack.callback(source.close)
        atlas = draw_atlas(source.deployment)
        page = Page(source, atlas, Figure(source.deployment, source.base), control=order.control)
        stack.callback(page.close)
        gate = Gate(order.host, order.port, page.port, token or None, say)
        stack.callback(gate.close)
        say(f"live page of {source.title}: {gate.url}")
        say(page.run(keep=order.keep))


def _source(order: Order) -> Source:
    if _ENDPOINT.match(order.what) and not Path(order.what).exists():
        return LiveSource(order.what, order.base)
    path = Path(order.what)
    if not path.exists() and path.suffix != ".mcap":
        raise DeploymentError(
            f"{order.what}: neither an endpoint, as tcp/127.0.0.1:7447, nor a recording, as run.mcap"
        )
    return RecordedSource(path, order.base, time.monotonic())
