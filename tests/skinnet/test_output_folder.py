"""Output folders: one owner at a time, nothing of others touched, results that name their run."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from skinnet.errors import RunFolderError
from skinnet.output_folder import MARKER, RunIdentity, add_output_file, identity_of, new_folder, own_folder
from skinnet.runtime.process_result import ProcessResult

PROGRAM, DEPLOYMENT = "skinnet run", b'{"name": "arm"}'
FILES = ("summary.json", "logs/body.log", "parts/body.json")


def write_all(folder: Path) -> None:
    """One whole output: every file but the log is written."""
    with own_folder(folder, PROGRAM, DEPLOYMENT, FILES):
        (folder / "parts").mkdir()
        for name in ("summary.json", "parts/body.json"):
            (folder / name).write_text("earlier")


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_folder_has_one_owner_at_a_time(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with own_folder(out, PROGRAM, DEPLOYMENT, FILES) as first:
        (out / "summary.json").write_text("first")
        with (
            pytest.raises(RunFolderError, match=r"another run is writing there \(process \d+\)"),
            own_folder(out, PROGRAM, DEPLOYMENT, FILES),
        ):
            pass
        with pytest.raises(RunFolderError, match="another run is writing there"):
            add_output_file(out, "report.html")
        assert (out / "summary.json").read_text() == "first"
        first.require_ownership()
    with own_folder(out, PROGRAM, DEPLOYMENT, FILES) as second:
        assert second.identity.run_id != first.identity.run_id
        with pytest.raises(RunFolderError, match="deleted or replaced"):
            first.require_ownership()


def test_the_lock_goes_with_the_process_that_holds_it(tmp_path: Path) -> None:
    """A killed owner leaves its planned files in the list, so that the next one may replace them."""
    program = (
        "import os, sys; from pathlib import Path; from skinnet.output_folder import own_folder\n"
        f"with own_folder(Path(sys.argv[1]), {PROGRAM!r}, b'', {FILES!r}):\n"
        "    (Path(sys.argv[1]) / 'summary.json').write_text('half')\n"
        "    print('owned', flush=True); sys.stdin.read()\n"
    )
    line = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "owned\n"
        with (
            pytest.raises(RunFolderError, match=f"process {owner.pid}"),
            own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES),
        ):
            pass
        owner.kill()
        owner.wait()
    with own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES):
        assert not (tmp_path / "summary.json").exists()


@pytest.mark.parametrize("name", ["thesis.tex", "logs/mine.log", "parts/x/y", "summary.json", ".hidden"])
def test_a_folder_of_others_is_refused_as_it_stands(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text("mine")
    before = tree(tmp_path)
    with (
        pytest.raises(RunFolderError, match=f"not empty, and not written by skinnet run .it has {name[:3]}"),
        own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES),
    ):
        pass
    assert tree(tmp_path) == before


def test_of_an_earlier_output_only_its_own_files_are_removed(tmp_path: Path) -> None:
    write_all(tmp_path)
    for name in ("notes.txt", "parts/mine.npz"):
        (tmp_path / name).write_text("mine")
    with own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES):
        left = {path for path in tree(tmp_path) if not path.startswith((MARKER, ".skinnet"))}
        assert left == {"notes.txt", "parts/mine.npz"}


@pytest.mark.parametrize(("name", "said"), [("logs/body.log", "logs/body.log"), ("logs", "logs")])
def test_a_file_of_others_under_a_name_that_is_needed_is_refused(
    tmp_path: Path, name: str, said: str
) -> None:
    """The log was never written, so one that is there is not ours."""
    write_all(tmp_path)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    before = tree(tmp_path)
    with (
        pytest.raises(RunFolderError, match=f"{said} there was not written by skinnet run"),
        own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES),
    ):
        pass
    assert tree(tmp_path) == before


def test_a_list_that_leads_out_of_the_folder_removes_nothing_there(tmp_path: Path) -> None:
    out, other = tmp_path / "out", tmp_path / "other.txt"
    write_all(out)
    other.write_text("mine")
    marker = json.loads((out / MARKER).read_text())
    (out / MARKER).write_text(json.dumps(marker | {"files": ["../other.txt", str(other)]}))
    with own_folder(out, PROGRAM, DEPLOYMENT, ()):
        assert other.read_text() == "mine"


def test_another_program_and_a_file_are_refused(tmp_path: Path) -> None:
    write_all(tmp_path)
    before = tree(tmp_path)
    for path, said in ((tmp_path, "written by skinnet run; skinnet plan"), (tmp_path / MARKER, "is a file")):
        with pytest.raises(RunFolderError, match=said), own_folder(path, "skinnet plan", b"", ()):
            pass
    assert tree(tmp_path) == before


def test_a_file_added_later_is_listed_and_never_taken_from_others(tmp_path: Path) -> None:
    write_all(tmp_path)
    add_output_file(tmp_path, "report.html")
    (tmp_path / "report.html").write_text("ours")
    add_output_file(tmp_path, "report.html")
    (tmp_path / "point.json").write_text("mine")
    with pytest.raises(RunFolderError, match="not written by skinnet run"):
        add_output_file(tmp_path, "point.json")
    with own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES):
        assert not (tmp_path / "report.html").exists()
        assert (tmp_path / "point.json").exists()


def test_new_folders_of_the_same_second_differ(tmp_path: Path) -> None:
    made = [new_folder(tmp_path / "runs" / "arm") for _ in range(3)]
    assert [path.name for path in made] == ["arm", "arm-2", "arm-3"]


def test_a_result_of_another_run_or_deployment_is_refused(tmp_path: Path) -> None:
    own, other = RunIdentity("one", "d1"), [RunIdentity("two", "d1"), RunIdentity("one", "d2")]
    ProcessResult("left", "cells", {}, {"a": np.arange(2)}).save(tmp_path, own)
    back = ProcessResult.load(tmp_path, "left", own)
    assert list(back.arrays) == ["a"]
    for identity in other:
        with pytest.raises(RunFolderError, match="the result of another run or deployment"):
            ProcessResult.load(tmp_path, "left", identity)
    head = (tmp_path / "left.json").read_bytes()
    ProcessResult("left", "cells", {}, {"a": np.arange(2)}).save(tmp_path, other[0])
    (tmp_path / "left.json").write_bytes(head)  # the arrays of one run beside the facts of another
    with pytest.raises(RunFolderError, match=r"left\.npz"):
        ProcessResult.load(tmp_path, "left", own)


def test_the_identity_is_that_of_the_marker(tmp_path: Path) -> None:
    assert identity_of(tmp_path) is None
    with own_folder(tmp_path, PROGRAM, DEPLOYMENT, FILES) as owned:
        assert identity_of(tmp_path) == owned.identity
    (tmp_path / MARKER).write_text("{half")
    assert identity_of(tmp_path) is None
