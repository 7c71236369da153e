"""Runs on CPUs with other instruction sets, which variables of glibc, OpenBLAS and NumPy pretend."""

import sys
from pathlib import Path
from typing import Any

import pytest
from launching import run, run_alone
from locations import DEPLOYMENTS

from skinnet.run.arithmetic import compare_arithmetic

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(sys.platform != "linux", reason="the variables are those of glibc"),
]

WITHOUT_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX_Fast_Unaligned_Load"
OTHER_LIBM = {"GLIBC_TUNABLES": WITHOUT_FMA}
OTHER_BLAS = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR AVX2 FMA3 AVX512F AVX512_SKX",
}
SCRIPTED = (
    "scripted_stimuli.stimulated_fraction=0.5",
    "scripted_stimuli.random_presses.start_s=0.0",
    "scripted_stimuli.random_presses.pause_s=0.1",
    "teacher.touches=[]",
    "run.max_s=0.6",
)
ARM = ("run.max_s=0.6",)


def here(name: str, out: Path, settings: tuple[str, ...]) -> dict[str, Any]:
    """Summary of a short run on this CPU."""
    return run(DEPLOYMENTS / f"{name}.toml", out / "here", "--in-process", settings=settings)


def there(name: str, out: Path, settings: tuple[str, ...], **variables: str) -> dict[str, Any]:
    """Summary of the same in a process that sees another CPU; Numba may warn that it does not know it."""
    file, variables = DEPLOYMENTS / f"{name}.toml", {"PYTHONWARNINGS": "ignore"} | variables
    return run_alone(file, out / "there", "--in-process", settings=settings, **variables)


def test_a_scripted_run_has_the_same_log_and_metrics_on_any_cpu(tmp_path: Path) -> None:
    own, other = (
        here("two_link_arm", tmp_path, SCRIPTED),
        there("two_link_arm", tmp_path, SCRIPTED, **OTHER_LIBM, **OTHER_BLAS),
    )
    assert own["metrics"]["network.delivered"] > 1000
    assert other["log_sha256"] == own["log_sha256"]
    assert other["arithmetic"] == own["arithmetic"]
    assert other["metrics"] == own["metrics"]


@pytest.mark.parametrize(
    ("name", "settings"),
    [("two_link_arm", ARM), ("riba_trajectory", ("run.max_s=1.5",))],
)
def test_a_simulated_body_has_the_same_log_with_any_blas(
    name: str, settings: tuple[str, ...], tmp_path: Path
) -> None:
    own, other = here(name, tmp_path, settings), there(name, tmp_path, settings, **OTHER_BLAS)
    assert other["arithmetic"] == own["arithmetic"]
    assert other["log_sha256"] == own["log_sha256"]


def test_a_simulated_body_has_the_same_log_or_its_summary_names_mujoco(tmp_path: Path) -> None:
    """MuJoCo calls the C library: where that has one variant only, the logs are equal."""
    own, other = here("two_link_arm", tmp_path, ARM), there("two_link_arm", tmp_path, ARM, **OTHER_LIBM)
    reason = compare_arithmetic(own, other)
    assert "(mujoco)" in reason or other["log_sha256"] == own["log_sha256"]
    assert (reason == "") == (own["arithmetic"] == other["arithmetic"])
