"""The command line: bad input gets one clear line and exit code 2, good input what it promises."""

import io
import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer.main
from launching import TOUCH, skinnet, started
from locations import ROOT
from rich.console import Console

from skinnet.cli.completion import complete_deployment, complete_setting
from skinnet.cli.deployment_listing import resolved_toml
from skinnet.cli.main import app
from skinnet.cli.summary_table import print_summary
from skinnet.deployment import load
from skinnet.errors import DeploymentError, SkinnetError
from skinnet.migration.summaries import FORMAT
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.suggestions import known_names

BAD = {
    "unknown key": ("body.moddel=x", ["body.moddel", "unknown key", "did you mean model?"]),
    "wrong type": ("body.timestep_ms=fast", ["body.timestep_ms", "'fast'", "expected a number"]),
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
        ["patches.left_upper_arm", "exceeds the circumference"],
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


def test_the_program_and_its_exit_code() -> None:
    """A process of its own says and returns what the entry point does."""
    for arguments in (("check", str(TOUCH), "--set", "run.max=1"), ("--version",)):
        alone, here = started(*arguments), skinnet(*arguments)
        assert (alone.returncode, alone.stdout, alone.stderr) == (here.returncode, here.stdout, here.stderr)
        assert alone.returncode == (0 if arguments == ("--version",) else 2)


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
        (("nonsense", "go/**"), "REQUEST 'go/**': names have letters, digits, - and _ only"),
        (("nonsense", ""), "REQUEST ''"),
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
    done = skinnet("check", str(TOUCH), "--channels")
    assert done.returncode == 0
    for text in ("controller", "left_forearm", "74", "skin/<patch>/<cell>/events", "stimulus frame"):
        assert text in done.stdout


def test_help_has_examples() -> None:
    for arguments in (["--help"], ["run", "--help"]):
        assert "skinnet run deployments/hrp2_touch.toml" in skinnet(*arguments).stdout


def test_check_shows_what_matters_first(tmp_path: Path) -> None:
    """Name, robot, seed and chain, then processes, cells, program and periods; channels on demand only."""
    own = tmp_path / "own.toml"
    own.write_text(f'extends = "{TOUCH}"\nname = "own"\nseed = 5\n')
    done = skinnet("check", str(own))
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("own: robot ")
    assert lines[0].endswith("seed 5")
    assert lines[1].startswith(f"{own} extends {TOUCH}")
    order = ("processes", "cells", "program: structure → map", "periods")
    found = [next(i for i, line in enumerate(lines) if line.startswith(word)) for word in order]
    assert found == sorted(found)
    assert "skin/<patch>" not in done.stdout


def test_check_settles_the_body(tmp_path: Path) -> None:
    """Every name is legible on a terminal of 80 columns, and the file has what is printed."""
    report = tmp_path / "settled.json"
    done = skinnet(
        "check",
        str(ROOT / "deployments/two_link_arm.toml"),
        "--settle",
        "0.01",
        "--json",
        str(report),
        COLUMNS="80",
    )
    assert done.returncode == 0, done.stderr
    metrics = json.loads(report.read_text())["metrics"]
    assert {"settle.energy_ratio", "settle.unsensed_n", "settle.force_n.fore_link"} <= metrics.keys()
    assert all(name in done.stdout for name in metrics if name != "settle.left_out"), done.stdout


def test_check_prints_and_writes_findings(tmp_path: Path) -> None:
    """Also without --settle; a finding that is an error is an exit code of 2, after all is printed."""
    done = skinnet("check", str(TOUCH), "--json", "-")
    report = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert (report["settle_s"], report["metrics"], report["findings"]) == (None, {}, [])
    assert "0 errors, 0 warnings, 0 remarks" in done.stderr
    arm = ROOT / "deployments/two_link_arm.xml"
    (tmp_path / "weightless.xml").write_text(arm.read_text().replace("0 0 -9.81", "0 0 0"))
    own = tmp_path / "weightless.toml"
    own.write_text(
        f'extends = "{arm.with_suffix(".toml")}"\nname = "weightless"\n[body]\nmodel = "weightless.xml"\n'
    )
    done = skinnet("check", str(own), "--json", str(tmp_path / "findings.json"))
    assert done.returncode == 2
    assert done.stderr == ""
    (finding,) = json.loads((tmp_path / "findings.json").read_text())["findings"]
    assert (finding["severity"], finding["code"]) == ("error", "gravity_zero")
    assert (
        f"error: {finding['subject']}: {finding['text']}\n    → {finding['mend']}\n1 error, " in done.stdout
    )


def test_check_prints_the_resolved_deployment(tmp_path: Path) -> None:
    done = skinnet(
        "check", str(TOUCH), "--resolved", "--set", "run.max_s=7.5", "--set", "cells.force.noise=0.0"
    )
    assert done.returncode == 0, done.stderr
    copy = tmp_path / "resolved.toml"
    copy.write_text(done.stdout)
    assert load(copy) == load(TOUCH, ("run.max_s=7.5", "cells.force.noise=0.0"))


@pytest.mark.parametrize("path", sorted((ROOT / "deployments").glob("*.toml")), ids=lambda path: path.stem)
def test_every_resolved_deployment_is_the_same_deployment(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "resolved.toml"
    copy.write_text(resolved_toml(load(path), path))
    assert load(copy) == load(path)


def test_wall_time_and_real_time_factor_are_two_rows() -> None:
    """47.7 s of wall time and a loop at 2.17 times real time are both true of 13.9 s simulated."""
    summary = {
        "deployment": "x",
        "seed": 1,
        "outcome": "completed",
        "pace": "lockstep",
        "log_sha256": "0",
        "sim_s": 13.9,
        "wall_s": 47.7,
        "loop_s": 6.4,
        "rtf": 2.17,
        "metrics": {},
        "processes": [],
        "process_failures": [],
    }
    terminal = Console(file=io.StringIO(), record=True, width=100)
    print_summary(terminal, summary, Path("runs"))
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in terminal.export_text().splitlines()]
    assert ["wall time", "47.7 s"] in rows
    assert ["real-time factor (loop)", "2.17"] in rows


def command_paths(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    for name, one in getattr(command, "commands", {}).items():
        yield from command_paths(one, (*path, name))


COMMANDS = list(command_paths(typer.main.get_command(app)))


def test_every_help_has_examples_and_a_line_for_every_option() -> None:
    assert len(COMMANDS) > 15
    root: Any = typer.main.get_command(app)
    for path in COMMANDS:
        command, context = root, None
        for name in ("skinnet", *path):
            command = command if name == "skinnet" else command.commands[name]
            context = command.context_class(command, info_name=name, parent=context)
        text = command.get_help(context)
        assert "Examples:" in text, path
        assert f"skinnet {path[0] if path else 'run'}" in text.partition("Examples:")[2], path
        silent = [one.name for one in command.params if not one.help]
        assert silent == [], path


def test_help_imports_nothing_heavy() -> None:
    """The help of every command, in one process that then names what it has imported."""
    code = (
        "import contextlib, io, sys\n"
        "from skinnet.cli.main import app\n"
        f"for path in {COMMANDS!r}:\n"
        "    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "        app([*path, '--help'], prog_name='skinnet')\n"
        "heavy = ('numba', 'mujoco', 'matplotlib', 'zenoh', 'numpy', 'scipy', 'rich', 'msgspec', 'psutil')\n"
        "print(*(name for name in heavy if name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert (done.stdout.strip(), done.stderr) == ("", "")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", str(TOUCH), "--keep"), "--control and --keep concern the page: give --view too"),
        (("run", str(TOUCH), "--view", "--keep", "--seeds", "1-2"), "--keep and --seeds exclude each other"),
        (("run", str(TOUCH), "--seed", "1", "--seeds", "1-2"), "--seed and --seeds exclude each other"),
        (("check", str(TOUCH), "--channels", "--resolved"), "--channels and --resolved exclude each other"),
        (("check", str(TOUCH), "--settle", "0"), "--settle 0: must be above 0 and at most"),
        (("check", str(TOUCH), "--settle", "nan"), "--settle nan: must be above 0 and at most"),
    ],
)
def test_options_that_contradict_each_other(arguments: tuple[str, ...], said: str) -> None:
    done = skinnet(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"skinnet: {said}")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("chekc", str(TOUCH)), "Did you mean 'check'?"),
        (("run", str(TOUCH), "--pase", "realtime"), "--pace"),
        (("replay", "x.mcap", "--into", "controler"), "--into controler: did you mean controller?"),
    ],
)
def test_misspelt_commands_and_options(arguments: tuple[str, ...], said: str) -> None:
    done = skinnet(*arguments)
    assert done.returncode == 2
    assert said in done.stderr


