"""Every shipped deployment runs; the touch deployment keeps what the paper and the documentation promise."""

import json
from pathlib import Path
from typing import Any

import pytest
from launching import TOUCH, run
from locations import ROOT, SHIPPED_DEPLOYMENTS
from reported import ARM, SHORT

from skinnet.analysis.report.claims import Verdict
from skinnet.analysis.report.run_folder import RunResults, read_run_folder
from skinnet.deployment import load

pytestmark = pytest.mark.timeout(400)


SPREAD = ("hrp2_touch", "riba_cylinder")
"""One of cells and one of sheets, which run in processes in every run of the suite."""


@pytest.mark.processes
@pytest.mark.parametrize(
    ("path", "arguments"),
    [
        pytest.param(
            path, arguments, id=f"{path.stem}{''.join(arguments)}", marks=[pytest.mark.long] * is_long
        )
        for path in SHIPPED_DEPLOYMENTS
        for arguments, is_long in (
            ((), path.stem not in SPREAD),
            (("--in-process",), path.stem in SPREAD),
        )
    ],
)
def test_every_deployment_runs(path: Path, arguments: tuple[str, ...], tmp_path: Path) -> None:
    summary = run(path, tmp_path, *arguments, settings=("run.max_s=1.0",))
    results = read_run_folder(tmp_path)
    assert isinstance(results, RunResults)
    assert results.files.deployment == load(path, ("run.max_s=1.0",))
    assert summary["outcome"] == "completed"
    assert summary["sim_s"] == pytest.approx(1.0, abs=0.02)
    assert summary["metrics"]["network.conserved"]
    assert summary["metrics"].get("formation.unreached_cells", 0) == 0  # sheets form no network
    assert {process.get("exit_code", 0) for process in summary["processes"]} == {0}


def assert_as_the_paper(folder: Path, least: int) -> None:
    """Every expectation of the report is kept, and at least so many were measured."""
    results = read_run_folder(folder)
    assert isinstance(results, RunResults)
    found = [compared.verdict for compared in results.comparisons]
    assert {Verdict.OUTSIDE, Verdict.UNMEASURED}.isdisjoint(found), results.comparisons
    assert found.count(Verdict.WITHIN) >= least


