"""The fingerprint of a computer's arithmetic tells which parts differ between computers."""

import os
import subprocess
import sys

import msgspec
import pytest

from skinnet.run.arithmetic import arithmetic, compare_arithmetic

WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX_Fast_Unaligned_Load"


def elsewhere(**variables: str) -> dict[str, str]:
    """The fingerprint in a process that sees another CPU."""
    program = "import json; from skinnet.run.arithmetic import arithmetic as a; print(json.dumps(a()))"
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
    here, there = arithmetic(), elsewhere(**variables)
    differing = {part for part in here if here[part] != there[part]} - {"all"}
    assert differing <= parts
    assert (here["all"] != there["all"]) == bool(differing)
    reason = compare_arithmetic({"arithmetic": here}, {"arithmetic": there})
    assert bool(reason) == bool(differing)
    assert all(part in reason for part in differing)


def test_an_older_summary_is_compared_as_ever() -> None:
    assert compare_arithmetic({"arithmetic": arithmetic()}, {"log_sha256": "1"}) == ""
