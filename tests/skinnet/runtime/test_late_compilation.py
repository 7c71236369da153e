"""Nothing compiles while a run goes on: a process that compiles sends no period end until it is done."""

import subprocess
import sys

import pytest

from tests.support.locations import DEPLOYMENTS, ROOT, SUPPORT

_PROGRAM = SUPPORT / "late_compilation.py"


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("two_link_arm", []),
        ("riba_cylinder", ["run.max_s=3"]),
        ("ur5_260", ["run.max_s=1"]),
        pytest.param("riba_cylinder", [], marks=pytest.mark.long),
        pytest.param("hrp2_grasp", [], marks=pytest.mark.long),
        pytest.param("hrp2_touch", [], marks=pytest.mark.long),
    ],
)
def test_nothing_compiles_while_a_run_goes_on(name: str, settings: list[str]) -> None:
    command = [sys.executable, str(_PROGRAM), str(DEPLOYMENTS / f"{name}.toml"), *settings]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == ""
