"""Fixtures of the tests of transports."""

import tempfile
from collections.abc import Iterator

import pytest
from transports import Star


@pytest.fixture
def endpoint() -> Iterator[str]:
    with tempfile.TemporaryDirectory(prefix="skin") as folder:  # a socket's path may have 108 bytes
        yield f"unixsock-stream/{folder}/hub"


@pytest.fixture(params=["memory", "zenoh"])
def star(request: pytest.FixtureRequest, endpoint: str) -> Iterator[Star]:
    star = Star(request.param, endpoint)
    yield star
    for name in reversed(list(star.members)):
        star.leave(name)
