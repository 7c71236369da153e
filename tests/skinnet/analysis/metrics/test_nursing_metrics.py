"""Nursing metrics from made-up results: deviations, forces, pressures, and where the object went."""

from typing import Any

import numpy as np
import pytest
from synthetic_results import CYLINDER_DEPLOYMENT, MS, S

from skinnet.analysis.metrics.nursing import board_metrics, contact_label, nursing_metrics
from skinnet.runtime.process_result import ProcessResult


def contact(name: str, **changes: float) -> dict[str, Any]:
    return {
        "name": name,
        "position_dev_end_m": 0.001,
        "position_dev_peak_m": 0.002,
        "rotation_dev_end_rad": 0.01,
        "rotation_dev_peak_rad": 0.02,
        "force_start_n": 60.0,
        "force_min_n": 50.0,
        "force_max_n": 70.0,
        "force_end_n": 61.0,
        "cop_peak_m": 0.010,
        "cop_end_m": 0.003,
    } | changes


def controller(**changes: Any) -> ProcessResult:
    facts = {
        "states": [["hold", 0], ["move", S], ["report", 2 * S]],
        "stopped_by": None,
        "reason": "",
        "peak_kpa": 11.5,
        "contacts": [
            contact("left_forearm_inside"),
            contact("right_forearm_inside", cop_peak_m=0.012, cop_end_m=0.001),
        ],
    }
    return ProcessResult("controller", "controller", facts | changes)


def body(moved_m: tuple[float, float, float] = (0.1, 0.0, 0.0), **changes: Any) -> ProcessResult:
    """The object is held aside for one second, then moves by `moved_m`."""
    t_ns = np.arange(0, 3 * S, 10 * MS, dtype=np.int64)
    pose = np.tile(np.array([0.0, -0.4, 0.9, 1.0, 0.0, 0.0, 0.0]), (len(t_ns), 1))
    pose[:50, 0] -= 0.5  # before the program begins to move it
    pose[t_ns > S, :3] += moved_m
    truth = {
        "released_ns": 0,
        "dropped_ns": None,
        "dropped_by": "",
        "slid_m": 0.004,
        "sliding_distance_m": 0.0007,
    } | changes
    return ProcessResult("body", "body", {"payload": truth}, {"object_t_ns": t_ns, "object_pose": pose})


def test_the_way_of_the_object_is_compared_with_its_target() -> None:
    target_m = CYLINDER_DEPLOYMENT.nursing.waypoints[-1].displacement_m
    metrics = nursing_metrics(CYLINDER_DEPLOYMENT, controller(), body(target_m))
    assert metrics["B.object_error_mm"] == pytest.approx(0.0, abs=1e-9)
    off_m = np.add(target_m, (0.003, -0.004, 0.0))
    metrics = nursing_metrics(CYLINDER_DEPLOYMENT, controller(), body(tuple(off_m)))
    assert metrics["B.object_error_mm"] == pytest.approx(5.0)
    never = controller(states=[["hold", 0]])
    assert "B.object_error_mm" not in nursing_metrics(CYLINDER_DEPLOYMENT, never, body())


def test_a_move_that_begins_at_the_end_has_no_way_yet() -> None:
    """The run ends before the next pose is recorded: the object has still its whole way before it."""
    moved = body()
    moved.arrays["object_pose"][-1, :3] += 0.007
    for begin_ns in (3 * S - 10 * MS, 3 * S):
        metrics = nursing_metrics(CYLINDER_DEPLOYMENT, controller(states=[["move", begin_ns]]), moved)
        target_m = CYLINDER_DEPLOYMENT.nursing.waypoints[-1].displacement_m
        assert metrics["B.object_error_mm"] == pytest.approx(1e3 * np.linalg.norm(target_m))


