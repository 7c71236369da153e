"""The command line: bad input gets one clear line and exit code 2, good input what it promises."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from launching import ROOT, TOUCH


def skinnet(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "skinnet.cli", *arguments]
    return subprocess.run(line, capture_output=True, text=True, check=False, timeout=120, cwd=ROOT)


BAD = {
    "unknown key": ("body.moddel=x", ["body.moddel", "unknown key", "did you mean model?"]),
    "wrong type": ("body.timestep_ms=fast", ["body.timestep_ms", "'fast'", "expected `float`"]),
    "out of range": ("body.timestep_ms=-1.0", ["body.timestep_ms", "-1.0", "> 0"]),
    "period that does not divide": (
        "body.stimulus_period_ms=4.5",
        ["body.stimulus_period_ms = 4.5", "whole multiple"],
    ),
    "periods that deadlock": ("controller.command_delay_ms=1.0", ["command_delay_ms", "at least 3"]),
    "overlapping cells": (
        "patches.left_upper_arm.body=left_forearm",
        ["patches.left_forearm", "overlaps cell"],
    ),
    "a lattice that bites its tail": (
        "cells.side_m=0.05",
        ["patches.left_upper_arm", "wraps more than once"],
    ),
    "unknown body": ("patches.torso.body=belly", ["belly", "no such body", "torso"]),
    "two processes for one patch": (
        'cell_processes={a=["torso", "left_hand"], b=["torso"]}',
        ["cell_processes.b", "patch torso already runs on a"],
    ),
    "patch without process": ('cell_processes={a=["torso"]}', ["no process runs", "left_hand"]),
    "unknown joint": ('body.joints=["knee"]', ["knee", "hinge and slide joints"]),
    "no such model": ("body.model=nobody.xml", ["nobody.xml", "shipped model"]),
    "unknown stage": ('controller.program=["dance"]', ["dance", "structure"]),
    "guidance without map": ('controller.program=["force_guidance"]', ["force_guidance", "map stage"]),
    "port that is taken": ("patches.torso.interfaces.0.port=0", ["interfaces[0]", "free ports"]),
    "unknown pace": ("run.pace=warp", ["run.pace", "warp"]),
    "no value": ("run.max_s", ["key=value"]),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("verb", ["check", "run"])
def test_bad_input_is_one_clear_line(verb: str, name: str) -> None:
    setting, expected = BAD[name]
    done = skinnet(verb, str(TOUCH), "--set", setting)
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    for text in expected:
        assert any(option in done.stderr for option in text.split("|")), done.stderr


def test_a_model_that_does_not_compile(tmp_path: Path) -> None:
    (tmp_path / "broken.xml").write_text('<mujoco><worldbody><geom type="sphere"/></worldbody></mujoco>')
    done = skinnet("check", str(TOUCH), "--set", f"body.model={tmp_path}/broken.xml")
    assert done.returncode == 2
    assert "broken.xml" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("content", ["name = ", "\xff\xfe", ""])
def test_files_that_are_no_deployment(tmp_path: Path, content: str) -> None:
    path = tmp_path / "x.toml"
    path.write_text(content, encoding="latin-1")
    done = skinnet("check", str(path))
    assert done.returncode == 2
    assert "x.toml" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_file_that_is_not_there() -> None:
    done = skinnet("run", "nowhere.toml")
    assert (done.returncode, done.stderr) == (2, "skinnet: nowhere.toml: there is no such file\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nonsense", "go"), "nonsense: no Zenoh endpoint, or nobody answers there"),
        (("unixsock-stream//nowhere", "go", "--timeout", "0.01"), "unixsock-stream//nowhere: no Zenoh"),
        (("nonsense", "go/**"), "WHAT 'go/**': names have letters, digits, - and _ only"),
        (("nonsense", ""), "WHAT ''"),
        (("nonsense", "go", "--robot", "*"), "--robot '*'"),
    ],
)
def test_requests_that_cannot_be_made(arguments: tuple[str, ...], said: str) -> None:
    done = skinnet("request", *arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"skinnet: {said}")


@pytest.mark.parametrize("seeds", ["3", "5-2", "a-b", "-"])
def test_ranges_of_seeds(seeds: str) -> None:
    done = skinnet("run", str(TOUCH), "--seeds", seeds)
    assert done.returncode == 2
    assert "A-B" in done.stderr


@pytest.mark.processes
def test_a_port_that_is_taken(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = skinnet("run", str(TOUCH), "--listen", endpoint, "--out", str(tmp_path))
    assert done.returncode == 2
    assert endpoint in done.stderr
    assert "already taken" in done.stderr
    assert "Traceback" not in done.stderr


def test_check_explains(tmp_path: Path) -> None:
    done = skinnet("check", str(TOUCH))
    assert done.returncode == 0
    for text in ("controller", "left_forearm", "74", "skin/<patch>/<cell>/events", "stimulus frame"):
        assert text in done.stdout


def test_help_has_examples() -> None:
    for arguments in (["--help"], ["run", "--help"]):
        assert "skinnet run deployments/hrp2_touch.toml" in skinnet(*arguments).stdout


def test_several_seeds_give_one_summary_each(tmp_path: Path) -> None:
    short = ('controller.program=["structure"]', "run.max_s=0.1")
    sets = [word for setting in short for word in ("--set", setting)]
    done = skinnet(
        *("run", str(TOUCH), "--in-process", "--no-plots", "--seeds", "4-5", "--json", "-"),
        *("--out", str(tmp_path), *sets),
    )
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert [one["seed"] for one in report["runs"]] == [4, 5]
    assert report == json.loads((tmp_path / "summary.json").read_text())
    assert report["runs"][0]["log_sha256"] != report["runs"][1]["log_sha256"]
    assert json.loads((tmp_path / "seed-4" / "summary.json").read_text()) == report["runs"][0]
