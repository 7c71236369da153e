"""Runs, seeds and reports in folders that others use, too."""

import json
import signal
import subprocess
from pathlib import Path

import pytest
from launching import command, launched, skinnet, wait_for
from reported import ARM, small_run

from skinnet.analysis.report.run_folder import read_run_folder
from skinnet.errors import RunFolderError
from skinnet.output_folder import MARKER, own_folder

INSTANT = ("run.max_s=0.05",)


def test_every_file_of_a_run_is_listed(tmp_path: Path) -> None:
    summary = small_run(tmp_path)
    marker = json.loads((tmp_path / MARKER).read_text())
    files = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert files - {MARKER, ".skinnet.lock"} == set(marker["files"])
    assert summary["run_id"] == marker["run_id"]
    assert summary["deployment_sha256"] == marker["deployment_sha256"]
    small_run(tmp_path, *INSTANT, plots=False)  # an earlier run is replaced, its pictures included
    assert not list(tmp_path.glob("*.png"))


def test_a_summary_beside_the_files_of_another_run_is_not_reported(tmp_path: Path) -> None:
    for seed in (1, 2):
        small_run(tmp_path / f"{seed}", *INSTANT, seed=seed, plots=False)
    read_run_folder(tmp_path / "1")
    (tmp_path / "1" / "summary.json").write_bytes((tmp_path / "2" / "summary.json").read_bytes())
    with pytest.raises(RunFolderError, match="of another run"):
        read_run_folder(tmp_path / "1")


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", str(ARM), "--in-process", "--no-plots", "--set", "run.max_s=0.05", "--out"),
        ("run", str(ARM), "--seeds", "1-2", "--in-process", "--no-plots", "--set", "run.max_s=0.05", "--out"),
        ("stress", str(ARM), "--quick", "--no-plots", "--out"),
        ("plan", str(ARM), "--no-plots", "--out"),
    ],
    ids=["run", "seeds", "stress", "plan"],
)
def test_commands_refuse_folders_of_others_in_one_line(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    for used, said in ((False, "not empty"), (True, "another run is writing")):
        out = tmp_path / said.replace(" ", "_")
        program = f"skinnet {arguments[0]}"
        if used:
            with own_folder(out, program, b"", ()):
                code, errors = called(*arguments, str(out))
        else:
            (out / "logs").mkdir(parents=True)
            (out / "logs" / "mine").write_text("mine")
            code, errors = called(*arguments, str(out))
            assert [path.name for path in out.rglob("*")] == ["logs", "mine"]
        assert code == 2, errors
        assert said in errors
        assert errors.count("\n") == 1


def called(*arguments: str) -> tuple[int, str]:
    done = skinnet(*arguments)
    return done.returncode, done.stderr


@pytest.mark.processes
@pytest.mark.timeout(300)
def test_a_second_run_leaves_the_folder_of_the_first_alone(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, settings=("run.max_s=4",)) as process:
        wait_for(process, "structure")
        process.send_signal(signal.SIGSTOP)  # else it may be over before the second has started
        late = subprocess.run(
            command(ARM, "--seed", "2", "--no-plots", "--out", str(tmp_path)),
            capture_output=True,
            text=True,
            check=False,
            timeout=200,
        )
        process.send_signal(signal.SIGCONT)
        assert late.returncode == 2
        assert "another run is writing there" in late.stderr
        process.communicate(timeout=200)
        assert process.returncode == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["seed"] == 1
    assert json.loads((tmp_path / "deployment.json").read_text())["seed"] == 1