MISSPELT = {
    "run.pace=realtme": "did you mean 'realtime'?",
    "cells.encoding.kind=periodc": "did you mean 'periodic'?",
    "controller.stages.map.kind=mapp": "did you mean 'map'?",
    "patches.torso.body=torsoo": "did you mean torso?",
    "patches.torsoo.body=torso": "did you mean torso?",
    'body.joints=["left_elbow_pich"]': "did you mean left_elbow_pitch?",
    "body.model=hrp2_upper_bdy": "did you mean hrp2_upper?",
    'controller.program=["structur"]': "did you mean structure?",
    "controller.stages.home.pose=hoome": "did you mean home?",
    'run.tolerated_losses=["cels"]': "did you mean cells?",
    'cell_processes={a=["torsso"]}': "did you mean torso?",
    "teacher.touches.0.cell=left_forarm/1": "did you mean left_forearm?",
    "teacher.touches.0.stage=strcture": "did you mean structure?",
    'faults=[{kind="link_cut", target="torsoo/0:1", at_s=1.0}]': "did you mean torso?",
    'faults=[{kind="link_cutt", target="torso/0:1", at_s=1.0}]': "did you mean 'link_cut'?",
    'power.feeds=["torsoo/0:1"]': "did you mean torso?",
    'bridges=[{a="torsoo/0:1", b="left_hand/0:1"}]': "did you mean torso?",
    'scripted_stimuli.presses=[{cells=["torsoo/0"], start_s=0.0, force_n=1.0}]': "did you mean torso?",
}


