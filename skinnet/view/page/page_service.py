"""Web page service: builds source, page and proxy from the command-line options."""

import re
import secrets
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from skinnet.body.visual_shapes import VisualModel
from skinnet.errors import DeploymentError
from skinnet.view.page.auth_proxy import AuthProxy, is_loopback
from skinnet.view.page.page import Page
from skinnet.view.sources.live_source import LiveSource
from skinnet.view.sources.recording_source import RecordingSource
from skinnet.view.sources.source import MessageSource
from skinnet.view.state.skin_layout import build_skin_layout

__all__ = ["ViewOptions", "serve_page"]

_TOKEN_BYTES = 16
_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|ws|unixsock-stream|serial)/")


@dataclass(frozen=True)
class ViewOptions:
    """Options of the page's command line.

    Attributes:
        source: Observer endpoint of a run, or path of a recording.
        host: Address of the page.
        port: Port of the page; 0 for any free one.
        token: Access token; None for a random one, or for none if the page is on loopback.
        show_requests: Show request buttons of the controller.
        keep_open: Keep serving after the end of the run.
        base: Folder with the model, if it differs from the run's.
    """

    source: str
    host: str = "127.0.0.1"
    port: int = 0
    token: str | None = None
    show_requests: bool = False
    keep_open: bool = False
    base: Path | None = None


def serve_page(options: ViewOptions, log: Callable[[str], None]) -> None:
    """Serve the page until the run has ended or it is stopped.

    Raises:
        SkinnetError: the source is unusable, or the address is taken.
    """
    token = options.token
    if token is None and not is_loopback(options.host):
        token = secrets.token_urlsafe(_TOKEN_BYTES)
    if token == "" and not is_loopback(options.host):
        raise DeploymentError(
            f"--token: the page at {options.host} is not for this machine only; it needs one"
        )
    with ExitStack() as stack:
        source = _open_source(options)
        stack.callback(source.close)
        atlas = build_skin_layout(source.deployment)
        page = Page(
            source, atlas, VisualModel(source.deployment, source.base), show_requests=options.show_requests
        )
        stack.callback(page.close)
        gate = AuthProxy(options.host, options.port, page.port, token or None, log)
        stack.callback(gate.close)
        log(f"page of {source.title}: {gate.url}")
        log(page.run(keep_open=options.keep_open))


def _open_source(options: ViewOptions) -> MessageSource:
    if _ENDPOINT.match(options.source) and not Path(options.source).exists():
        return LiveSource(options.source, options.base)
    path = Path(options.source)
    if not path.exists() and path.suffix != ".mcap":
        raise DeploymentError(
            f"{options.source}: neither an endpoint, as tcp/127.0.0.1:7447, nor a recording, as run.mcap"
        )
    return RecordingSource(path, options.base, time.monotonic())
