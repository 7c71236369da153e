"""The memory file: what is read is what was written, and what is wrong with a file is said in one line."""

import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from memory_robot import ROBOT, known, memories, names, numbered, same
from memory_sql import sql

from skinnet.errors import MemoryFileError
from skinnet.memory import sqlite_store as store_module
from skinnet.memory.contents import KeyPose, MemoryContents, RobotIdentity, check_joint_limits
from skinnet.memory.sqlite_store import VERSION, MemoryStore, read_memory, write_memory


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with what the small robot knows."""
    file = tmp_path / "memory.sqlite"
    write_memory(file, known())
    return file


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "_LOCK_TIMEOUT_S", 0.01)


@settings(max_examples=60, deadline=None)
@given(memory=memories())
def test_what_is_read_is_what_was_written(memory: MemoryContents) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m #1?.sqlite"
        write_memory(path, memory)
        back = read_memory(path)
        assert same(back, memory)
        assert list(back.poses) == list(memory.poses)
        for name, pose in memory.poses.items():
            assert back.poses[name].position_rad.tobytes() == pose.position_rad.tobytes()
        assert back.parameters == memory.parameters
        assert sorted(file.name for file in Path(folder).iterdir()) == [path.name]


@settings(max_examples=30, deadline=None)
@given(memory=memories(), pose=names, area=names)
def test_what_is_remembered_piece_by_piece_is_the_whole(memory: MemoryContents, pose: str, area: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "memory.sqlite"
        robot = memory.robot
        with MemoryStore.create(path, robot) as store:
            # first something else in every place, which must leave no trace
            store.store_structure(np.ones(robot.shape, dtype=bool))
            for name in memory.poses:
                store.store_pose(name, KeyPose(np.ones(len(robot.joints)), np.ones(robot.shape)))
            for label in memory.areas:
                store.store_area(label, np.arange(robot.n_cells))
            store.store_parameters(dict.fromkeys(memory.parameters, 1.0))
            if memory.activity is not None:
                store.store_structure(memory.activity, memory.unmeasured)
            for name, key_pose in memory.poses.items():
                store.store_pose(name, key_pose)
            for label, cells in memory.areas.items():
                store.store_area(label, cells)
            store.store_parameters(memory.parameters)
            pieces = store.contents
            store.replace_contents(memory)
            assert same(store.contents, memory)
        assert same(read_memory(path), memory)
        if memory.activity is not None:
            assert same(pieces, memory)


def test_other_programs_can_read_the_tables(path: Path) -> None:
    assert sql(path, "SELECT joint, position_rad FROM pose_joint WHERE pose = 'open' ORDER BY joint") == [
        ("elbow", 0.1),
        ("wrist pitch/2", -1.5),
    ]
    assert sql(path, "SELECT patch, cell FROM area_cell WHERE area = 'contact' ORDER BY 1, 2") == [
        ("arm", 0),
        ("arm", 2),
        ("hand", 1),
    ]
    weight = "SELECT weight FROM map WHERE pose = 'open' AND patch = 'hand' AND cell = 1 ORDER BY joint"
    assert sql(path, weight) == [(1 / 3,), (2 / 3,)]
    assert sql(path, "SELECT DISTINCT patch, cell FROM activity WHERE active IS NULL") == [("hand", 0)]
    assert sql(path, "PRAGMA user_version") == [(VERSION,)]


def test_what_a_memory_holds_is_its_own() -> None:
    """What the giver does to its arrays afterwards, and what a reader tries, changes nothing."""
    position_rad, cells = np.array([1.0, 2.0]), np.array([1, 2])
    memory = MemoryContents(ROBOT, poses={"open": KeyPose(position_rad)}, areas={"pat": cells})
    position_rad[:] = cells[:] = 0
    assert memory.poses["open"].position_rad.tolist() == [1.0, 2.0]
    assert memory.areas["pat"].tolist() == [1, 2]
    with pytest.raises(ValueError, match="read-only"):
        memory.poses["open"].position_rad[0] = 3.0


@pytest.mark.usefixtures("impatient")
def test_one_writer_at_a_time_and_no_reader_beside_it(path: Path) -> None:
    with MemoryStore.open(path, ROBOT) as first:
        for attempt in (
            lambda: MemoryStore.open(path, ROBOT),
            lambda: MemoryStore.create(path, ROBOT),
            lambda: read_memory(path),
        ):
            with pytest.raises(MemoryFileError, match="locked by another process"):
                attempt()
        first.store_parameters({"still": 1.0})
        code = (
            "from skinnet.memory.sqlite_store import *; from pathlib import Path; "
            f"read_memory(Path({str(path)!r}))"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert "MemoryFileError" in done.stderr
        assert "locked by another process" in done.stderr
    with MemoryStore.open(path, ROBOT) as second:
        assert second.contents.parameters["still"] == 1.0


def test_a_reader_is_waited_for(path: Path) -> None:
    """A look at the file is over soon, and must not keep a controller from starting."""
    reader = sqlite3.connect(path, isolation_level=None)
    reader.execute("BEGIN")
    reader.execute("SELECT * FROM robot").fetchall()
    with pytest.raises(MemoryFileError, match="locked by"):
        MemoryStore.open(path, ROBOT)
    reader.close()
    MemoryStore.open(path, ROBOT).close()


OTHERS: dict[str, tuple[RobotIdentity, str]] = {
    "name": (RobotIdentity("bat", ROBOT.joints, ROBOT.patches), r"name\[0\] is bot; bat is due"),
    "joint": (
        RobotIdentity("bot", ("elbow", "hip"), ROBOT.patches),
        r"joints\[1\] is wrist pitch/2; hip is due",
    ),
    "fewer joints": (RobotIdentity("bot", ("elbow",), ROBOT.patches), "it has 2 joints; 1 are due"),
    "cells": (
        RobotIdentity("bot", ROBOT.joints, {"arm": 4, "hand": 2}),
        r"patches\[0\] is arm of 3 cells; arm of 4 cells is due",
    ),
    "order of patches": (
        RobotIdentity("bot", ROBOT.joints, {"hand": 2, "arm": 3}),
        r"patches\[0\] is arm of 3 cells; hand of 2 cells is due",
    ),
    "more patches": (
        RobotIdentity("bot", ROBOT.joints, {"arm": 3, "hand": 2, "torso": 9}),
        "it has 2 patches; 3 are due",
    ),
}


@pytest.mark.parametrize("case", OTHERS)
def test_the_memory_of_another_robot_is_refused(path: Path, case: str) -> None:
    other, said = OTHERS[case]
    with pytest.raises(MemoryFileError, match=f"^{re.escape(str(path))}: belongs to another robot: .*{said}"):
        MemoryStore.open(path, other)
    with MemoryStore.open(path, ROBOT) as store:
        with pytest.raises(MemoryFileError, match="belongs to another robot"):
            store.replace_contents(MemoryContents(other))
        assert same(store.contents, known())


def no_file(path: Path) -> None:
    path.unlink()


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def text(path: Path) -> None:
    path.write_text("home = [0.0, 0.0]\n" * 100)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def database_of_another_program(path: Path) -> None:
    path.unlink()
    sql(path, "CREATE TABLE t (x)")


def newer(path: Path) -> None:
    sql(path, f"PRAGMA user_version = {VERSION + 1}")


def older(path: Path) -> None:
    sql(path, "PRAGMA user_version = 0")


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def changed_weight(path: Path) -> None:
    sql(path, "UPDATE map SET weight = 0.5 WHERE weight = 0.6")


def missing_rows(path: Path) -> None:
    sql(path, "DELETE FROM map WHERE patch = 'hand'")


def wrong_type(path: Path) -> None:
    sql(path, "PRAGMA ignore_check_constraints = ON", "UPDATE parameter SET value = 'much'")


def cell_that_is_not_there(path: Path) -> None:
    sql(path, "UPDATE area_cell SET cell = 7 WHERE cell = 2")


def more_tables(path: Path) -> None:
    sql(path, "CREATE TRIGGER t AFTER INSERT ON parameter BEGIN DELETE FROM pose; END")


def empty_tables(path: Path) -> None:
    sql(path, "DELETE FROM robot")


REFUSED: dict[Callable[[Path], None], str] = {
    no_file: "there is no such file",
    folder: "is not a file",
    text: "is not an SQLite file",
    empty: "is an SQLite database, but not a skinnet memory",
    database_of_another_program: "is an SQLite database, but not a skinnet memory",
    newer: "has version 3 of the schema, and this skinnet reads 1 to 2: it is newer; update skinnet",
    older: "has version 0 of the schema, and this skinnet reads 1 to 2: it is of no skinnet",
    truncated: "is damaged",
    changed_weight: "is damaged: .*do not match the stored SHA-256",
    missing_rows: "is damaged: 6 entries of map",
    wrong_type: "is damaged: CHECK constraint failed in parameter",
    cell_that_is_not_there: "is damaged: areas.contact: unknown cell arm/7",
    more_tables: "is damaged: its tables do not match the schema of this version",
    empty_tables: "is damaged: no row for query SELECT name FROM robot",
}


@pytest.mark.parametrize("spoil", REFUSED, ids=lambda spoil: spoil.__name__)
def test_what_cannot_be_read_is_refused(path: Path, spoil: Callable[[Path], None]) -> None:
    spoil(path)
    for attempt in (lambda: read_memory(path), lambda: MemoryStore.open(path, ROBOT)):
        with pytest.raises(MemoryFileError, match=f"^{re.escape(str(path))}: {REFUSED[spoil]}") as caught:
            attempt()
        assert "\n" not in str(caught.value)


def refusal(path: Path, memory: MemoryContents) -> str:
    """Why the file can be neither read nor opened; nothing if it reads as `memory`."""
    try:
        with MemoryStore.open(path, memory.robot) as store:
            assert same(store.contents, memory)
    except MemoryFileError:
        pass
    try:
        assert same(read_memory(path), memory)
    except MemoryFileError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_file_is_refused_or_reads_the_same(tmp_path: Path, seed: int) -> None:
    """Bytes overwritten, or an end cut off, anywhere: never a traceback, never another memory."""
    rng = np.random.default_rng(seed)
    whole, path = tmp_path / "whole.sqlite", tmp_path / "memory.sqlite"
    memory = numbered(seed)
    write_memory(whole, memory)
    content = whole.read_bytes()
    used = np.flatnonzero(np.frombuffer(content, dtype=np.uint8))
    refused = 0
    for _ in range(60):
        broken = bytearray(content)
        if rng.random() < 0.2:
            del broken[rng.integers(len(broken)) :]
        else:
            # mostly where there is something, in and behind the header at its beginning too
            for place in rng.choice(np.append(used, np.arange(100)), rng.integers(1, 4)):
                broken[place] = rng.integers(256)
        path.write_bytes(broken)
        said = refusal(path, memory)
        refused += bool(said)
        assert "\n" not in said
        for file in tmp_path.glob("memory.sqlite*"):
            file.unlink()
    assert refused > 30


@pytest.mark.parametrize("content", ["memory", "other"])
def test_a_file_takes_the_place_of_another_and_of_what_lies_beside_it(path: Path, content: str) -> None:
    """A journal that a killed process left is that of the old file: it must not get into the new one."""
    db = sqlite3.connect(path, isolation_level=None)
    db.execute("PRAGMA cache_spill = 1")
    db.execute("PRAGMA cache_size = 1")
    db.execute("BEGIN EXCLUSIVE")
    db.execute("UPDATE map SET weight = weight + 1.0")
    db.execute(
        "WITH RECURSIVE n (i) AS (VALUES (1) UNION ALL SELECT i + 1 FROM n WHERE i < 999) "
        "INSERT INTO parameter SELECT 'p' || i, 1.0 FROM n"
    )
    journal = path.with_name(path.name + "-journal")
    left, torn = journal.read_bytes(), path.read_bytes()
    assert left[0], "the journal is not hot"
    db.execute("ROLLBACK")
    db.close()
    path.write_bytes(torn if content == "memory" else b"something else")
    journal.write_bytes(left)
    write_memory(path, numbered(7))
    assert not journal.exists()
    assert same(read_memory(path), numbered(7))


def test_a_link_is_followed(path: Path) -> None:
    link = path.with_name("link.sqlite")
    link.symlink_to(path)
    write_memory(link, numbered(3))
    assert link.is_symlink()
    assert same(read_memory(path), numbered(3))


REFUSED_MEMORIES: dict[str, tuple[Callable[[MemoryStore], object], str]] = {
    "area without cells": (
        lambda s: s.store_area("pat", np.zeros(0, dtype=np.int64)),
        "areas.pat: has no",
    ),
    "cell outside": (lambda s: s.store_area("pat", np.array([5])), "areas.pat: unknown cell 5; 5 are"),
    "cells twice": (
        lambda s: s.store_area("pat", np.array([1, 1])),
        "areas.pat: cell numbers must be ascending",
    ),
    "no label": (lambda s: s.store_area("a b", np.array([1])), "areas: 'a b' is not a valid name"),
    "pose of another robot": (
        lambda s: s.store_pose("open", KeyPose(np.zeros(3))),
        r"poses.open.position_rad: has the shape \(3,\); \(2,\) is due",
    ),
    "pose that is not finite": (
        lambda s: s.store_pose("open", KeyPose(np.array([0.0, np.nan]))),
        "poses.open.position_rad: contains a value that is not finite",
    ),
    "map of another robot": (
        lambda s: s.store_pose("open", KeyPose(np.zeros(2), np.zeros((4, 2)))),
        "poses.open.weights: has the shape",
    ),
    "map that is not finite": (
        lambda s: s.store_pose("open", KeyPose(np.zeros(2), np.full((5, 2), np.inf))),
        "poses.open.weights: contains a value that is not finite",
    ),
    "structure of another robot": (
        lambda s: s.store_structure(np.ones((5, 3), dtype=bool)),
        "activity: has",
    ),
    "unmeasured and active": (
        lambda s: s.store_structure(np.ones((5, 2), dtype=bool), np.array([2])),
        "activity: cell 2 is marked both active and unmeasured",
    ),
    "parameter that is not finite": (lambda s: s.store_parameters({"x": np.inf}), "parameters.x: contains"),
    "parameter without name": (lambda s: s.store_parameters({"": 1.0}), "parameters: '' is not a valid name"),
}


@pytest.mark.parametrize("case", REFUSED_MEMORIES)
def test_what_does_not_hold_is_not_remembered(path: Path, case: str) -> None:
    change, said = REFUSED_MEMORIES[case]
    with MemoryStore.open(path, ROBOT) as store:
        with pytest.raises(MemoryFileError, match=said):
            change(store)
        assert same(store.contents, known())
        store.store_parameters({"after": 1.0})
    assert read_memory(path).parameters == known().parameters | {"after": 1.0}


def test_a_change_that_fails_half_way_is_taken_back(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    with MemoryStore.open(path, ROBOT) as store:
        with monkeypatch.context() as broken:
            broken.setattr(store_module.tables, "store_digest", full)
            with pytest.raises(MemoryFileError, match="disk is full"):
                store.store_pose("open", KeyPose(np.ones(2)))
        assert same(store.contents, known())
        store.store_parameters({"after": 1.0})
    back = read_memory(path)
    assert back.poses["open"].position_rad.tolist() == [0.1, -1.5]
    assert back.parameters["after"] == 1.0


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (lambda: RobotIdentity("bot", (), {"arm": 1}), "robot.joints: empty"),
        (lambda: RobotIdentity("bot", ("a", "a"), {"arm": 1}), "robot.joints: a stands 2 times"),
        (lambda: RobotIdentity("bot", ("a\n",), {"arm": 1}), "robot.joints: 'a\\\\n' is not a valid name"),
        (lambda: RobotIdentity("bot", ("a",), {}), "robot.patches: empty"),
        (lambda: RobotIdentity("bot", ("a",), {"arm": 0}), "robot.patches.arm = 0: 1 to"),
        (lambda: RobotIdentity("b t", ("a",), {"arm": 1}), "robot.name: 'b t' is not a valid name"),
    ],
)
def test_a_robot_has_joints_and_skin(robot: Callable[[], RobotIdentity], said: str) -> None:
    with pytest.raises(MemoryFileError, match=said):
        robot()


def test_poses_out_of_the_limits_of_joints_are_refused() -> None:
    check_joint_limits(known(), np.array([[-0.2, 0.1], [-np.inf, np.inf]]))
    check_joint_limits(known(), np.array([[-0.2, 0.095], [-1.5, np.inf]]))  # limits give a little
    with pytest.raises(MemoryFileError, match=r"poses.open: elbow = 0.1: the joint goes from -0.2 to 0.05 "):
        check_joint_limits(known(), np.array([[-0.2, 0.05], [-2.0, 2.0]]))


def test_a_copy_is_as_good(path: Path, tmp_path: Path) -> None:
    shutil.copy(path, tmp_path / "copy.sqlite")
    assert same(read_memory(tmp_path / "copy.sqlite"), known())
