"""The page in a browser: body and cells are there, a touch is seen at once, panels say what they should."""

import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from browsing import LONG_MS, REDDISH, Pushed, Served, Visit, served, visit
from locations import DEPLOYMENTS
from view_recordings import write
from view_scene import event, joints, state, stream, topology

from skinnet.deployment import load
from skinnet.protocol.messages import Modality
from skinnet.protocol.telemetry_messages import StateMachineDescription
from skinnet.view.sources.recording_source import RecordingSource

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]
FILL = "backgroundColor"


@pytest.fixture(scope="module")
def robot() -> Pushed:
    return Pushed(load(DEPLOYMENTS / "hrp2_touch.toml"))


@pytest.fixture(scope="module")
def live(robot: Pushed) -> Iterator[Served]:
    with served(robot) as page:
        robot.push(*(topology(page.atlas, patch.name) for patch in page.atlas.patches))
        yield page


@pytest.fixture(scope="module")
def opened(browser: Any, live: Served) -> Iterator[Visit]:
    with visit(browser, live.url) as found:
        yield found
        assert found.errors == []


def picture(opened: Visit) -> np.ndarray[Any, Any]:
    return matplotlib.image.imread(io.BytesIO(opened.page.screenshot()))[:, :, :3]


def test_body_and_cells_are_there(opened: Visit, live: Served) -> None:
    assert opened.page.locator(".sk-patches i").count() == live.atlas.n_taxels
    opened.until(REDDISH, 0)
    body = picture(opened)[:, :600]
    assert 0.02 < (np.abs(body - 1.0).max(axis=2) > 0.2).mean() < 0.6, "a robot before a white wall"
    assert "hrp2_touch" in opened.page.inner_text("body")


def test_a_touch_is_seen_at_once(opened: Visit, robot: Pushed) -> None:
    """From the message to the colour, on paper and on the body: the fastest of some, for others work too.

    Without a graphics card the browser takes long to draw the body; with one, it takes no time.
    """
    cell = ".sk-patches .c0"
    idle = opened.style(cell, FILL)
    robot.push(joints(10, *[0.0] * 14))
    paper_ms, body_ms = [], []
    for touch in range(4):
        opened.page.evaluate(
            """([cell, idle]) => {
                 const spot = document.querySelector(cell);
                 window.seen = new Promise((done) => {
                   const look = () => getComputedStyle(spot).backgroundColor != idle
                     ? done(Date.now()) : setTimeout(look, 2);
                   look();
                 });
               }""",
            [cell, idle],
        )
        sent_ms = 1e3 * time.time()
        t_ms = 1_000 * (touch + 1)
        robot.push(*(event("torso", i, 1.0, level=4, t_ms=t_ms, seq=i) for i in range(18)))
        paper_ms.append(opened.page.evaluate("() => window.seen") - sent_ms)
        body_ms.append(opened.until(REDDISH, 20) - sent_ms)
        robot.push(*(event("torso", i, 0.0, level=0, t_ms=t_ms + 500) for i in range(18)))
        opened.until(f"() => !({REDDISH})(1)")
        opened.styled(cell, FILL, idle)
    assert min(paper_ms) < 200, paper_ms
    assert min(body_ms) < 1000, body_ms


def test_a_cell_tells_what_it_feels(opened: Visit, robot: Pushed) -> None:
    robot.push(stream("torso", np.tile(np.arange(8, dtype=np.float32), (18, 1)), t_ms=9_000))
    opened.tab("Patches")
    opened.page.hover(".sk-patches .c5")
    said = opened.styled(".sk-patches .sk-tip", "content", "7.0 °C", "::after")
    assert "torso/5 · force 0.00 1.00 2.00 · proximity 3.00 · +4.00 +5.00 +6.00 g · 7.0 °C" in said


def test_colours_follow_the_chosen_modality(opened: Visit, live: Served, robot: Pushed) -> None:
    robot.push(event("left_hand", 2, 0.8, modality=Modality.PROXIMITY, level=4, t_ms=9_100))
    cell = f".sk-patches .c{live.atlas.first_taxel['left_hand'] + 2}"
    before = opened.style(cell, FILL)
    for now, name, there in (("force", "proximity", True), ("proximity", "force", False)):
        opened.page.locator(f"input.mantine-Select-input[value={now}]").click()
        opened.page.get_by_role("option", name=name).click()
        opened.until(
            "([cell, fill, there]) => "
            "(getComputedStyle(document.querySelector(cell)).backgroundColor != fill) == there",
            [cell, before, there],
        )


