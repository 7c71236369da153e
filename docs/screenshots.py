"""Takes pictures of the live page of a recording, in a browser without a screen."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from skinnet.protocol.messages import Modality

__all__ = ["ARGUMENTS", "CHROMIUM", "Shot", "take"]

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
)
"""Of a Chromium that draws without a graphics card, and asks nobody for anything."""
_CHOICE = ",".join(f'input.mantine-Select-input[value="{m.name.lower()}"]' for m in Modality)
_LONG_MS = 120_000
_LOOKS = 40
_BETWEEN_MS = 700


class Shot(NamedTuple):
    """What is to be seen: a moment of the recording [s], a tab of the panel, a modality, the window [px]."""

    at_s: float
    tab: str
    modality: str
    size_px: tuple[int, int]


def take(recording: Path, shots: Iterable[Shot]) -> Iterator[bytes]:
    """Pictures of the page of a recording, as PNG.

    Raises:
        SystemExit: there is no browser; says what to install.
    """
    if CHROMIUM is None:
        sys.exit("pictures of the live page need Chromium; install it, or set CHROMIUM to its path")
    from playwright.sync_api import sync_playwright

    with _viewed(recording) as url, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        for shot in shots:
            width, height = shot.size_px
            page = browser.new_page(viewport={"width": width, "height": height})
            _open(page, url, shot)
            yield _settled(page)
            page.close()
        browser.close()


@contextmanager
def _viewed(recording: Path) -> Iterator[str]:
    """`skinnet view` while the block lasts; gives its address."""
    line = [sys.executable, "-m", "skinnet.cli", "view", str(recording)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        if "http://" not in said:
            sys.exit(f"skinnet view {recording}: {said.strip() or 'no page'}")
        try:
            yield said.split()[-1]
        finally:
            process.terminate()  # SIGINT may be ignored where all of this runs in the background


def _open(page: Any, url: str, shot: Shot) -> None:
    """Opens the page, stops the clock at the moment that was asked for, and opens the tab."""
    page.goto(url)
    page.wait_for_selector("text=Patches", timeout=_LONG_MS)
    # that there is no graphics card is said where the controls are
    page.locator(".mantine-Notification-closeButton").first.click(timeout=_LONG_MS)
    pause = page.get_by_role("button", name="Pause")
    if pause.count():
        pause.click()
    page.get_by_role("button", name="Play", exact=True).wait_for(timeout=_LONG_MS)
    field = page.locator(".mantine-NumberInput-input").first
    field.fill(f"{shot.at_s:.2f}")
    field.press("Enter")
    page.wait_for_function(
        "(at) => parseFloat(document.querySelector('.sk-clock').innerText) == at",
        arg=round(shot.at_s, 2),
        timeout=_LONG_MS,
    )
    choice = page.locator(_CHOICE).first
    if choice.input_value() != shot.modality:  # what one visitor chooses all see
        choice.click()
        page.get_by_role("option", name=shot.modality).click()
    page.get_by_text(shot.tab, exact=True).first.click()
    page.mouse.move(5, 5)


def _settled(page: Any) -> bytes:
    """The picture, once two in turn are the same."""
    before: bytes = page.screenshot()
    for _ in range(_LOOKS):
        page.wait_for_timeout(_BETWEEN_MS)
        now: bytes = page.screenshot()
        if now == before:
            break
        before = now
    return before
