"""What tests of the report share: a small real run, pages taken apart, and a browser."""

import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from locations import ROOT
from rich.console import Console

from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay

ARM = ROOT / "deployments" / "two_link_arm.toml"
SHORT = (
    'controller.program=["map", "evade"]',
    "controller.map.periods=1",
    "controller.map.frequency_hz=8",
    "controller.map.settle_s=0.05",
    "controller.stages.evade.duration_s=1.5",
)
_VOID = {"br", "hr", "img", "link", "meta"}


def small_run(folder: Path, *settings: str, seed: int = 1, plots: bool = True) -> dict[str, Any]:
    """Three simulated seconds of the two-link arm, in this process; returns the summary."""
    order = RunOptions(ARM, (*SHORT, *settings), in_process=True, plots=plots)
    progress = ProgressDisplay(Console(quiet=True), quiet=True)
    return run_once(prepare_run(order, seed), folder, progress)


def png(width: int = 3, height: int = 2) -> bytes:
    """A grey picture."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4) + kind + data + zlib.crc32(kind + data).to_bytes(4)

    head = width.to_bytes(4) + height.to_bytes(4) + bytes([8, 0, 0, 0, 0])
    rows = zlib.compress((b"\0" + b"\x80" * width) * height)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


class Page(HTMLParser):
    """A page taken apart; tags that do not close in order are an error."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[tuple[str, str]] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"an attribute twice in <{tag}>"
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in _VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self._open[-1] if self._open else "", data))

    @property
    def text(self) -> str:
        """All that a reader reads."""
        return "".join(data for where, data in self.texts if where != "style")

    def all(self, tag: str) -> list[dict[str, str]]:
        """Attributes of all elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]


@contextmanager
def browser() -> Iterator[Any]:
    """Debian's Chromium without a network; skips the test where it or Playwright is missing."""
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("there is no chromium")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium, args=arguments)
        try:
            yield opened
        finally:
            opened.close()
