"""Trial of a robot, from its model's file to reactions."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from onboarding_models import write_trait

from skinnet.tools.bench.robots.robot_models import RobotModel
from skinnet.tools.bench.robots.trial import TrialOptions, run_trial


@pytest.mark.long
def test_a_robot_explores_feels_and_evades(tmp_path: Path) -> None:
    write_trait(tmp_path, "no_keyframe")
    robot = RobotModel("arm", "none", "", "no_keyframe.xml")
    steps: list[str] = []
    report = run_trial(robot, tmp_path, tmp_path / "out", TrialOptions(n_touches=2), steps.append)
    assert "failed" not in report
    assert steps == ["init", "cover", "check", "run"]
    assert report["check.errors"] == report["structure.wrong_entries"] == report["cover.unreached"] == 0
    assert report["smm.sign_agreement"] >= 0.97
    assert report["contact.felt_error.max"] <= 0.03
    assert report["evasion.inwards"] == report["evasion.touches"] == report["touches"] == 2
    assert report["contact.peak_force_n"] < 10.0  # nor is the foam pressed through


def test_a_step_that_fails_is_named_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "empty.xml").write_text("<mujoco><worldbody/></mujoco>")
    robot = RobotModel("none", "none", "", "empty.xml")
    report = run_trial(robot, tmp_path, tmp_path / "out", TrialOptions(), lambda step: None)
    assert report["failed"].startswith("init: ")


def test_lines_that_a_robot_needs_are_counted_and_used(tmp_path: Path) -> None:
    write_trait(tmp_path, "no_keyframe")
    more = "[plan]\nmax_latency_ms = -1.0\n"
    robot = RobotModel("arm", "none", "", "no_keyframe.xml", more)
    report = run_trial(robot, tmp_path, tmp_path / "out", TrialOptions(), lambda step: None)
    assert report["lines"] == 2
    assert report["failed"].startswith("cover: ")
    assert "max_latency_ms" in report["failed"]


def test_findings_of_an_earlier_trial_do_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "check.json").write_text('{"findings": []}')
    (out / "cover.json").write_text('{"cover": {}, "cpu_s": 0.0, "links": [], "bare": []}')
    run = subprocess.run

    def refuse_check(arguments: list[str], **options: Any) -> Any:
        code = f"raise SystemExit({2 if arguments[3] == 'check' else 0})"
        return run([sys.executable, "-c", code], **options)

    monkeypatch.setattr(subprocess, "run", refuse_check)
    report = run_trial(
        RobotModel("arm", "none", "", "arm.xml"), tmp_path, out, TrialOptions(), lambda _: None
    )
    assert report["failed"] == "check: exit 2"
