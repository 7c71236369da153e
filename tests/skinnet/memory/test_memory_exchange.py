"""A memory as JSON: nothing is lost on the way, what does not hold is refused by its key; commands."""

import copy
import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import launching
import numpy as np
import pytest
from hypothesis import given, settings
from locations import ROOT
from memory_robot import ROBOT, known, memories, same

from skinnet.cli.main import main
from skinnet.deployment import load
from skinnet.deployment.memory_loading import robot_description
from skinnet.errors import DeploymentError, MemoryFileError
from skinnet.memory.contents import KeyPose, MemoryContents
from skinnet.memory.json_export import from_json, to_json
from skinnet.memory.sqlite_store import MemoryStore, read_memory, write_memory
from skinnet.run.prepare import RunOptions, prepare_run


@settings(max_examples=100, deadline=None)
@given(memory=memories())
def test_json_and_back_is_the_same(memory: MemoryContents) -> None:
    text = to_json(memory)
    assert same(from_json(text), memory)
    assert to_json(from_json(text)) == text


def test_people_can_read_it() -> None:
    raw = json.loads(to_json(known()))
    assert raw["robot"]["patches"] == [{"name": "arm", "cells": 3}, {"name": "hand", "cells": 2}]
    assert raw["areas"] == {"contact": ["arm/0", "arm/2", "hand/1"], "pat": ["arm/1"]}
    assert raw["activity"]["arm/2"] == ["elbow", "wrist pitch/2"]
    assert raw["activity"]["hand/0"] is None
    assert raw["poses"]["open"]["position_rad"] == {"elbow": 0.1, "wrist pitch/2": -1.5}
    assert raw["poses"]["open"]["weights"]["arm/1"] == {"elbow": 0.6, "wrist pitch/2": -0.8}
    assert raw["poses"]["home"]["weights"] is None
    assert list(raw["poses"]) == ["open", "home"]


def changed(*path: str | int, to: Any = ...) -> Callable[[dict[str, Any]], None]:
    """Replaces what lies at a path, or removes it."""

    def change(raw: Any) -> None:
        for step in path[:-1]:
            raw = raw[step]
        if to is ...:
            del raw[path[-1]]
        else:
            raw[path[-1]] = to

    return change