@pytest.mark.parametrize("setting", MISSPELT)
def test_misspelt_values_and_names(setting: str) -> None:
    with pytest.raises(SkinnetError) as caught:
        prepare_run(RunOptions(TOUCH, (setting,)))
    assert MISSPELT[setting] in str(caught.value)


def test_a_name_that_is_near_to_none_gets_no_suggestion() -> None:
    assert known_names("zzz", ["torso", "head"]) == "there are torso, head"
    assert known_names("torsoo", ["torso", "head"]) == "did you mean torso? there are torso, head"
    assert known_names("torso", []) == "there are none"


# Shell completion


def completed(line: str, cwd: Path = ROOT) -> list[str]:
    """What zsh would offer at the end of `line`."""
    environment = {"_SKINNET_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": line}
    done = subprocess.run(
        [sys.executable, "-m", "skinnet.cli"],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env=os.environ | environment | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
    )
    return re.findall(r'"((?:[^"\\]|\\.)*)"', done.stdout)


def test_deployments_are_completed(tmp_path: Path) -> None:
    assert "deployments/hrp2_touch.toml" in completed("skinnet run dep")
    assert completed("skinnet check deployments/hrp2_to") == ["deployments/hrp2_touch.toml"]
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").touch()
    for name in ("mine/a.toml", "mine/b.toml", "c.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert complete_deployment(f"{tmp_path}/") == [f"{tmp_path}/c.toml", f"{tmp_path}/mine/"]
    assert complete_deployment(f"{tmp_path}/m") == [f"{tmp_path}/mine/a.toml", f"{tmp_path}/mine/b.toml"]
    assert complete_deployment(f"{tmp_path}/nowhere/") == []


def test_keys_of_settings_are_completed() -> None:
    offered = completed("skinnet run deployments/hrp2_touch.toml --set run.")
    assert "run.pace=" in offered
    assert all(key.startswith("run.") for key in offered)
    assert completed("skinnet run deployments/hrp2_touch.toml --set patches.torso.bo") == [
        "patches.torso.body="
    ]
    assert completed("skinnet run deployments/hrp2_touch.toml --set controller.stages.home.po") == [
        "controller.stages.home.pose="
    ]
    assert completed("skinnet run deployments/hrp2_touch.toml --set run.pace=real") == ["run.pace=realtime"]


def test_every_key_that_is_offered_can_be_set() -> None:
    """A value of no type is refused as the value of that key: never as an unknown key."""
    context: Any = SimpleNamespace(params={}, args=[str(TOUCH)])
    offered = complete_setting(context, "")
    assert len(offered) > 150
    refused = []
    for key in offered:
        try:
            load(TOUCH, (f"{key}'x'",))
        except DeploymentError as error:
            refused += [key] if "unknown key" in str(error) else []
    assert refused == []


def test_several_seeds_give_one_summary_each(tmp_path: Path) -> None:
    short = ('controller.program=["structure"]', "run.max_s=0.1")
    sets = [word for setting in short for word in ("--set", setting)]
    done = skinnet(
        *("run", str(TOUCH), "--in-process", "--no-plots", "--seeds", "4-5", "--json", "-"),
        *("--out", str(tmp_path), *sets),
    )
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    for summary in (report, *report["runs"]):
        assert next(iter(summary.items())) == ("format", FORMAT)
    assert [one["seed"] for one in report["runs"]] == [4, 5]
    assert report == json.loads((tmp_path / "summary.json").read_text())
    assert report["runs"][0]["log_sha256"] != report["runs"][1]["log_sha256"]
    assert json.loads((tmp_path / "seed-4" / "summary.json").read_text()) == report["runs"][0]