def test_the_network_shows_what_is_cut_and_dead(opened: Visit, live: Served, robot: Pushed) -> None:
    opened.tab("Network")
    opened.until("() => document.body.innerText.includes('74 of 74 cells')")
    robot.push(topology(live.atlas, "torso", 9, cut=(2,), version=2))
    opened.until("() => document.body.innerText.includes('1 broken links · 1 unreachable cells')")
    opened.styled(".sk-net .w2", "backgroundImage", "224, 49, 49")
    assert opened.style(".sk-net .w3", "backgroundImage") == "none"
    opened.styled(".sk-net .n9", "boxShadow", "224, 49, 49")
    assert opened.style(".sk-net .n8", "boxShadow") == "none"
    opened.page.hover(".sk-net .w2")
    opened.styled(".sk-net .sk-tip", "content", "broken", "::after")


def test_events_charts_and_processes_are_there(opened: Visit, robot: Pushed) -> None:
    robot.push(*(event("torso", i % 18, 0.3, t_ms=12_000 + 40 * i, seq=20 + i) for i in range(50)))
    opened.tab("Events")
    opened.styled(".sk-raster", "backgroundImage", "data:image/png")
    opened.tab("Charts")
    opened.page.wait_for_selector("text=latency from sample to delivery", timeout=LONG_MS)
    opened.until("() => document.querySelectorAll('.uplot canvas').length == 3")
    opened.tab("Processes")
    opened.page.wait_for_selector("text=body per second", timeout=LONG_MS)


def test_the_controller_shows_its_state_and_why(opened: Visit, robot: Pushed) -> None:
    machine = StateMachineDescription(
        t_ns=0,
        states=["s.idle", "s.open", "s.safe"],
        transitions=[["s.idle", "patted", "s.open"], ["s.open", "pain", "s.safe"]],
    )
    robot.push(state(20_000, "s.idle"), state(21_000, "s.open", "patted"))
    robot.push(state(20_000, "x")._replace(channel="state_machine", message=machine))
    opened.tab("Controller")
    opened.until(
        """() => { const pill = document.querySelector('svg rect[fill="#0b6e4f"] + text');
                   return pill && pill.textContent.startsWith("open"); }"""
    )
    words = opened.page.evaluate("() => [...document.querySelectorAll('svg text')].map((t) => t.textContent)")
    assert {"patted", "pain"} <= set(words)
    assert "s.open for" in opened.page.inner_text("body")


def test_a_browser_that_leaves_in_mid_stream_is_missed_by_nobody(
    browser: Any, live: Served, robot: Pushed
) -> None:
    for t_ms in (30_000, 40_000):
        with visit(browser, live.url, 400, 300):
            robot.push(*(event("torso", i % 18, 0.3, t_ms=t_ms + i) for i in range(300)))
    with visit(browser, live.url, 1000, 600) as again:
        again.until("() => document.querySelector('.sk-clock').innerText.startsWith('40.3')")
        assert again.errors == []


def test_a_recording_is_paused_and_sought(browser: Any, tmp_path: Path) -> None:
    deployment = load(DEPLOYMENTS / "two_link_arm.toml")
    told = [joints(100 * i, 0.01 * i, 0.0, 0.0) for i in range(600)]
    source = RecordingSource(write(tmp_path / "run.mcap", deployment, told), DEPLOYMENTS, time.monotonic())
    clock = "parseFloat(document.querySelector('.sk-clock').innerText)"
    with served(source) as page, visit(browser, page.url) as found:
        found.page.get_by_role("button", name="Pause").click()
        found.page.get_by_role("button", name="Play", exact=True).wait_for(timeout=LONG_MS)
        field = found.page.locator(".mantine-NumberInput-input").first
        field.fill("42.5")
        field.press("Enter")
        found.until(f"() => {clock} == 42.5")
        found.page.get_by_role("button", name="Play", exact=True).click()
        found.until(f"() => {clock} > 42.6")
        assert found.errors == []


def test_the_token_opens_the_page_and_nothing_else_does(browser: Any, robot: Pushed) -> None:
    with served(robot, token="a word") as page:
        context = browser.new_context()
        tab = context.new_page()
        bare = page.url.partition("?")[0]
        assert tab.goto(bare).status == 401
        assert tab.goto(f"{bare}?token=wrong").status == 403
        assert "wrong token" in tab.inner_text("body")
        context.close()
        with visit(browser, page.url, 1000, 600) as found:
            assert "token" not in found.page.url
            assert found.errors == []
