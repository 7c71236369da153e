"""Runs on CPUs with other instruction sets, which variables of glibc, OpenBLAS and NumPy pretend."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
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


def summary(name: str, out: Path, settings: tuple[str, ...], **variables: str) -> dict[str, Any]:
    """Summary of a short run in a process that sees another CPU."""
    sets = [word for setting in settings for word in ("--set", setting)]
    file = str(DEPLOYMENTS / f"{name}.toml")
    line = [sys.executable, "-W", "ignore", "-m", "skinnet.cli", "run", file, *sets]
    line += ["--in-process", "--no-plots", "--out", str(out)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, env=os.environ | variables)
    content: dict[str, Any] = json.loads((out / "summary.json").read_text()) if out.exists() else {}
    assert content.get("log_sha256"), done.stderr + done.stdout
    return content


def test_a_scripted_run_has_the_same_log_and_metrics_on_any_cpu(tmp_path: Path) -> None:
    here = summary("two_link_arm", tmp_path / "here", SCRIPTED)
    there = summary("two_link_arm", tmp_path / "there", SCRIPTED, **OTHER_LIBM, **OTHER_BLAS)
    assert here["metrics"]["network.delivered"] > 1000
    assert there["log_sha256"] == here["log_sha256"]
    assert there["arithmetic"] == here["arithmetic"]
    assert there["metrics"] == here["metrics"]


@pytest.mark.parametrize(
    ("name", "settings"),
    [("two_link_arm", ARM), ("riba_trajectory", ("run.max_s=1.5",))],
)
def test_a_simulated_body_has_the_same_log_with_any_blas(
    name: str, settings: tuple[str, ...], tmp_path: Path
) -> None:
    here = summary(name, tmp_path / "here", settings)
    there = summary(name, tmp_path / "there", settings, **OTHER_BLAS)
    assert there["arithmetic"] == here["arithmetic"]
    assert there["log_sha256"] == here["log_sha256"]


def test_a_simulated_body_has_the_same_log_or_its_summary_names_mujoco(tmp_path: Path) -> None:
    """MuJoCo calls the C library: where that has one variant only, the logs are equal."""
    here = summary("two_link_arm", tmp_path / "here", ARM)
    there = summary("two_link_arm", tmp_path / "there", ARM, **OTHER_LIBM)
    reason = compare_arithmetic(here, there)
    assert "(mujoco)" in reason or there["log_sha256"] == here["log_sha256"]
    assert (reason == "") == (here["arithmetic"] == there["arithmetic"])
