"""A browser without a screen for tests of the live page; they are skipped where there is none."""

import runpy
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

from locations import DEPLOYMENTS, ROOT

from skinnet.body.visual_shapes import VisualModel
from skinnet.deployment import Deployment
from skinnet.view.page.auth_proxy import AuthProxy
from skinnet.view.page.page import Page
from skinnet.view.sources.source import MessageSource
from skinnet.view.state.run_state import ReceivedMessage, RunState
from skinnet.view.state.skin_layout import SkinLayout, build_skin_layout

_SCREENSHOTS = runpy.run_path(str(ROOT / "docs" / "screenshots.py"))
CHROMIUM: str | None = _SCREENSHOTS["CHROMIUM"]
ARGUMENTS: tuple[str, ...] = _SCREENSHOTS["ARGUMENTS"]
LONG_MS = 60_000
"""Nobody ever waits as long, unless something is broken."""
STYLE = "(of) => getComputedStyle(document.querySelector(of[0]), of[2])[of[1]]"
REDDISH = """
(least) => {
  const from = [...document.querySelectorAll("canvas")].find((c) => c.height > 150);
  const to = document.createElement("canvas");
  [to.width, to.height] = [300, 200];
  const pen = to.getContext("2d", {willReadFrequently: true});
  pen.drawImage(from, 0, 0, to.width, to.height);
  const px = pen.getImageData(0, 0, to.width, to.height).data;
  let red = 0;
  for (let i = 0; i < px.length; i += 4)
    red += px[i] > 90 && px[i] > 1.6 * Math.max(px[i + 1], px[i + 2]);
  return red >= least && Date.now();
}
"""
"""When so many of the 60 000 pixels of the body's picture are red [ms]; else false."""


@dataclass
class Visit:
    """A page that was opened, and what went wrong in it."""

    page: Any
    errors: list[str] = field(default_factory=list)

    def note(self, line: Any) -> None:
        """Keeps a line of the console that is an error."""
        if line.type == "error":
            self.errors.append(f"{line.text} at {line.location}")

    def tab(self, name: str) -> None:
        """Opens a tab of the panel."""
        self.page.get_by_text(name, exact=True).first.click()

    def style(self, selector: str, name: str, part: str | None = None) -> str:
        """What the browser made of all styles of an element."""
        found: str = self.page.evaluate(STYLE, [selector, name, part])
        return found

    def styled(self, selector: str, name: str, text: str, part: str | None = None) -> str:
        """Waits until a style contains `text`; returns it."""
        found: str = self.until(
            f"(of) => {{ const s = ({STYLE})(of); return s.includes(of[3]) && s; }}",
            [selector, name, part, text],
        )
        return found

    def until(self, expression: str, argument: Any = None) -> Any:
        """Waits until an expression is true in the page; returns what it was."""
        return self.page.wait_for_function(expression, arg=argument, timeout=LONG_MS).json_value()


@contextmanager
def visit(browser: Any, url: str, width: int = 1200, height: int = 800) -> Iterator[Visit]:
    """Opens a page and waits until it is drawn; whatever it complains of is an error."""
    context = browser.new_context(viewport={"width": width, "height": height})
    try:
        found = Visit(context.new_page())
        found.page.on("pageerror", lambda error: found.errors.append(str(error)))
        found.page.on(
            "console",
            lambda line: line.type == "error" and found.errors.append(f"{line.text} {line.location}"),
        )
        found.page.goto(url)
        found.page.wait_for_selector("text=Patches", timeout=LONG_MS)
        # that there is no graphics card is said where the controls are
        found.page.locator(".mantine-Notification-closeButton").first.click(timeout=LONG_MS)
        yield found
    finally:
        context.close()


class Pushed:
    """A source that tells what a test pushes."""

    end_reason = ""

    def __init__(self, deployment: Deployment) -> None:
        self.deployment, self.base, self.title = deployment, DEPLOYMENTS, "a test"
        self._waiting: deque[ReceivedMessage] = deque()

    def push(self, *told: ReceivedMessage) -> None:
        self._waiting.extend(told)

    def deliver(self, run_state: RunState, now_s: float) -> int:
        count = 0
        while self._waiting:
            run_state.apply(self._waiting.popleft(), now_s)
            count += 1
        return count

    def properties(self) -> Mapping[str, str]:
        return {}

    def close(self) -> None:
        pass


@dataclass
class Served:
    """A page that is served in this process."""

    url: str
    page: Page
    atlas: SkinLayout
    said: list[str]


@contextmanager
def served(source: MessageSource, token: str | None = None, **options: Any) -> Iterator[Served]:
    """Serves the page of a source until the block ends; an error of its loop is one of the test."""
    atlas = build_skin_layout(source.deployment)
    page = Page(source, atlas, VisualModel(source.deployment, source.base), **options)
    broken: list[BaseException] = []

    def run() -> None:
        try:
            page.run(keep_open=True)
        except BaseException as error:
            broken.append(error)
            raise

    said: list[str] = []
    thread = threading.Thread(target=run)
    try:
        with closing(AuthProxy("127.0.0.1", 0, page.port, token, said.append)) as gate:
            thread.start()
            yield Served(gate.url, page, atlas, said)
    finally:
        page.stop()
        thread.join()
        page.close()
    assert broken == []
