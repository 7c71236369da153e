"""Grasp and object metrics from made-up results: a success needs every one of its conditions."""

from typing import Any

import numpy as np
import pytest
from synthetic_results import GRASP_DEPLOYMENT, S, grasp_body, grasp_controller, grasp_transitions

from skinnet.analysis.metrics.grasp import grasp_metrics, object_metrics
from skinnet.analysis.metrics.object_pose import rotation_deg
from skinnet.runtime.process_result import ProcessResult


def grasped(body: ProcessResult, **grasp: Any) -> dict[str, Any]:
    return grasp_metrics(GRASP_DEPLOYMENT, grasp_controller(grasp_transitions(**grasp)), body)


def test_a_grasp_with_everything_is_a_success() -> None:
    assert grasped(grasp_body())["grasp.success"] is True


@pytest.mark.parametrize(
    "changes",
    [
        {"dropped_ns": 7},
        {"carried_on_skin_s": 4.9},
        {"max_descent_m": 0.07},
        {"object_stand_force_n": np.array([9.81, 4.9])},
    ],
    ids=["dropped", "on the bare belly", "sunk by 70 mm", "not back on the stand"],
)
def test_an_object_that_was_not_carried_is_no_success(changes: dict[str, Any]) -> None:
    assert grasped(grasp_body(**changes))["grasp.success"] is False


def test_the_greatest_descent_still_counts() -> None:
    stand = GRASP_DEPLOYMENT.stand
    assert stand is not None
    assert grasped(grasp_body(max_descent_m=stand.max_descent_m))["grasp.success"] is True


@pytest.mark.parametrize("contacts", [(0, 11, 1), (12, 0, 1), (12, 11, 0)])
def test_a_pull_needs_contacts_of_both_arms_and_the_chest(contacts: tuple[int, int, int]) -> None:
    metrics = grasped(grasp_body(), contacts=contacts)
    assert metrics["grasp.success"] is False
    assert metrics["grasp.pull.contact_cells"] == list(contacts)


def test_a_release_that_does_not_end_is_no_success() -> None:
    assert grasped(grasp_body(), last_event="timeout")["grasp.success"] is False


def test_a_hold_without_a_request_to_release_is_no_success() -> None:
    log = grasp_transitions()
    log[5]["event"] = "contact lost"
    assert grasp_metrics(GRASP_DEPLOYMENT, grasp_controller(log), grasp_body())["grasp.success"] is False


def test_the_object_must_be_back_with_half_its_weight() -> None:
    half = np.array([0.0, 0.51 * 9.81], dtype=np.float32)
    assert grasped(grasp_body(object_stand_force_n=half))["grasp.success"] is True


@pytest.mark.parametrize("peak_n", [0.6, 0.75, 1.0])
def test_peak_force_and_its_reading_follow_the_force(peak_n: float) -> None:
    body = grasp_body()
    body.arrays["peak_force_n"][:] = 0.1
    body.arrays["peak_force_n"][40] = peak_n
    metrics = grasped(body)
    assert metrics["grasp.peak_force_n"] == pytest.approx(peak_n)
    # the calibration is a line from 0.05 at 0.6 N to 0.14 at 1.0 N [M14]
    assert metrics["grasp.peak_reading"] == pytest.approx(0.05 + 0.225 * (peak_n - 0.6), abs=1e-6)
    assert metrics["grasp.pull.peak_force_n"] == 0.9
    assert metrics["grasp.hold.peak_force_n"] == 0.0


def test_readings_and_speeds_are_those_of_the_grasp() -> None:
    controller = grasp_controller(grasp_transitions())
    controller.arrays["patch_readings"][50, 2, 0] = 0.2
    controller.arrays["velocity_rad_s"][70, 3] = -0.9
    metrics = grasp_metrics(GRASP_DEPLOYMENT, controller, grasp_body())
    assert metrics["grasp.peak_reading_received"] == pytest.approx(0.2)
    assert metrics["grasp.peak_speed_rad_s"] == pytest.approx(0.9)
    assert metrics["grasp.hold_s"] == pytest.approx(10.0)
    assert metrics["grasp.start_s.hold"] == pytest.approx(6.0)
    assert metrics["grasp.attempts"] == 1
    assert metrics["grasp.final_state"] == "idle" or metrics["grasp.final_state"] == "release"