OPEN = ("poses", "open")
REFUSED: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "another format": (
        changed("format", to="x"),
        "format = 'x', version = 2: 'skinnet memory', version 1 to 2 is",
    ),
    "another version": (changed("version", to=3), "version = 3: 'skinnet memory', version 1 to 2 is"),
    "no poses": (changed("poses"), "the file: poses is missing"),
    "more keys": (changed("posses", to={}), "the file.posses: unknown key"),
    "list of poses": (changed("poses", to=[]), "poses: expected a table, got a list"),
    "robot without joints": (changed("robot", "joints", to=[]), "robot.joints: empty"),
    "number for a joint": (
        changed("robot", "joints", to=[1]),
        "robot.joints: expected text, got a whole",
    ),
    "patch twice": (
        changed("robot", "patches", 1, "name", to="arm"),
        r"robot.patches\[1\].name = 'arm': duplicate",
    ),
    "cells of a patch": (
        changed("robot", "patches", 1, "cells", to=2.5),
        r"robot.patches\[1\].cells: expected",
    ),
    "endless patch": (changed("robot", "patches", 1, "cells", to=10**15), "robot.patches.hand = 10+: 1 to"),
    "cell without activity": (changed("activity", "hand/1"), "activity: hand/1 is missing"),
    "cell too many": (changed("activity", "hand/2", to=[]), "activity.hand/2: unknown key"),
    "unknown joint": (
        changed("activity", "arm/1", to=["knee"]),
        "activity.arm/1: the robot has no joint 'knee'",
    ),
    "joint without position": (changed(*OPEN, "position_rad", "elbow"), "poses.open.position_rad: elbow is"),
    "position in words": (
        changed(*OPEN, "position_rad", "elbow", to="far"),
        "poses.open.position_rad.elbow: expected a number, got text",
    ),
    "weight of an unknown joint": (
        changed(*OPEN, "weights", "arm/0", to={"knee": 1.0}),
        "poses.open.weights.arm/0: the robot has no joint 'knee'",
    ),
    "weight in words": (
        changed(*OPEN, "weights", "arm/0", to={"elbow": None}),
        "poses.open.weights.arm/0.elbow: expected a number, got nothing",
    ),
    "name of a pose": (changed("poses", "a b", to=None), "poses.a b: expected a table, got nothing"),
    "area without cells": (changed("areas", "pat", to=[]), "areas.pat: has no cells"),
    "cell that is not there": (
        changed("areas", "pat", to=["arm/3"]),
        "areas.pat: the robot has no cell 'arm/3'",
    ),
    "cell twice": (
        changed("areas", "contact", to=["arm/1", "arm/0", "arm/1"]),
        r"areas.contact\[2\] = 'arm/1': duplicate",
    ),
    "parameter in words": (
        changed("parameters", "x", to="much"),
        "parameters.x: expected a number, got text",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_hold_is_refused_by_its_key(case: str) -> None:
    change, said = REFUSED[case]
    raw = copy.deepcopy(json.loads(to_json(known())))
    change(raw)
    with pytest.raises(MemoryFileError, match=said) as caught:
        from_json(json.dumps(raw).encode())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", [b"", b"{", b"\xff", b"[" * 100_000, b"null", b'{"format": NaN}', b'{"format": 1e999}']
)
def test_what_is_no_memory_is_refused(text: bytes) -> None:
    with pytest.raises(MemoryFileError, match=r"invalid JSON|the file"):
        from_json(text)


def taught(**areas: list[int]) -> MemoryContents:
    """A memory of the robot of `hrp2_touch`."""
    robot = robot_description(load(launching.TOUCH))
    home = KeyPose(np.zeros(len(robot.joints)), np.zeros(robot.shape))
    arrays = {label: np.array(cells) for label, cells in areas.items()}
    return MemoryContents(
        robot, np.eye(*robot.shape, dtype=bool), {"home": home}, arrays, {"load.omega": 0.05}
    )


def bent() -> MemoryContents:
    memory = taught()
    home = memory.poses["home"].position_rad.copy()
    home[3] = 9.0
    return MemoryContents(memory.robot, poses={"home": memory.poses["home"], "open": KeyPose(home)})


Skinnet = Callable[..., tuple[int, str, str]]


@pytest.fixture
def skinnet(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Skinnet:
    """`skinnet memory`, in this process: exit code, output and errors."""
    monkeypatch.setattr(signal, "signal", lambda *_: None)

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["skinnet", "memory", *arguments])
        with pytest.raises(SystemExit) as exit_:
            main()
        said = capsys.readouterr()
        return int(exit_.value.code or 0), said.out, said.err

    return call


def refuse(skinnet: Skinnet, said: str, *arguments: str) -> None:
    code, out, err = skinnet(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("skinnet: ")
    assert len(err.splitlines()) == 1
    assert said in err


def test_the_program_itself(tmp_path: Path) -> None:
    """Out and back and shown."""
    first, second, text = (str(tmp_path / name) for name in ("a.sqlite", "new/b.sqlite", "a.json"))
    write_memory(Path(first), taught(pat=[3, 20]))
    for arguments in (
        ("export", first, "--out", text),
        ("import", text, second, "--deployment", str(launching.TOUCH)),
        ("show", second),
    ):
        done = launching.skinnet("memory", *arguments)
        assert (done.returncode, done.stderr) == (0, "")
    assert "memory of hrp2" in done.stdout
    assert same(read_memory(Path(second)), taught(pat=[3, 20]))


def test_a_file_is_replaced_by_force_only(skinnet: Skinnet, tmp_path: Path) -> None:
    path, text = tmp_path / "m.sqlite", tmp_path / "a.json"
    text.write_bytes(to_json(known()))
    assert skinnet("import", str(text), str(path)) == (0, "", "")
    assert skinnet("export", str(path)) == (0, text.read_text(), "")
    text.write_bytes(to_json(MemoryContents(ROBOT)))
    refuse(skinnet, "m.sqlite: already exists; give --force", "import", str(text), str(path))
    with MemoryStore.open(path, ROBOT) as store:
        refuse(skinnet, "m.sqlite: is locked by another", "import", str(text), str(path), "--force")
        assert same(store.contents, known())
    assert skinnet("import", str(text), str(path), "--force") == (0, "", "")
    assert same(read_memory(path), MemoryContents(ROBOT))


def test_show_says_what_is_known(skinnet: Skinnet, tmp_path: Path) -> None:
    path = tmp_path / "memory.sqlite"
    write_memory(path, known())
    code, out, err = skinnet("show", str(path))
    assert (code, err) == (0, "")
    lines = [" ".join(line.replace("│", " ").replace("┃", " ").split()) for line in out.splitlines()]
    for line in (
        "memory of bot",
        "2 joints elbow, wrist pitch/2",
        "5 cells arm 3, hand 2",
        "structure 3 cells move, 5 of 10 entries active",
        "not measured hand 1",
        "joint open home",
        "elbow 0.100 0.000",
        "map yes no",
        "contact 3 arm 2, hand 1",
        "pat 1 arm 1",
        "load.force_gain 0.1",
    ):
        assert line in lines, out
    write_memory(path, MemoryContents(ROBOT))
    assert "not explored" in skinnet("show", str(path))[1]


def test_commands_refuse_in_one_line(skinnet: Skinnet, tmp_path: Path) -> None:
    text, path = tmp_path / "a.json", tmp_path / "m.sqlite"
    text.write_bytes(to_json(known()))
    refuse(skinnet, "m.sqlite: there is no such file", "show", str(path))
    refuse(skinnet, "b.json: file not found", "import", str(tmp_path / "b.json"), str(path))
    what = ("import", str(text), str(path), "--deployment", str(launching.TOUCH))
    refuse(skinnet, "a.json: belongs to another robot: name[0] is bot; hrp2 is due", *what)
    text.write_bytes(to_json(bent()))
    refuse(skinnet, "a.json: poses.open: left_elbow_pitch = 9: the joint goes from -", *what)
    text.write_text("{}")
    refuse(skinnet, "a.json: the file: format is missing", "import", str(text), str(path))
    assert not path.exists()
    path.write_text("no database")
    refuse(skinnet, "m.sqlite: is not an SQLite file", "export", str(path))


def test_help_has_examples(skinnet: Skinnet) -> None:
    for arguments in (["--help"], ["show", "--help"]):
        assert "skinnet memory show runs/teach/memory.sqlite" in skinnet(*arguments)[1]


def test_a_run_is_refused_before_it_starts_if_its_memory_does_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "memory.sqlite"

    def order(*settings: str) -> RunOptions:
        return RunOptions(launching.TOUCH, (f"memory.read={path}", *settings))

    with pytest.raises(DeploymentError, match=r"hrp2_touch.toml: memory.read: .*there is no such file"):
        prepare_run(order())
    write_memory(path, bent())
    with pytest.raises(
        DeploymentError, match=r"memory.read: .*memory.sqlite: poses.open: left_elbow_pitch = 9"
    ):
        prepare_run(order())
    write_memory(path, known())
    with pytest.raises(
        DeploymentError, match=r"memory.read: .*belongs to another robot: name\[0\] is bot; hrp2 is"
    ):
        prepare_run(order())
    write_memory(path, taught())
    with pytest.raises(DeploymentError, match=r"another robot: joints\[0\] is left_shoulder_pitch"):
        prepare_run(order('body.joints=["left_elbow_pitch"]'))
    assert prepare_run(order()).deployment.memory.read == str(path)
    with pytest.raises(DeploymentError, match=r"memory.read = .*: the nursing program uses no memory"):
        prepare_run(RunOptions(ROOT / "deployments" / "riba_trajectory.toml", (f"memory.read={path}",)))
