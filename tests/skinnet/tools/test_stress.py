"""A sweep varies what it says and nothing else, measures what was there, and survives what goes wrong."""

import json
import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import launching
import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from locations import ROOT
from small_robot import patch, small

import skinnet.tools.stress.sweep
from skinnet.analysis.report.html import render_html
from skinnet.analysis.report.run_folder import StressResults, read_run_folder
from skinnet.cli.main import main
from skinnet.deployment import Deployment
from skinnet.deployment.checks import check
from skinnet.deployment.experiment.stress import PublishedRateSpec, StressSpec
from skinnet.errors import DeploymentError, ProcessFailedError, SkinnetError
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.usage import USAGE_ROW, UsageTrace
from skinnet.tools.stress.measurement import MeasurementWindow, measure_point, usage_within
from skinnet.tools.stress.plots import draw_plots
from skinnet.tools.stress.points import Point, derive_deployment, derive_points, noise_sigma, sweep_points
from skinnet.tools.stress.sweep import PointResult, run_sweep
from skinnet.tools.stress.sweep_metrics import delta_at_published, nearest_delta, sweep_metrics

ARM = ROOT / "deployments" / "two_link_arm.toml"
SCRIPTED = (
    "scripted_stimuli.stimulated_fraction=0.5",
    "scripted_stimuli.random_presses.start_s=0.0",
    "scripted_stimuli.random_presses.pause_s=0.1",
)


def row_of_patches(**tables: Any) -> Deployment:
    """Three patches of six cells, a bridge between the first two, and everything that names a patch."""
    patches = [patch(name) for name in ("a", "b", "c")]
    for i, one in enumerate(patches):
        one["lattice"]["origin_m"] = (0.3 * i, 0.0, 0.0)
    return small(*patches, scripted_stimuli={"stimulated_fraction": 0.5}, **tables)


# What is varied


def test_points_are_all_combinations_each_once() -> None:
    spec = StressSpec(
        cells=(6, 7, 18),
        gateways=(1, 2),
        stimulated_fractions=(0.0, 0.5),
        encodings=("periodic", "send_on_delta"),
        delta_noise_ratios=(3.0,),
    )
    points = sweep_points(row_of_patches(), spec)
    assert len(points) == len({point.name for point in points}) == 3 * 2 * 2 * 2 + 2
    assert {point.cells for point in points} == {6, 12, 18}  # by whole patches
    assert {p.stimulated for p in points if p.delta_sigma is not None} == {0.0, 0.5}
    assert all(p.cells == 18 and p.encoding == "send_on_delta" for p in points if p.delta_sigma is not None)


def test_a_sweep_of_nothing_is_the_deployment_itself_touched_and_not() -> None:
    points = sweep_points(row_of_patches(), StressSpec(encodings=("periodic",)))
    assert points == [Point(18, "periodic", stimulated=0.0), Point(18, "periodic", stimulated=0.5)]
    assert sweep_points(small(), StressSpec(encodings=("periodic",))) == [Point(8, "periodic")]


@given(cells=st.integers(1, 18))
def test_whole_patches_are_kept_until_there_are_enough_cells(cells: int) -> None:
    (point, *_) = sweep_points(row_of_patches(), StressSpec(cells=(cells,)))
    assert cells <= point.cells < cells + 6


def test_a_smaller_skin_forgets_whatever_names_the_patches_that_are_gone() -> None:
    deployment = row_of_patches(
        cell_processes={"one": ("a", "c"), "two": ("b",)},
        faults=(
            {"kind": "link_cut", "target": "c/0:1", "at_s": 1.0},
            {"kind": "link_cut", "target": "a/0:1", "at_s": 1.0},
        ),
    )
    spec = StressSpec(cells=(6,))
    derived = derive_deployment(deployment, Point(6, "periodic", stimulated=0.25), spec)
    check(derived)
    assert [one.name for one in derived.patches] == ["a"]
    assert derived.cell_processes == {"one": ("a",)}
    assert [rule.target for rule in derived.faults] == ["a/0:1"]
    assert derived.scripted_stimuli is not None
    assert derived.scripted_stimuli.stimulated_fraction == 0.25
    assert derived.cells.encoding.kind == "periodic"