@pytest.mark.parametrize("peak_s", [0.5, 8.0, 16.0])
def test_only_the_time_of_the_grasp_counts(peak_s: float) -> None:
    """It begins with its stage at 0.5 s and ends at 16 s; what is greater before and after is not its own."""
    controller, body = grasp_controller(grasp_transitions()[:6]), grasp_body()
    controller.facts |= {"stages": [["guide", 0], ["teach_and_grasp", S // 2]], "end_ns": 17 * S}
    controller.facts["transitions"][-1]["next_state"] = "idle"
    peak_n, t_ns = body.arrays["peak_force_n"], body.arrays["peak_force_t_ns"]
    told, speed = controller.arrays["patch_readings"], controller.arrays["velocity_rad_s"]
    for series in (peak_n, told[:, 0, 0], speed[:, 0]):
        series[:] = 0.9
        series[(t_ns >= S // 2) & (t_ns <= 16 * S)] = 0.6
        series[t_ns == peak_s * S] = 0.7
    metrics = grasp_metrics(GRASP_DEPLOYMENT, controller, body)
    assert metrics["grasp.start_s.open"] == 0.5
    for name in ("peak_force_n", "peak_reading_received", "peak_speed_rad_s"):
        assert metrics[f"grasp.{name}"] == pytest.approx(0.7), name


def test_a_cancelled_grasp_says_where_and_why() -> None:
    log = grasp_transitions()
    log[4] |= {"event": "contact lost", "next_state": "set_down"}
    log[5:] = [log[5] | {"state": "set_down", "event": "pose reached", "next_state": "idle"}]
    metrics = grasp_metrics(GRASP_DEPLOYMENT, grasp_controller(log), grasp_body())
    assert (metrics["grasp.cancelled_in"], metrics["grasp.cancelled_by"]) == ("pull", "contact lost")
    assert metrics["grasp.success"] is False


def test_the_object_is_described_by_its_ground_truth() -> None:
    met = {"belly[3]": {"peak_force_n": 4.5, "duration_s": 1.25}}
    body = grasp_body(rigid_contacts=met, max_descent_m=0.031, dropped_ns=5, carried_on_skin_s=2.0)
    pose = body.arrays["object_pose"]
    pose[100:, :3] += (0.01, -0.02, 0.03)
    pose[50:100, 3:] = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))
    pose[100:, 3:] = (-np.cos(np.pi / 36), np.sin(np.pi / 36), 0.0, 0.0)
    metrics = object_metrics(body)
    assert metrics["object.max_descent_mm"] == pytest.approx(31.0)
    assert metrics["object.dropped"] is True
    assert metrics["object.carried_s"] == 6.0
    assert metrics["object.carried_on_skin_s"] == 2.0
    assert metrics["object.bare_link.belly[3].peak_force_n"] == 4.5
    assert metrics["object.bare_link.belly[3].contact_s"] == 1.25
    assert metrics["object.displacement_m"] == pytest.approx([0.01, -0.02, 0.03], abs=1e-6)
    assert metrics["object.rotation_deg.peak"] == pytest.approx(45.0, abs=1e-3)
    assert metrics["object.rotation_deg.end"] == pytest.approx(10.0, abs=1e-3)


@pytest.mark.parametrize("angle_deg", [0.0, 1e-3, 30.0, 90.0, 179.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rotation_is_its_angle_whatever_the_axis_and_the_sign(angle_deg: float, sign: float) -> None:
    random = np.random.default_rng(3)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    half = np.radians(angle_deg) / 2.0
    start = random.normal(size=4)
    start /= np.linalg.norm(start)
    w, x, y, z = start
    a, (b, c, d) = np.cos(half), np.sin(half) * axis
    turned = sign * np.array(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    )
    poses = np.zeros((2, 7))
    poses[0, 3:], poses[1, 3:] = start, 1.0001 * turned
    assert rotation_deg(poses) == pytest.approx([0.0, angle_deg], abs=1e-9)