def test_drop_slip_and_rotation_are_ground_truth() -> None:
    held = nursing_metrics(CYLINDER_DEPLOYMENT, controller(), body())
    assert held["B.dropped"] is False
    assert held["B.dropped_by"] == "nothing"
    assert held["B.slid_mm"] == pytest.approx(4.0)
    assert held["B.slip_mm"] == pytest.approx(0.7)
    assert (held["B.rotation_deg.peak"], held["B.rotation_deg.end"]) == (0.0, 0.0)
    fallen = body(dropped_ns=5, dropped_by="slid", slid_m=0.111)
    fallen.arrays["object_pose"][100:200, 3:] = np.cos(np.pi / 12), 0.0, np.sin(np.pi / 12), 0.0
    fallen.arrays["object_pose"][200:, 3:] = np.cos(np.pi / 36), 0.0, np.sin(np.pi / 36), 0.0
    fallen.arrays["object_pose"][-1, 3:] = np.cos(np.pi / 60), 0.0, np.sin(np.pi / 60), 0.0
    metrics = nursing_metrics(CYLINDER_DEPLOYMENT, controller(), fallen)
    assert metrics["B.dropped"] is True
    assert metrics["B.dropped_by"] == "slid"
    assert metrics["B.slid_mm"] == pytest.approx(111.0)
    assert metrics["B.rotation_deg.peak"] == pytest.approx(30.0)
    assert metrics["B.rotation_deg.end"] == pytest.approx(6.0)


def test_contacts_pressure_and_outcome_are_the_controllers() -> None:
    metrics = nursing_metrics(CYLINDER_DEPLOYMENT, controller(), None)
    assert metrics["B.state"] == "report"
    assert metrics["B.stopped_by"] == "nothing"
    assert "B.reason" not in metrics
    assert metrics["B.peak_pressure_kpa"] == 11.5
    assert metrics["B.position_dev_mm.left"] == pytest.approx(1.0)
    assert metrics["B.position_dev_mm.left.peak"] == pytest.approx(2.0)
    assert metrics["B.rotation_dev_deg.right"] == pytest.approx(0.5729578)
    assert metrics["B.rotation_dev_deg.right.peak"] == pytest.approx(1.1459156)
    for when, force_n in (("start", 60.0), ("min", 50.0), ("max", 70.0), ("end", 61.0)):
        assert metrics[f"B.force_n.left.{when}"] == force_n
    assert metrics["B.cop_mm.peak"] == pytest.approx(12.0)
    assert metrics["B.cop_mm.end"] == pytest.approx(3.0)
    stopped = controller(states=[], stopped_by="contact_lost", reason="no force on the left")
    metrics = nursing_metrics(CYLINDER_DEPLOYMENT, stopped, None)
    assert (metrics["B.state"], metrics["B.stopped_by"]) == ("hold", "contact_lost")
    assert metrics["B.reason"] == "no force on the left"


def test_contacts_are_named_by_side_only_if_that_is_clear() -> None:
    two = ["left_forearm", "right_forearm"]
    assert [contact_label(name, two) for name in two] == ["left", "right"]
    four = [*two, "left_upper_arm", "right_upper_arm"]
    assert [contact_label(name, four) for name in four] == four


def boards(**counts: int) -> ProcessResult:
    entry = {"offered": 10, "in_flight": 1, "delivered": 7, "loss": 2, "queue_full": 0} | counts
    histogram = np.zeros(1000, dtype=np.int64)
    histogram[[100, 200]] = 98, 2
    facts = {"boards": {"regions": entry, "pattern": dict.fromkeys(entry, 0)}, "latency_max_ns": 201_500}
    return ProcessResult("boards", "boards", facts, {"latency_us": histogram})


def test_messages_of_the_boards_are_conserved_or_it_is_said() -> None:
    metrics = board_metrics(boards())
    assert metrics["network.conserved"] is True
    assert metrics["network.dropped"] == metrics["network.dropped.loss"] == 2
    assert "network.dropped.queue_full" not in metrics
    assert metrics["network.latency_us.p50"] == 100.0
    assert metrics["network.latency_us.p99"] == 200.0
    assert metrics["network.latency_us.max"] == 201.5
    for wrong in ({"offered": 11}, {"in_flight": 0}, {"delivered": 6}, {"loss": 3}):
        assert board_metrics(boards(**wrong))["network.conserved"] is False
