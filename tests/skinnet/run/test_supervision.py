"""Processes that die, launchers that are stopped: the run says so, and nothing is left behind."""

import json
import signal
from pathlib import Path

import pytest
from launching import child, family, gone, launched, wait_for
from reported import ARM

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]
REALTIME = ('controller.program=["structure"]', "run.pace=realtime")
LASTING = (
    'controller.program=["listen"]',
    'controller.stages.listen={ kind = "passive", duration_s = 3600.0 }',
    "run.max_s=3600.0",
)
"""In lockstep much longer than a test takes."""


def test_a_host_that_may_not_be_lost_ends_the_run(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, settings=LASTING) as process:
        wait_for(process, "listen")
        members = family(process)
        child(process, "cells0").kill()
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 1
        assert "cells0 was killed by signal 9" in errors
        assert "Traceback" not in errors
        assert gone(members)


def test_a_host_that_may_be_lost_does_not(tmp_path: Path) -> None:
    settings = (*REALTIME, 'run.tolerated_losses=["cells"]')
    with launched(ARM, tmp_path, settings=settings) as process:
        wait_for(process, "structure")
        child(process, "cells0").kill()
        output, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
        assert "cells0 was killed by signal 9; the run goes on without it" in output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "completed_with_losses"
    assert [fault["process"] for fault in summary["process_failures"]] == ["cells0"]
    assert summary["counters"]["controller"]["lost_upstreams"] == 2
    assert summary["metrics"]["structure.problems"]  # cells of base and forearm were not measured


@pytest.mark.parametrize("name", ["controller", "body"])
def test_the_loss_of_body_or_controller_is_named(tmp_path: Path, name: str) -> None:
    with launched(ARM, tmp_path, settings=LASTING) as process:
        wait_for(process, "listen")
        members = family(process)
        child(process, name).kill()
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 1
        assert f"{name} was killed by signal 9" in errors
        assert gone(members)


def test_the_body_holds_still_when_the_controller_may_be_lost(tmp_path: Path) -> None:
    settings = (*REALTIME, 'run.tolerated_losses=["controller"]', "run.max_s=4")
    with launched(ARM, tmp_path, settings=settings) as process:
        wait_for(process, "structure")
        child(process, "controller").kill()
        _, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "completed_with_losses"
    assert summary["sim_s"] == 4.0


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_launcher_that_is_stopped_leaves_no_orphans(tmp_path: Path, how: signal.Signals) -> None:
    with launched(ARM, tmp_path, settings=LASTING) as process:
        wait_for(process, "listen")
        members = family(process)
        process.send_signal(how)
        _, errors = process.communicate(timeout=60)
        assert "Traceback" not in errors
        assert process.returncode == (-9 if how == signal.SIGKILL else 130)
        assert gone(members)
