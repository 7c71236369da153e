"""Authenticating TCP proxy in front of the page's server.

viser has no authentication, so it listens on loopback at an unpublished port, and this proxy is the public
address. It reads the request head of each connection and forwards an authorised connection byte by byte. A
browser that presents `?token=` gets a cookie. Against cross-site requests and DNS rebinding, a foreign
`Origin` is refused, and on loopback a `Host` that is not loopback.
"""

import asyncio
import contextlib
import hmac
import ipaddress
import threading
from collections.abc import Callable, Coroutine
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from skinnet.errors import DeploymentError, PortInUseError

__all__ = ["AccessDecision", "AuthProxy", "authorise", "is_loopback"]

_MAX_HEAD_BYTES = 65_536
_HEAD_TIMEOUT_S = 10.0
_CHUNK_BYTES = 65_536
_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")


class AccessDecision(NamedTuple):
    """Access decision: `response` is the HTTP response to a refused request; None forwards it."""

    response: bytes | None
    reason: str = ""


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable from this computer only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def authorise(head: bytes, token: str | None, port: int, *, loopback: bool) -> AccessDecision:
    """Authorise a request by its head.

    Args:
        head: Request line and headers, up to the empty line.
        token: Access token; None for no authentication.
        port: Port of the page; part of the cookie's name, as cookies are shared between ports.
        loopback: Whether the page is served on loopback only.
    """
    lines = head.decode("latin-1").split("\r\n")
    words = lines[0].split(" ")
    if len(words) != 3 or words[0] != "GET":
        return _refusal(400, "not an HTTP GET request")
    fields = {name.strip().lower(): value.strip() for name, _, value in (x.partition(":") for x in lines[1:])}
    host = fields.get("host", "")
    if loopback and host.rpartition(":")[0] not in _LOOPBACK_NAMES and host not in _LOOPBACK_NAMES:
        return _refusal(403, "the page is served to this computer only")
    origin = fields.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return _refusal(403, f"cross-origin request from {origin[:80]} refused")
    if token is None:
        return AccessDecision(None)
    cookie = f"skinnet-{port}"
    if _tokens_equal(_cookies(fields.get("cookie", "")).get(cookie, ""), token):
        return AccessDecision(None)
    path, _, query = words[1].partition("?")
    parameters = dict(parse_qsl(query))
    if "token" not in parameters:
        return _refusal(401, "missing token: open the URL that skinnet view printed")
    if not _tokens_equal(parameters.pop("token"), token):
        return _refusal(403, "wrong token")
    there = path + ("?" + urlencode(parameters) if parameters else "")
    return AccessDecision(
        (
            f"HTTP/1.1 303 See Other\r\nLocation: {there}\r\n"
            f"Set-Cookie: {cookie}={token}; HttpOnly; SameSite=Strict; Path=/\r\n"
            "Content-Length: 0\r\nConnection: close\r\n\r\n"
        ).encode("latin-1")
    )


def _tokens_equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


def _cookies(text: str) -> dict[str, str]:
    return dict(part.strip().partition("=")[::2] for part in text.split(";"))


def _refusal(code: int, detail: str) -> AccessDecision:
    reason = {400: "Bad Request", 401: "Unauthorized", 403: "Forbidden"}[code]
    body = f"skinnet: {detail}\n".encode()
    head = (
        f"HTTP/1.1 {code} {reason}\r\nContent-Type: text/plain; charset=utf-8\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    return AccessDecision(head.encode("latin-1") + body, detail)


class AuthProxy:
    """Authenticating proxy to a server on loopback, in its own thread.

    Args:
        host: Address to listen at.
        port: Port; 0 for any free one.
        upstream_port: Port of the page's server on 127.0.0.1.
        token: Access token; None for no authentication.
        log: Called once with each distinct reason for refused requests.

    Raises:
        PortInUseError: the port is taken.
        DeploymentError: the address is not one of this computer.
    """

    def __init__(
        self, host: str, port: int, upstream_port: int, token: str | None, log: Callable[[str], None]
    ) -> None:
        self.port = port
        self._host, self._upstream_port, self._token, self._log = host, upstream_port, token, log
        self._loopback = is_loopback(host)
        self._logged_reasons: set[str] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="gate", daemon=True)
        self._thread.start()
        try:
            self._server = self._run_in_loop(
                asyncio.start_server(self._on_connection, host, port, limit=_MAX_HEAD_BYTES)
            )
        except OSError as error:
            self._stop()
            if error.errno is not None and "in use" in str(error):
                raise PortInUseError(
                    f"--port {port}: port in use; choose another, or 0 for any free one"
                ) from error
            raise DeploymentError(f"--host {host}: cannot listen there: {error.strerror or error}") from error
        self.port = int(self._server.sockets[0].getsockname()[1])

    @property
    def url(self) -> str:
        """Page URL with its token."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self.port}/" + (f"?token={self._token}" if self._token else "")

    def close(self) -> None:
        """Stop accepting connections and close the open ones."""
        self._run_in_loop(self._close_connections())
        self._stop()

    async def _close_connections(self) -> None:
        await asyncio.sleep(0)  # else asyncio would leak a connection that is being accepted
        self._server.close()
        while True:
            await asyncio.sleep(0)  # a task cancelled before its first step would not close its connection
            others = asyncio.all_tasks() - {asyncio.current_task()}
            if not others:
                return
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

    async def _on_connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await self._handle_connection(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError):
            pass  # the client disconnected
        except asyncio.CancelledError:
            pass  # the proxy is closing; nothing awaits this task
        finally:
            writer.close()

    async def _handle_connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.timeout(_HEAD_TIMEOUT_S):
            head = await reader.readuntil(b"\r\n\r\n")
        verdict = authorise(head, self._token, self.port, loopback=self._loopback)
        if verdict.response is not None:
            self._log_refusal(verdict.reason)
            writer.write(verdict.response)
            await writer.drain()
            return
        inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", self._upstream_port)
        inner_writer.write(head)
        ways = [
            asyncio.create_task(_forward(*way)) for way in ((reader, inner_writer), (inner_reader, writer))
        ]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            inner_writer.close()  # first, as the await below may be cancelled again
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)

    def _log_refusal(self, reason: str) -> None:
        if reason and reason not in self._logged_reasons and len(self._logged_reasons) < 100:
            self._logged_reasons.add(reason)
            self._log(f"refused access to the page: {reason}")

    def _run_in_loop(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _forward(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while chunk := await reader.read(_CHUNK_BYTES):
            writer.write(chunk)
            await writer.drain()