@pytest.fixture(scope="module")
def whole_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The main job from the first packet to the last touch."""
    folder = tmp_path_factory.mktemp("whole")
    run(TOUCH, folder, "--in-process")
    return folder


@pytest.fixture(scope="module")
def whole(whole_folder: Path) -> dict[str, Any]:
    """Its figures."""
    summary: dict[str, Any] = json.loads((whole_folder / "summary.json").read_text())
    figures: dict[str, Any] = summary["metrics"]
    return figures


def test_the_robot_finds_its_structure(whole: dict[str, Any]) -> None:
    assert whole["structure.wrong_entries"] == 0
    assert whole["structure.is_tree"]
    assert (whole["structure.body_parts"], whole["structure.joints"]) == (7, 6)
    assert whole["structure.duration_s"] == pytest.approx(70.0, rel=0.03)


def test_all_figures_are_as_in_the_paper(whole_folder: Path) -> None:
    assert_as_the_paper(whole_folder, least=8)


def test_the_map_agrees_with_the_jacobian(whole: dict[str, Any]) -> None:
    assert whole["smm.sign_agreement"] >= 0.97
    assert whole["smm.correlation"] >= 0.9
    assert whole["smm.correlation_normal"] >= 0.9


def test_guidance_moves_as_in_the_paper(whole: dict[str, Any]) -> None:
    assert whole["guidance.reading"] == pytest.approx(0.14, abs=0.005)
    assert whole["guidance.velocity_rad_s"] == pytest.approx(0.09, rel=0.05)
    assert whole["guidance.measured_rad_s"] == pytest.approx(0.09, rel=0.05)


def test_reactions_are_not_faster_than_their_parts(whole: dict[str, Any]) -> None:
    assert whole["reaction.count"] >= 30
    assert whole["reaction.motions_from_rest"] >= 5
    assert 0.0 < whole["reaction.actuation_ms.p50"] <= whole["reaction.actuation_ms.p99"] < 50.0
    # one hop of an event takes 8 bytes × 10 bit / 2 Mbit/s + 185 µs at least
    assert whole["reaction.network_ms.p50"] >= 0.225
    assert 5.0 < whole["reaction.latency_ms.p50"] < whole["reaction.latency_ms.p99"] < 50.0


def test_proximity_guidance_moves_the_arm_before_contact(whole: dict[str, Any]) -> None:
    assert whole["proximity.touches"] == 4
    assert whole["proximity.contacts"] == 0
    assert whole["proximity.moved_before_contact_rad.min"] > 0.01
    assert whole["proximity.unanswered"] == 0
    assert 40.0 < whole["proximity.onset_distance_mm.min"] <= whole["proximity.onset_distance_mm.max"] < 60.0


@pytest.mark.long
def test_reactions_spare_the_robot(whole: dict[str, Any], tmp_path: Path) -> None:
    settings = ("controller.reactions.enabled=false", "controller.structure.averaging_s=0.1")
    stiff = run(TOUCH, tmp_path, "--in-process", settings=settings)["metrics"]
    assert stiff["contact.peak_force_n"] >= 3.0 * whole["contact.peak_force_n"]
    assert stiff["reaction.count"] == 0
    assert stiff["proximity.moved_before_contact_rad.min"] < 1e-3


def test_too_much_noise_is_reported_honestly(tmp_path: Path) -> None:
    settings = ('controller.program=["structure"]', "cells.accelerometer.noise_g=0.4")
    settings += ("controller.structure.averaging_s=0.2", "controller.structure.settle_s=0.2")
    figures = run(ARM, tmp_path, "--in-process", settings=settings)["metrics"]
    assert figures["structure.wrong_entries"] > 0
    assert not figures["structure.is_tree"]
    assert figures["structure.problems"]


def test_send_on_delta_and_clock_reach_the_controller(tmp_path: Path) -> None:
    short = ('controller.program=["structure"]', "run.max_s=2.0")
    delivered = {}
    for kind in ("level_crossing", "send_on_delta", "periodic"):
        # an idle controller: nothing asks for streams
        settings = (*short, f"cells.encoding.kind={kind}", "controller.structure.averaging_s=0.004")
        delivered[kind] = run(ARM, tmp_path / kind, "--in-process", settings=settings)
    packets = {kind: summary["metrics"]["network.data_packets"] for kind, summary in delivered.items()}
    assert packets["periodic"] >= packets["level_crossing"]
    assert packets["send_on_delta"] >= packets["level_crossing"]


def test_bundling_changes_the_messages_and_not_the_run(tmp_path: Path) -> None:
    one, other = (
        run(ARM, tmp_path / bundled, "--in-process", settings=(*SHORT, f"network.aggregate_events={bundled}"))
        for bundled in ("false", "true")
    )
    assert one["metrics"] == other["metrics"]


@pytest.mark.processes
def test_real_time_keeps_to_the_wall_clock(tmp_path: Path) -> None:
    settings = ('controller.program=["structure"]', "run.max_s=3.0")
    summary = run(TOUCH, tmp_path, "--pace", "realtime", settings=settings)
    assert summary["loop_s"] >= 3.0 - 0.01
    assert summary["sim_s"] == pytest.approx(3.0, abs=0.02)
    assert isinstance(summary["deadline_misses"], int)


def test_the_summary_is_what_it_says(tmp_path: Path) -> None:
    run(TOUCH, tmp_path, "--in-process", settings=("run.max_s=0.2",))
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary.keys() >= {"outcome", "seed", "log_sha256", "sim_s", "wall_s", "rtf", "metrics"}
    assert summary.keys() >= {"processes", "process_failures", "counters"}
    assert all(not isinstance(value, dict) for value in summary["metrics"].values())


RIBA = ROOT / "deployments" / "riba_trajectory.toml"
CONTACTS = ("right_upper_arm_inside", "left_upper_arm_inside", "right_forearm_inside", "left_forearm_inside")


def deviations(folder: Path, *settings: str) -> tuple[dict[str, float], dict[str, float]]:
    """Of position [mm] and rotation [°] of experiment A at its end, by contact."""
    figures = run(RIBA, folder, "--in-process", settings=settings)["metrics"]
    assert (figures["A.state"], figures["A.stopped_by"]) == ("report", "nothing")
    return tuple(
        {c: figures[f"A.{name}.{c}"] for c in CONTACTS} for name in ("position_dev_mm", "rotation_dev_deg")
    )  # type: ignore[return-value]


def test_experiment_a_trades_position_for_rotation(tmp_path: Path) -> None:
    """Forearms deviate less than upper arms; ten-fold position weights lower every deviation of position."""
    position_mm, rotation_deg = deviations(tmp_path / "paper")
    for values in (position_mm, rotation_deg):
        assert max(values[c] for c in CONTACTS[2:]) < min(values[c] for c in CONTACTS[:2])
    tenfold = [
        f"nursing.weights.{side}_{link}.position={weight}"
        for side in ("right", "left")
        for link, weight in (("upper_arm", 3.0), ("forearm", 10.0))
    ]
    other_mm, other_deg = deviations(tmp_path / "tenfold", *tenfold)
    assert all(other_mm[c] < position_mm[c] for c in CONTACTS)
    assert all(other_deg[c] > rotation_deg[c] for c in CONTACTS)
    assert_as_the_paper(tmp_path / "paper", least=3)
    assert_as_the_paper(tmp_path / "tenfold", least=2)


@pytest.mark.long
def test_the_quadratic_programme_goes_the_same_way(tmp_path: Path) -> None:
    closed = deviations(tmp_path / "closed")
    programme = deviations(tmp_path / "qp", "nursing.solver=qp")
    for one, other in zip(closed, programme, strict=True):
        assert other == pytest.approx(one, abs=1e-3)


CYLINDER = ROOT / "deployments" / "riba_cylinder.toml"


def held(folder: Path, feedback: str, seed: int) -> dict[str, Any]:
    settings = (f"nursing.feedback={feedback}",)
    figures: dict[str, Any] = run(
        CYLINDER, folder / f"{feedback}-{seed}", "--in-process", "--seed", str(seed), settings=settings
    )["metrics"]
    assert figures["network.conserved"]
    return figures


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
def test_experiment_b_is_held_by_touch_alone(tmp_path: Path, seed: int) -> None:
    """The cylinder falls without feedback, is held with that of position, evenly with that of rotation."""
    blind, position, both = (held(tmp_path, mode, seed) for mode in ("none", "position", "position_rotation"))
    assert blind["B.dropped"]
    assert (blind["B.state"], blind["B.stopped_by"]) == ("stopped", "contact_lost")
    for figures in (position, both):
        assert not figures["B.dropped"]
        assert figures["B.state"] == "report"
        for side in ("left", "right"):
            start, least, most = (figures[f"B.force_n.{side}.{when}"] for when in ("start", "min", "max"))
            assert 0.7 * start <= least <= most <= 1.3 * start
        assert figures["B.object_error_mm"] < 10.0
    assert both["B.cop_mm.end"] <= 5.0
    assert both["B.cop_mm.peak"] <= 0.6 * position["B.cop_mm.peak"]
    for mode, least in (("none", 1), ("position", 4), ("position_rotation", 5)):
        assert_as_the_paper(tmp_path / f"{mode}-{seed}", least)


@pytest.mark.processes
def test_boards_main_pc_and_body_in_processes_say_the_same(tmp_path: Path) -> None:
    short = ("nursing.waypoints.0.t_s=0.5", "nursing.settle_s=0.2", "nursing.hold_s=0.8")
    logs = {
        run(CYLINDER, tmp_path / str(i), *arguments, settings=short)["log_sha256"]
        for i, arguments in enumerate([(), ("--in-process",)])
    }
    assert len(logs) == 1


@pytest.mark.parametrize(
    ("settings", "stopped_by"),
    [
        (("nursing.max_pressure_kpa=8",), "pressure_limit"),
        (("board_network.loss=1.0",), "skin_silent"),
        (("nursing.contact_threshold_n=200",), "no_contact"),
        (("nursing.position_tolerance_m=0.002", "nursing.waypoints.0.t_s=1.0"), "unreachable"),
    ],
)
def test_the_arms_hold_on_when_the_program_stops(
    tmp_path: Path, settings: tuple[str, ...], stopped_by: str
) -> None:
    short = ("nursing.hold_s=0.8", *settings)
    figures = run(CYLINDER, tmp_path, "--in-process", settings=short)["metrics"]
    assert (figures["B.state"], figures["B.stopped_by"]) == ("stopped", stopped_by)
    assert figures["B.reason"]
    assert not figures["B.dropped"]