def test_a_point_without_wishes_changes_what_is_run_and_nothing_else() -> None:
    deployment = row_of_patches()
    derived = derive_deployment(deployment, Point(18, "level_crossing"), StressSpec())
    for name in (
        "name",
        "robot",
        "seed",
        "cell_processes",
        "body",
        "cells",
        "network",
        "patches",
        "scripted_stimuli",
    ):
        assert getattr(derived, name) == getattr(deployment, name)
    assert derived.controller.program == ("listen",)
    assert derived.controller.stages["listen"].duration_s == StressSpec().warm_up_s + StressSpec().duration_s


def test_gateways_are_as_many_as_asked_for() -> None:
    derived = derive_deployment(row_of_patches(), Point(18, "periodic", gateways=2), StressSpec())
    assert [len(one.interfaces) for one in derived.patches] == [2, 2, 2]


def test_thresholds_follow_the_noise_of_the_sensors() -> None:
    deployment = row_of_patches()
    cells = derive_deployment(deployment, Point(18, "send_on_delta", delta_sigma=3.0), StressSpec()).cells
    # noise 0.004 and steps of 1/1024: independent errors add as squares
    assert cells.force.delta == pytest.approx(3.0 * math.sqrt(0.004**2 + (1 / 1024) ** 2 / 12))
    sigma = noise_sigma(deployment.cells)
    assert cells.accelerometer.delta_g / sigma["acceleration"] == pytest.approx(3.0)
    assert cells.temperature.delta_c / sigma["temperature"] == pytest.approx(3.0)
    assert cells.proximity.delta / sigma["proximity"] == pytest.approx(3.0)


def test_what_cannot_be_is_refused_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def refused(deployment: Deployment, said: str, **spec: Any) -> None:
        with pytest.raises(DeploymentError, match=said):
            derive_points(deployment, StressSpec(**spec))

    refused(row_of_patches(), "has 18 cells, at most that", cells=(6, 19))
    refused(row_of_patches(), "gateways: give 1 to", gateways=(1, 100))
    refused(small(), r"need \[scripted_stimuli\]", stimulated_fractions=(0.0, 0.5))
    assert list(tmp_path.iterdir()) == []


# What is measured


def test_usage_is_noted_on_a_grid_of_simulated_time() -> None:
    trace = UsageTrace(lambda: (10, 20))
    for t_ns in range(0, 1_000_000_000, 4_000_000):
        trace.sample(t_ns)
    rows = trace.rows
    assert len(rows) == 20
    assert (np.diff(rows["t_ns"]) <= 54_000_000).all()
    assert (np.diff(rows["cpu_s"]) >= 0.0).all()
    assert (rows["received_bytes"] == 10).all()
    assert (rows["sent_bytes"] == 20).all()


def test_what_was_used_outside_the_window_does_not_count() -> None:
    rows = np.zeros(5, dtype=USAGE_ROW)
    rows["t_ns"] = [0, 100, 200, 300, 400]
    rows["cpu_s"] = [0.0, 7.0, 8.0, 10.0, 99.0]
    used = usage_within(ProcessResult("x", "cells", {}, {"usage": rows}), MeasurementWindow(100, 300))
    assert used["cpu_s"] == 3.0
    with pytest.raises(SkinnetError, match="too short"):
        usage_within(ProcessResult("x", "cells", {}, {"usage": rows}), MeasurementWindow(110, 290))


def swept(**shares: float) -> list[PointResult]:
    """Results of send-on-delta with deltas of k2, k4, … multiples of the noise."""
    return [
        PointResult(
            Point(6, "send_on_delta", stimulated=0.0, delta_sigma=float(name[1:])), {"fraction.bytes": share}
        )
        for name, share in shares.items()
    ]


def test_the_threshold_that_gives_a_published_share_is_found_between_two_points() -> None:
    published = PublishedRateSpec(fraction=0.1, stimulated=False, source="x")
    assert delta_at_published(swept(k2=1.0, k4=0.01), published, "bytes") == pytest.approx(3.0)
    assert delta_at_published(swept(k4=0.01, k2=1.0, k3=0.1), published, "bytes") == pytest.approx(3.0)
    assert delta_at_published(swept(k2=0.05, k4=0.01), published, "bytes") is None
    assert delta_at_published(swept(k2=1.0, k4=0.0), published, "bytes") is None
    touched = PublishedRateSpec(fraction=0.1, stimulated=True, source="x")
    assert delta_at_published(swept(k2=1.0, k4=0.01), touched, "bytes") is None


