"""The page beside a real run: it comes with the run, goes with it, and is nothing that a run waits for."""

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from browsing import LONG_MS, visit
from launching import called, child, family, gone, launched, run, skinnet, wait_for
from locations import ROOT

from skinnet.run.observers.page_process import PageProcess

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]
ARM = ROOT / "deployments" / "two_link_arm.toml"
LASTING = (
    'controller.program=["listen"]',
    'controller.stages.listen={ kind = "passive", duration_s = 40.0 }',
    "run.max_s=40.0",
    "run.deadline_s=120.0",
)
BRIEF = (*LASTING, "run.max_s=2.0")
LISTEN = (
    'controller.program=["listen"]',
    'controller.stages.listen={ kind = "passive", duration_s = 600.0 }',
    "run.max_s=600.0",
)


def page_of(process: subprocess.Popen[str]) -> str:
    """Address of the page of a run in lockstep, which pauses until the page is ready."""
    url, paused = "", None
    assert process.stdout is not None
    for line in process.stdout:
        if "page of" in line:
            url = line.split()[-1]
        elif line.startswith("listen"):
            paused = child(process, "body")
            paused.send_signal(signal.SIGSTOP)
        if url and paused is not None:
            paused.send_signal(signal.SIGCONT)
            return url
    raise AssertionError("no page, or no run")


def view(*arguments: str) -> tuple[int, str]:
    """Exit code and the one line of a `skinnet view` that ends by itself."""
    done = skinnet("view", *arguments)
    (said,) = (done.stdout + done.stderr).splitlines()
    return done.returncode, said


def test_what_cannot_be_shown_is_one_clear_line(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        closed = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        code, said = view(closed)
    assert code == 2
    assert said.startswith(f"skinnet: {closed}: no Zenoh endpoint, or nobody answers there")
    assert view("nowhere") == (
        2,
        "skinnet: nowhere: neither an endpoint, as tcp/127.0.0.1:7447, nor a recording, as run.mcap",
    )
    missing = tmp_path / "run.mcap"
    assert view(str(missing)) == (2, f"skinnet: {missing}: no such file or directory")
    missing.write_bytes(b"nothing of the kind")
    code, said = view(str(missing))
    assert code == 2
    assert said.startswith(f"skinnet: {missing}: not a recording")


def test_options_of_the_page_are_for_a_page(tmp_path: Path) -> None:
    for options, why in (
        (("--control",), "--control and --keep concern the page: give --view too"),
        (
            ("--view", "--keep", "--seeds", "1-2"),
            "--keep and --seeds exclude each other: a page that is kept shows one run",
        ),
    ):
        done = skinnet("run", str(ARM), "--out", str(tmp_path), *options)
        assert (done.returncode, done.stderr) == (2, f"skinnet: {why}\n")


def test_the_page_goes_with_its_run_and_changes_nothing(tmp_path: Path) -> None:
    """In lockstep, with a page that is stopped in the middle: the log is what it is without one."""
    reference = run(ARM, tmp_path / "alone", "--in-process", settings=LASTING)
    with launched(ARM, tmp_path / "viewed", "--view", settings=LASTING) as process:
        page_of(process)
        everybody = family(process)
        page = called(everybody, "view")
        page.send_signal(signal.SIGSTOP)
        wait_for(process, "log ")
        page.send_signal(signal.SIGCONT)
        _, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
        said = errors.splitlines()  # Zenoh waits for the page when the run's session closes, then says so
        assert all(line.startswith("a peer did not respond to the closing of the session") for line in said)
        assert gone(everybody)
    viewed = json.loads((tmp_path / "viewed" / "summary.json").read_text())
    assert viewed["log_sha256"] == reference["log_sha256"]


def test_a_run_that_is_over_first_says_so() -> None:
    said: list[str] = []
    with PageProcess(said.append) as viewer:
        viewer.start("tcp/127.0.0.1:1")
    assert said == ["the run ended before its page was ready"]


@pytest.mark.long
def test_a_page_that_is_killed_is_not_the_runs_affair(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, "--view", settings=LASTING) as process:
        page_of(process)
        page = called(family(process), "view")
        page.kill()
        _, errors = process.communicate(timeout=200)
        assert (process.returncode, errors) == (0, "")


def test_a_page_that_is_kept_stays_until_somebody_ends_it(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, "--view", "--keep", settings=BRIEF) as process:
        url = page_of(process)
        wait_for(process, "the page is kept until Ctrl-C")
        port = int(re.findall(r":(\d+)/", url)[0])
        with socket.create_connection(("127.0.0.1", port), timeout=30) as visitor:
            visitor.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            assert visitor.recv(15) == b"HTTP/1.1 200 OK"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors


def test_a_real_run_in_a_browser(browser: Any, tmp_path: Path) -> None:
    """All that the page shows of a run comes from the run: network, loads, processes, the controller."""
    with launched(ARM, tmp_path, "--view", "--pace", "realtime", settings=LISTEN) as process:
        url = wait_for(process, "page of").split()[-1]
        with visit(browser, url) as found:
            found.tab("Network")
            found.until("() => document.body.innerText.includes('15 of 15 cells')")
            found.until("() => document.body.innerText.includes('reported by the cell processes')")
            found.tab("Controller")
            found.until("() => document.body.innerText.includes('listen for')")
            found.tab("Processes")
            for name in ("body", "controller", "cells0", "cells1", "launcher"):
                found.page.wait_for_selector(f"td:text-is('{name}')", timeout=LONG_MS)
            found.until(
                """() => [...document.querySelectorAll(".sk-proc tr")].filter((row) =>
                     row.cells.length == 5 && row.cells[3].innerText.endsWith("MB") && row.cells[4].innerText
                   ).length >= 4"""
            )
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)
            assert found.errors == []


def test_a_page_of_elsewhere_prints_its_token(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, "--pace", "realtime", settings=LISTEN) as process:
        endpoint = wait_for(process, "connect to").split("connect to ")[1].split(",")[0]
        line = [sys.executable, "-m", "skinnet.cli", "view", endpoint, "--host", "0.0.0.0"]
        with subprocess.Popen(
            line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT
        ) as page:
            url = wait_for(page, "page of").split()[-1]
            assert re.fullmatch(r"http://0\.0\.0\.0:\d+/\?token=[A-Za-z0-9_-]{20,}", url)
            port = url.split(":")[2].split("/")[0]
            code, said = view(endpoint, "--port", port)
            assert code == 2
            assert said == f"skinnet: --port {port}: port in use; choose another, or 0 for any free one"
            code, said = view(endpoint, "--host", "0.0.0.0", "--token", "")
            assert code == 2
            assert "needs one" in said
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)
            wait_for(page, "the run has ended")
            assert page.wait(timeout=60) == 0
