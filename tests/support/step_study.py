"""Metrics at 1 ms and at half of it, over many seeds: how far a shorter step moves their means and peaks.

`python tests/support/step_study.py touch --seeds 24 --out touch.csv` runs a scene 24 times at both steps and
prints a table in Markdown, metrics that move most first. It takes minutes.

Noise, sampling phases, sway and model errors come from the seed. A shorter step moves events by fractions of
a millisecond, from one sampling period into another: so a pair of runs differs by chance as well, and the
change of a mean has an interval. It is that of Student's t for the differences of pairs.
"""

import argparse
import csv
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from locations import DEPLOYMENTS
from rich.console import Console
from scipy.stats import t as student_t

from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay

__all__ = ["MAX_CHANGE", "SCENES", "STEPS_MS", "Change", "changes", "metrics_of"]

STEPS_MS = (1.0, 0.5)
MAX_CHANGE = {"mean": 0.02, "peak": 0.05}
"""Largest change of a mean and of a peak when the step is halved, as a fraction."""
_PEAKS = ("peak", "max", "p99")
"""Parts of the names of metrics that are extremes of a run."""
_CONFIDENCE = 0.95
_NOT_OF_THE_RUN = ("arithmetic", "recording.")


def _touches() -> str:
    """Touches of the touch scene: a held force, then taps at twelve phases of the periods of 4 and 5 ms.

    All begin at whole milliseconds, and when the finger is free: else a touch would begin with a step after
    its time, and earlier at half the step.
    """
    touches = [
        '{ cell = "fore_link/2", stage = "evade", start_s = 0.2, approach_m = 0.02, force_cell = 0, '
        "force_n = 1.0, hold_s = 1.5 }"
    ]
    touches += [
        f'{{ cell = "fore_link/{i % 3}", stage = "evade", start_s = {3.5 + 0.553 * i:.3f}, '
        "approach_m = 0.02, speed_m_s = 0.15, depth_m = 0.008, hold_s = 0.05 }"
        for i in range(12)
    ]
    return f"teacher.touches=[{', '.join(touches)}]"


SCENES = {
    "touch": (
        "two_link_arm",
        (
            'controller.program=["map", "evade"]',
            "controller.map.periods=1",
            "controller.stages.evade.duration_s=10.2",
            _touches(),
        ),
    ),
    "hold": (
        "riba_cylinder",
        (
            "nursing.hold_s=0.7",
            "nursing.settle_s=0.5",
            "nursing.waypoints=[{ t_s = 1.8, displacement_m = [0.05, 0.0, 0.0] }]",
        ),
    ),
    "grasp": ("hrp2_grasp", ()),
}
"""Deployment and settings of each scene: 14, 4 and 43 s of simulated time."""


class Change(NamedTuple):
    """Change of a metric over all seeds when the step is halved.

    Attributes:
        name: Name of the metric.
        mean: Mean over the seeds at the longer step.
        change: Change of the mean, as a fraction of the larger one of both.
        margin: Half the width of the 95 % interval of `change`.
        allowed: Largest change that is allowed.
    """

    name: str
    mean: float
    change: float
    margin: float
    allowed: float

    @property
    def is_beyond(self) -> bool:
        """True if the change is beyond what is allowed, and not by chance."""
        return abs(self.change) - self.margin > self.allowed


def metrics_of(scene: str, seed: int, step_ms: float) -> dict[str, float]:
    """Numeric metrics of one run of a scene, in this process."""
    deployment, settings = SCENES[scene]
    options = RunOptions(
        DEPLOYMENTS / f"{deployment}.toml",
        (*settings, f"body.timestep_ms={step_ms}"),
        in_process=True,
        plots=False,
    )
    with tempfile.TemporaryDirectory() as folder:
        progress = ProgressDisplay(Console(quiet=True), quiet=True)
        summary = run_once(prepare_run(options, seed), Path(folder) / "run", progress)
    return {
        name: float(value)
        for name, value in summary["metrics"].items()
        if isinstance(value, (int, float)) and not name.startswith(_NOT_OF_THE_RUN)
    }


def changes(coarse: Sequence[dict[str, float]], fine: Sequence[dict[str, float]]) -> list[Change]:
    """Changes of all metrics that every run has, from `coarse` to `fine`, one run a seed in each."""
    found = []
    for name in coarse[0]:
        if not all(name in metrics for metrics in (*coarse, *fine)):
            continue
        before = np.array([metrics[name] for metrics in coarse])
        after = np.array([metrics[name] for metrics in fine])
        differences, n, mean = after - before, len(before), float(before.mean())
        if not differences.any():
            found.append(Change(name, mean, 0.0, 0.0, _allowed(name)))
            continue
        scale = max(abs(mean), abs(float(after.mean())), 1e-12)
        spread = float(differences.std(ddof=1)) / np.sqrt(n) if n > 1 else np.inf
        margin = float(student_t.ppf(0.5 + 0.5 * _CONFIDENCE, max(n - 1, 1))) * spread / scale
        found.append(Change(name, mean, float(differences.mean()) / scale, margin, _allowed(name)))
    return found


def _allowed(name: str) -> float:
    return MAX_CHANGE["peak" if any(part in name for part in _PEAKS) else "mean"]


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    runs: dict[float, list[dict[str, float]]] = {step_ms: [] for step_ms in STEPS_MS}
    for seed in range(1, arguments.seeds + 1):
        for step_ms in STEPS_MS:
            runs[step_ms].append(metrics_of(arguments.scene, seed, step_ms))
        sys.stderr.write(f"seed {seed}\n")
        if arguments.out is not None:
            _write(arguments.out, runs)
    table = sorted(changes(*runs.values()), key=lambda row: -abs(row.change))
    sys.stdout.write(
        "| metric | mean at 1 ms | change at 0.5 ms | ± | allowed |\n| --- | --- | --- | --- | --- |\n"
    )
    for row in table:
        sys.stdout.write(
            f"| {row.name} | {row.mean:.5g} | {row.change:+.2%} | {row.margin:.2%} | {row.allowed:.0%} |\n"
        )
    return int(any(row.is_beyond for row in table))


def _write(out: Path, runs: dict[float, list[dict[str, float]]]) -> None:
    """Write one row for each seed, step and metric."""
    with out.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["seed", "step_ms", "metric", "value"])
        for step_ms, found in runs.items():
            for index, metrics in enumerate(found):
                writer.writerows([index + 1, step_ms, name, value] for name, value in metrics.items())


if __name__ == "__main__":
    sys.exit(_main())
