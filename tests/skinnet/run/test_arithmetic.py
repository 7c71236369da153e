"""The fingerprint of a computer's arithmetic tells which parts differ between computers, and is cheap."""

import os
import subprocess
import sys
import time

import msgspec
import pytest
from locations import DEPLOYMENTS

from skinnet.deployment.controller.nursing import NursingSpec
from skinnet.deployment.environment.scripted_stimuli import ScriptedStimuliSpec
from skinnet.deployment.load import load
from skinnet.deployment.network import PowerSpec
from skinnet.run.arithmetic import arithmetic, battery_of_functions, compare_arithmetic, used_parts

ALL = ("functions", "mujoco", "blas")
WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX_Fast_Unaligned_Load"


def elsewhere(**variables: str) -> dict[str, str]:
    """The fingerprint in a process that sees another CPU."""
    program = f"import json; from skinnet.run.arithmetic import arithmetic as a; print(json.dumps(a({ALL})))"
    line, environment = [sys.executable, "-c", program], os.environ | variables
    done = subprocess.run(line, capture_output=True, text=True, check=True, env=environment)
    return msgspec.json.decode(done.stdout, type=dict[str, str])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="tunables are those of glibc")
@pytest.mark.parametrize(
    ("variables", "parts"),
    [
        ({}, set()),
        ({"GLIBC_TUNABLES": WITHOUT_FMA}, {"mujoco"}),
        ({"OPENBLAS_CORETYPE": "Nehalem"}, {"blas"}),
    ],
    ids=["same", "libm", "BLAS"],
)
def test_a_part_differs_at_most_if_it_depends_on_the_cpu(variables: dict[str, str], parts: set[str]) -> None:
    """An old CPU has one variant of each function: then nothing differs."""
    here, there = arithmetic(ALL), elsewhere(**variables)
    differing = {part for part in here if here[part] != there[part]} - {"all"}
    assert differing <= parts
    assert (here["all"] != there["all"]) == bool(differing)
    reason = compare_arithmetic({"arithmetic": here}, {"arithmetic": there})
    assert bool(reason) == bool(differing)
    assert all(part in reason for part in differing)


def test_an_older_summary_is_compared_as_ever() -> None:
    assert compare_arithmetic({"arithmetic": arithmetic()}, {"log_sha256": "1"}) == ""


def test_only_parts_that_both_runs_use_are_compared() -> None:
    """A scripted body uses no MuJoCo, and only power grid and quadratic programme use BLAS."""
    here = {"arithmetic": arithmetic(ALL)}
    blas = {"arithmetic": arithmetic(ALL) | {"blas": "0"}}
    scripted = {"arithmetic": arithmetic(("functions",))}
    assert compare_arithmetic(here, {"arithmetic": arithmetic() | {"all": "0"}}) == ""
    assert compare_arithmetic(scripted, {"arithmetic": arithmetic() | {"mujoco": "0"}}) == ""
    assert compare_arithmetic(here, blas) == (
        "computed with another arithmetic (blas): values may differ in their last bits, and hashes cannot be "
        "compared"
    )
    assert "(versions)" in compare_arithmetic(here, {"arithmetic": arithmetic() | {"versions": "0"}})


def test_parts_are_those_that_a_deployment_uses() -> None:
    arm = load(DEPLOYMENTS / "two_link_arm.toml")
    riba = load(DEPLOYMENTS / "riba_cylinder.toml")
    nursing = riba.nursing
    assert isinstance(nursing, NursingSpec)
    assert used_parts(arm) == used_parts(riba) == ("functions", "mujoco")
    scripted = msgspec.structs.replace(arm, scripted_stimuli=ScriptedStimuliSpec())
    assert used_parts(scripted) == ("functions",)
    assert used_parts(msgspec.structs.replace(scripted, power=PowerSpec())) == ("functions", "blas")
    solver = msgspec.structs.replace(nursing, solver="qp")
    assert used_parts(msgspec.structs.replace(riba, nursing=solver)) == ALL


def test_the_fingerprint_costs_little() -> None:
    """All parts in less CPU time than one compilation; 10 ms, once the compiled function is loaded."""
    battery_of_functions()
    arithmetic.cache_clear()
    start_s = time.process_time()
    arithmetic(ALL)
    assert time.process_time() - start_s < 0.1