def test_the_thresholds_nearest_to_what_was_published_are_nearest_to_all_of_it() -> None:
    shares = {2.0: (0.4, 0.5), 3.0: (0.2, 0.4), 5.0: (0.001, 0.45), 9.0: (0.0, 0.45)}
    results = [
        PointResult(
            Point(6, "send_on_delta", stimulated=touched, delta_sigma=sigma), {"fraction.packets": share}
        )
        for sigma, both in shares.items()
        for touched, share in zip((0.0, 0.5), both, strict=True)
    ]
    untouched, touched, bound = (
        PublishedRateSpec(fraction=0.16, stimulated=False, source="x"),
        PublishedRateSpec(fraction=0.45, stimulated=True, source="x"),
        PublishedRateSpec(fraction=0.01, stimulated=True, source="x", is_upper_bound=True),
    )
    assert nearest_delta(results, StressSpec(published=(untouched, touched, bound))) == 3.0
    assert nearest_delta(results, StressSpec(published=(touched,))) in (5.0, 9.0)
    assert nearest_delta(results, StressSpec(published=(bound,))) is None
    assert nearest_delta([], StressSpec(published=(touched,))) is None


# Real sweeps


def stress(*arguments: str, settings: tuple[str, ...] = SCRIPTED) -> "subprocess.CompletedProcess[str]":
    sets = [word for setting in settings for word in ("--set", setting)]
    return launching.skinnet("stress", str(ARM), *sets, *arguments)


