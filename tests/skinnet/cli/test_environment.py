"""Commands on computers whose environment variables do not suit them."""

import os
import subprocess
import sys

import pytest
from locations import ROOT

ARM, RIBA = "two_link_arm", "riba_trajectory"


@pytest.mark.parametrize(
    "variables",
    [
        {"MUJOCO_GL": "nonsense"},
        {"MUJOCO_GL": "osmesa"},
        {"PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "LC_ALL": "C"},
    ],
    ids=["unknown renderer", "missing renderer", "C locale"],
)
def test_a_command_runs_whatever_the_environment_says(variables: dict[str, str]) -> None:
    line = [sys.executable, "-m", "skinnet.cli", "check", str(ROOT / "deployments" / f"{ARM}.toml")]
    done = subprocess.run(line, capture_output=True, check=False, env=os.environ | variables, timeout=120)
    assert done.returncode == 0, done.stderr.decode(errors="replace")


def test_the_nursing_controller_loads_without_the_renderer() -> None:
    program = "import controller.nursing.core, mujoco; mujoco.MjSpec()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        check=False,
        env=os.environ | {"MUJOCO_GL": "nonsense"},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
