"""The door of the page: who knows the token comes in, who comes from elsewhere does not."""

import contextlib
import http.client
import http.server
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinnet.errors import DeploymentError, PortInUseError
from skinnet.view.page.auth_proxy import AuthProxy, authorise, is_loopback

TOKEN = "a word"
PAGE = b"the page " * 30_000


def head(path: str = "/", host: str = "127.0.0.1:80", **fields: str) -> bytes:
    lines = [f"GET {path} HTTP/1.1", f"Host: {host}"]
    lines += [f"{name.title()}: {value}" for name, value in fields.items()]
    return "\r\n".join([*lines, "", ""]).encode()


def code(answer: bytes | None) -> int:
    return 200 if answer is None else int(answer.split()[1])


@pytest.mark.parametrize(
    ("request_head", "token", "loopback", "expected"),
    [
        (head(), None, True, 200),
        (head(host="localhost:80"), None, True, 200),
        (head(host="[::1]:80"), None, True, 200),
        (head(host="evil.example:80"), None, True, 403),
        (head(host="evil.example"), None, True, 403),
        (b"GET / HTTP/1.1\r\n\r\n", None, True, 403),
        (head(origin="http://127.0.0.1:80"), None, True, 200),
        (head(origin="http://evil.example"), None, True, 403),
        (head(origin="null"), None, True, 403),
        (head(host="robot.lan:80"), TOKEN, False, 401),
        (head("/?token=a+word", host="robot.lan:80"), TOKEN, False, 303),
        (head("/?token=another", host="robot.lan:80"), TOKEN, False, 403),
        (head("/?token=", host="robot.lan:80"), TOKEN, False, 401),
        (head(host="robot.lan:80", cookie="x=1; skinnet-80=a word"), TOKEN, False, 200),
        (head(host="robot.lan:80", cookie="skinnet-81=a word"), TOKEN, False, 401),
        (head(host="robot.lan:80", cookie="skinnet-80=wrong"), TOKEN, False, 401),
        (head(host="robot.lan:80", cookie="skinnet-80=a word", origin="http://evil"), TOKEN, False, 403),
        (b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", None, True, 400),
        (b"\x16\x03\x01\r\n\r\n", None, True, 400),
    ],
)
def test_who_may_come_in(request_head: bytes, token: str | None, loopback: bool, expected: int) -> None:
    verdict = authorise(request_head, token, 80, loopback=loopback)
    assert code(verdict.response) == expected
    assert bool(verdict.reason) == (expected in (400, 401, 403))


def test_the_token_becomes_a_cookie_and_leaves_the_address() -> None:
    answer = authorise(head("/view?a=1&token=a+word&b=2"), TOKEN, 80, loopback=True).response
    assert answer is not None
    assert b"Location: /view?a=1&b=2\r\n" in answer
    assert b"Set-Cookie: skinnet-80=a word; HttpOnly; SameSite=Strict" in answer


@given(st.binary(max_size=300), st.none() | st.text(min_size=1, max_size=5), st.booleans())
def test_no_bytes_break_the_door_and_none_open_it(junk: bytes, token: str | None, loopback: bool) -> None:
    verdict = authorise(junk + b"\r\n\r\n", token, 80, loopback=loopback)
    assert verdict.response is not None or (token is None and junk.startswith(b"GET "))


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("localhost", True),
        ("::1", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.0.7", False),
        ("robot.lan", False),
    ],
)
def test_what_is_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) == expected


class Inner(http.server.BaseHTTPRequestHandler):
    """The page's own server: it knows nothing of tokens."""

    def do_GET(self) -> None:
        self.server.asked.append(self.path)  # type: ignore[attr-defined]
        self.send_response(200)
        self.send_header("Content-Length", str(len(PAGE)))
        self.end_headers()
        self.wfile.write(PAGE)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def inner() -> Iterator[http.server.ThreadingHTTPServer]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Inner) as server:
        server.asked = []  # type: ignore[attr-defined]
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def get(port: int, path: str = "/", **fields: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=fields)
    response = connection.getresponse()
    response.body = response.read()  # type: ignore[attr-defined]
    connection.close()
    return response


def test_the_page_comes_through_whole(inner: http.server.ThreadingHTTPServer) -> None:
    said: list[str] = []
    with closing(AuthProxy("127.0.0.1", 0, inner.server_port, None, said.append)) as gate:
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", gate.url)
        threads = [threading.Thread(target=get, args=(gate.port, f"/{i}")) for i in range(8)]
        for thread in threads:
            thread.start()
        assert get(gate.port).body == PAGE  # type: ignore[attr-defined]
        for thread in threads:
            thread.join()
        assert get(gate.port, Origin="http://evil.example").status == 403
        assert get(gate.port, Origin="http://evil.example").status == 403
    assert len(inner.asked) == 9  # type: ignore[attr-defined]
    assert said == ["refused access to the page: cross-origin request from http://evil.example refused"]


def test_only_who_knows_the_token_reaches_the_page(inner: http.server.ThreadingHTTPServer) -> None:
    said: list[str] = []
    with closing(AuthProxy("127.0.0.1", 0, inner.server_port, TOKEN, said.append)) as gate:
        assert get(gate.port).status == 401
        assert get(gate.port, "/?token=wrong").status == 403
        assert not inner.asked  # type: ignore[attr-defined]
        entry = get(gate.port, "/?token=a%20word")
        assert (entry.status, entry.getheader("Location")) == (303, "/")
        cookie = str(entry.getheader("Set-Cookie")).partition(";")[0]
        assert get(gate.port, Cookie=cookie).body == PAGE  # type: ignore[attr-defined]
    assert said[-1].endswith("wrong token")


def test_whoever_leaves_in_mid_stream_has_left(inner: http.server.ThreadingHTTPServer) -> None:
    with closing(AuthProxy("127.0.0.1", 0, inner.server_port, None, lambda _: None)) as gate:
        for word in (b"", b"GET", head(host=f"127.0.0.1:{gate.port}"), b"x" * 100_000):
            with socket.create_connection(("127.0.0.1", gate.port), timeout=30) as visitor:
                visitor.sendall(word)
                if word.startswith(b"GET /"):
                    visitor.recv(10)
        assert get(gate.port).body == PAGE  # type: ignore[attr-defined]


def test_a_visitor_who_stays_does_not_hold_the_door_open(inner: http.server.ThreadingHTTPServer) -> None:
    gate = AuthProxy("127.0.0.1", 0, inner.server_port, None, lambda _: None)
    with socket.create_connection(("127.0.0.1", gate.port), timeout=30) as visitor:
        visitor.sendall(b"GET / HTTP/1.1\r\n")
        gate.close()
        with contextlib.suppress(ConnectionResetError):
            assert visitor.recv(10) == b""


def test_a_port_in_use_is_one_clear_line() -> None:
    with (
        closing(AuthProxy("127.0.0.1", 0, 9, None, lambda _: None)) as gate,
        pytest.raises(PortInUseError, match=f"--port {gate.port}: port in use"),
    ):
        AuthProxy("127.0.0.1", gate.port, 9, None, lambda _: None)
    with pytest.raises(DeploymentError, match=r"--host 192\.0\.2\.1: cannot listen there"):
        AuthProxy("192.0.2.1", 0, 9, "x", lambda _: None)
