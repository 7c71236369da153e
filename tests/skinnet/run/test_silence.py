"""Processes that pause, fall silent or never come: a pause changes nothing, and the first cause is named."""

import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from launching import child, family, gone, launched, run, wait_for
from reported import ARM

from skinnet.run.activity import ActivityMeter

pytestmark = [pytest.mark.processes, pytest.mark.long, pytest.mark.timeout(400)]
QUICK = ('controller.program=["structure"]', "run.max_s=4")
ONE_PROCESS = (*QUICK, "cell_processes=1")


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Hash of a run that nothing disturbs."""
    summary = run(ARM, tmp_path_factory.mktemp("calm"), "--in-process", settings=ONE_PROCESS)
    return str(summary["log_sha256"])


@pytest.mark.parametrize("name", ["cells0", "controller", "body"])
def test_a_pause_below_the_deadline_changes_nothing(tmp_path: Path, reference: str, name: str) -> None:
    """Three seconds, which a lease of Zenoh of two would not survive."""
    with launched(ARM, tmp_path, settings=ONE_PROCESS) as process:
        wait_for(process, "structure")
        paused = child(process, name)
        paused.send_signal(signal.SIGSTOP)
        threading.Timer(3.0, lambda: paused.send_signal(signal.SIGCONT)).start()
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["log_sha256"] == reference
    assert summary["outcome"] == "completed"


@pytest.mark.parametrize("name", ["cells0", "controller", "body"])
def test_a_silent_process_is_named_and_not_those_that_wait_for_it(tmp_path: Path, name: str) -> None:
    with launched(ARM, tmp_path, settings=(*QUICK, "run.deadline_s=1.5", "run.max_s=60")) as process:
        wait_for(process, "structure")
        members = family(process)
        child(process, name).send_signal(signal.SIGSTOP)
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 1
        assert errors.startswith(f"skinnet: {name} is silent: it runs, but sent no period end in time")
        assert "stopped by a signal" in errors
        assert "is gone" not in errors
        assert errors.count("\n") == 1
        assert gone(members)


def test_a_killed_process_is_gone_and_not_silent(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, settings=(*QUICK, "run.max_s=60")) as process:
        wait_for(process, "structure")
        child(process, "cells1").kill()
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 1
        assert errors.startswith("skinnet: cells1 was killed by signal 9")


@pytest.mark.parametrize("name", ["cells0", "body"])
def test_a_process_that_does_not_start_is_named(tmp_path: Path, name: str) -> None:
    with launched(ARM, tmp_path, settings=(*QUICK, "run.deadline_s=3")) as process:
        wait_for(process, "watch with any Zenoh client")
        appears(lambda: child(process, name)).send_signal(signal.SIGSTOP)
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 1
        assert errors.startswith(f"skinnet: {name} did not start: it has not joined the run")
        assert "stopped by a signal" in errors
        assert errors.count("\n") == 1


def test_a_silent_process_that_is_tolerated_does_not_hold_the_end_up(tmp_path: Path) -> None:
    settings = (*QUICK, "run.deadline_s=1.5", 'run.tolerated_losses=["cells"]')
    with launched(ARM, tmp_path, settings=settings) as process:
        wait_for(process, "structure")
        child(process, "cells1").send_signal(signal.SIGSTOP)
        output, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
        assert "cells1 is silent: it runs, but sent no period end in time" in output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "completed_with_losses"
    assert [failure["process"] for failure in summary["process_failures"]] == ["cells1"]


def appears(find: Callable[[], psutil.Process]) -> psutil.Process:
    """The process that `find` finds, once it is there."""
    until_s = time.monotonic() + 60.0
    while True:
        try:
            return find()
        except AssertionError:
            assert time.monotonic() < until_s
            threading.Event().wait(0.01)


def test_a_process_that_works_is_not_idle_and_a_pause_of_the_meter_counts_little() -> None:
    with psutil.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        try:
            meter = ActivityMeter({"busy": busy.pid}, slice_s=0.5)
            meter.check(0.0)
            busy.suspend()
            while busy.status() != psutil.STATUS_STOPPED:
                pass
            meter.check(0.1)  # what it did before
            meter.check(0.2)
            meter.check(1000.0)
            assert meter.idle_s("busy") <= 0.7
            meter.check(1000.5)
            assert meter.idle_s("busy") >= 1.0
            assert "stopped by a signal" in meter.state("busy")
            meter.restart()
            assert meter.idle_s("busy") == 0.0
            before_s = sum(busy.cpu_times()[:2])
            busy.resume()
            while sum(busy.cpu_times()[:2]) < before_s + 0.1:
                pass
            meter.check(1001.0)
            assert meter.idle_s("busy") == 0.0
            assert meter.state("busy") == ""
        finally:
            busy.kill()