@pytest.fixture(scope="module")
def small_sweep(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Two points of 15 cells, through real processes."""
    out = tmp_path_factory.mktemp("sweep")
    done = stress(
        "--quick",
        "--encodings",
        "periodic,send_on_delta",
        "--stimulated",
        "0.5",
        "--out",
        str(out),
        "--json",
        "-",
    )
    assert done.returncode == 0, done.stderr
    return out, json.loads(done.stdout)


@pytest.mark.processes
def test_a_sweep_through_real_processes_loses_nothing(small_sweep: tuple[Path, dict[str, Any]]) -> None:
    out, report = small_sweep
    figures = report["metrics"]
    assert report["points"] == ["c15-periodic-s0.5", "c15-send_on_delta-s0.5"]
    assert report == json.loads((out / "stress.json").read_text())
    for name in report["points"]:
        f = {key.removeprefix(f"{name}."): value for key, value in figures.items() if key.startswith(name)}
        assert f["conserved"]
        assert f["offered"] == f["delivered"] + f["dropped"] + f["in_flight"]
        assert f["received"] <= f["delivered"]
        assert f["missing"] == f["rejected"] == f["malformed_messages"] == f["dropped"] == 0
        assert 0.0 < f["latency_us.p50"] <= f["latency_us.p99"] <= f["latency_us.p999"]
        assert 0.0 <= f["machine_us.p50"] <= f["machine_us.p99"]
        assert f["cpu.all"] == pytest.approx(
            sum(f[f"cpu.{who}"] for who in ("body", "cells0", "cells1", "controller"))
        )
        assert 0.0 < f["cores.controller"] <= 2.0
        assert f["peak_mb.controller"] > 20.0
        assert 0.0 <= f["others_cores"] <= psutil.cpu_count()
        # each packet takes 60 bytes of a stream, or more as an event
        assert f["zenoh_bytes_per_s"] > 60 * f["packets_per_s"]
    clock = 15 * 250
    assert figures["periodic.stimulated.packets_per_s"] == pytest.approx(clock, rel=1e-3)
    assert figures["periodic.stimulated.fraction.packets"] == pytest.approx(1.0, rel=1e-3)
    assert figures["periodic.stimulated.fraction.bytes"] == pytest.approx(1.0, rel=1e-3)
    share = figures["send_on_delta.stimulated.fraction.packets"]
    assert 0.0 < share < 1.0
    assert figures["send_on_delta.stimulated.fraction.bytes"] == pytest.approx(share * 8 / 23)
    assert {path.name for path in out.glob("*.png")} == {
        f"{n}.png" for n in ("rates", "latency", "cpu", "event_driven")
    }
    results = read_run_folder(out)
    assert isinstance(results, StressResults)
    assert results.summary.points == tuple(report["points"])
    assert results.metrics["size.cells"] == 15
    assert len(results.files.pictures) == 4
    assert "c15-send_on_delta-s0.5" in render_html(results)


@pytest.mark.processes
def test_a_sweep_goes_on_where_it_was_killed(
    small_sweep: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, report = small_sweep
    deployment = prepare_run(RunOptions(ARM, SCRIPTED)).deployment
    spec = StressSpec(
        **{name: tuple(v) if isinstance(v, list) else v for name, v in report["stress"].items()}
    )

    def fail(*_: object) -> None:
        raise ProcessFailedError("cells0 was killed by signal 9; its last lines:\n    one\n    two")

    monkeypatch.setattr(skinnet.tools.stress.sweep, "run_once", fail)
    told: list[str] = []
    points = derive_points(deployment, spec)
    kept = run_sweep(ARM, points, spec, out, resume=True, progress=told.append)
    assert [result.failure for result in kept] == [None, None]
    assert kept[0].metrics == json.loads((out / "c15-periodic-s0.5" / "point.json").read_text())["metrics"]
    assert not any("arithmetic" in line for line in told)
    # nor does a result of another computer's arithmetic belong beside ours
    saved = out / "c15-periodic-s0.5" / "point.json"
    ours = json.loads(saved.read_text())
    theirs = ours | {"mark": "another", "arithmetic": ours["arithmetic"] | {"functions": "0"}}
    saved.write_text(json.dumps(theirs))
    run_sweep(ARM, points, spec, out, resume=True, progress=told.append)
    saved.write_text(json.dumps(ours))
    (reason,) = [line for line in told if "arithmetic" in line]
    assert reason == (
        "1/2 c15-periodic-s0.5: not kept, computed with another arithmetic (functions): values may differ in "
        "their last bits, and hashes cannot be compared"
    )
    # another seed makes other points
    points = derive_points(prepare_run(RunOptions(ARM, (*SCRIPTED, "seed=2"))).deployment, spec)
    other = run_sweep(ARM, points, spec, out, resume=True, progress=told.append)
    assert all(result.failure for result in other)
    assert other[0].failure == "cells0 was killed by signal 9; its last lines: two"
    figures = sweep_metrics(deployment, spec, [kept[0], other[1]])
    assert (figures["points"], figures["failed"]) == (2, 1)
    draw_plots(deployment, spec, [kept[0], other[1]], out / "half")


@pytest.mark.processes
def test_a_skin_that_does_not_form_is_a_failed_point(small_sweep: tuple[Path, dict[str, Any]]) -> None:
    out, _ = small_sweep
    folder = out / "c15-periodic-s0.5"
    names = ["body", "cells0", "cells1", "controller"]
    deployment = prepare_run(RunOptions(ARM, SCRIPTED)).deployment
    with pytest.raises(SkinnetError, match="did not form"):
        measure_point(deployment, StressSpec(warm_up_s=1000.0), folder, names)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--cells", "99"), "stress.cells: 99; two_link_arm has 15 cells"),
        (("--cells", "ten"), "--cells ten: must be numbers"),
        (("--cells", "0"), "stress: Expected a whole number >= 1"),
        (("--encodings", "morse"), "stress: Invalid enum value 'morse'"),
        (("--stimulated", "1.5"), "stress: Expected a number <= 1.0"),
        (("--sigmas", "0"), "stress: Expected a number > 0.0"),
        (("--duration-s", "-1"), "stress: Expected a number > 0.0"),
        (("--gateways", "7"), "7 gateways: give 1 to"),
        (("--resume",), "--resume needs --out"),
    ],
)
def test_bad_input_is_one_clear_line(
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = () if arguments == ("--resume",) else ("--out", str(tmp_path / "out"))
    monkeypatch.setattr(sys, "argv", ["skinnet", "stress", str(ARM), *arguments, *out])
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as exit_info:
        main()
    errors = capsys.readouterr().err
    assert exit_info.value.code == 2
    assert said in errors
    assert len(errors.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
