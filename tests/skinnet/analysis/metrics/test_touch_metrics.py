"""Touch metrics from made-up results: each number follows what it is about, and nothing else."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from synthetic_results import (
    MS,
    N_CELLS,
    N_DOFS,
    TICK_NS,
    TOUCH_DEPLOYMENT,
    S,
    ticks_ns,
    touch_body,
    touch_controller,
    touch_facts,
)

from skinnet.analysis.metrics.touch import (
    actuation_metrics,
    evasion_metrics,
    force_metrics,
    guidance_metrics,
    proximity_metrics,
    reaction_metrics,
    reactions,
    rows_by_cell_name,
    touch_metrics,
)

ROW = rows_by_cell_name(TOUCH_DEPLOYMENT)["left_forearm/5"]
HELD = slice(60, 160)
"""Ticks of the hold phase of `touch_facts`, 0.3 to 0.8 s."""


def held_body(force_n: float = 1.0, **changes: Any) -> Any:
    trace_n = np.zeros(len(ticks_ns(S)), dtype=np.float32)
    trace_n[20:180] = force_n
    return touch_body(peak_force_n=trace_n, touches=[touch_facts()], **changes)


def read_controller(reading: np.ndarray | float, **arrays: Any) -> Any:
    told = np.zeros((len(ticks_ns(S)), N_CELLS, 4), dtype=np.float16)
    told[:, ROW, 0] = reading
    return touch_controller(tactile_input=told, **arrays)


@pytest.mark.parametrize("reading", [0.14, 0.05, 0.3])
def test_the_held_reading_is_what_the_cell_reads(reading: float) -> None:
    metrics = guidance_metrics(TOUCH_DEPLOYMENT, read_controller(reading), held_body())
    assert metrics["guidance.reading"] == pytest.approx(reading, rel=1e-3)
    assert metrics["guidance.ticks"] == HELD.stop - HELD.start


def test_white_noise_is_not_a_held_reading() -> None:
    """Chosen by the reading itself, noise from 0 to 1 on every cell gave 0.1397."""
    random = np.random.default_rng(1)
    told = random.uniform(0.0, 1.0, (len(ticks_ns(S)), N_CELLS, 4)).astype(np.float16)
    noisy = touch_controller(tactile_input=told)
    assert guidance_metrics(TOUCH_DEPLOYMENT, noisy, touch_body()) == {}, "nobody presses"
    metrics = guidance_metrics(TOUCH_DEPLOYMENT, noisy, held_body())
    assert metrics["guidance.reading"] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(("force_n", "ticks"), [(0.94, 0), (0.96, 100), (1.04, 100), (1.06, 0)])
def test_only_ticks_with_the_true_force_count(force_n: float, ticks: int) -> None:
    metrics = guidance_metrics(TOUCH_DEPLOYMENT, read_controller(0.14), held_body(force_n))
    assert metrics.get("guidance.ticks", 0) == ticks


def test_other_touches_and_stages_do_not_count() -> None:
    for controller, body in (
        (read_controller(0.14, stage="proximity_guidance"), held_body()),
        (read_controller(0.14), touch_body(touches=[touch_facts()])),
        (read_controller(0.14), touch_body(touches=[touch_facts(hold_ns=None)])),
    ):
        assert guidance_metrics(TOUCH_DEPLOYMENT, controller, body) == {}
    body = held_body()
    body.facts["touches"] = [touch_facts(depth_controlled=True)]
    assert guidance_metrics(TOUCH_DEPLOYMENT, read_controller(0.14), body) == {}


def test_velocities_are_norm_and_largest_joint_commanded_and_measured() -> None:
    t_ns = ticks_ns(S)
    velocity = np.zeros((len(t_ns), N_DOFS), dtype=np.float32)
    velocity[HELD, 2], velocity[HELD, 5] = 0.03, -0.04
    joint_rad = np.zeros((len(t_ns), N_DOFS), dtype=np.float32)
    joint_rad[:, 1] = 0.02 * t_ns / S
    metrics = guidance_metrics(
        TOUCH_DEPLOYMENT, read_controller(0.14, velocity_rad_s=velocity), held_body(joint_rad=joint_rad)
    )
    assert metrics["guidance.velocity_rad_s"] == pytest.approx(0.05, rel=1e-5)
    assert metrics["guidance.largest_dof_rad_s"] == pytest.approx(0.04, rel=1e-5)
    assert metrics["guidance.measured_rad_s"] == pytest.approx(0.02, rel=1e-3)


def drives(*rows: tuple[int, ...]) -> np.ndarray:
    return np.array(list(rows), dtype=touch_controller().arrays["reaction_log"].dtype)


def crossing(t_ns: int, cell: int = 7) -> list[Any]:
    return [t_ns, cell, 0, TOUCH_DEPLOYMENT.controller.stages["force_guidance"].force_threshold]


def test_a_reaction_is_timed_from_the_true_crossing_to_the_effect_in_the_body() -> None:
    """Sampled after 3 ms, delivered 1 ms later, used at the tick 2 ms later, in effect 9 ms after that."""
    log = drives((106 * MS, 103 * MS, 104 * MS, 7, 0, 0), (111 * MS, 107 * MS, 108 * MS, 7, 0, 0))
    command_ns = np.array([[106 * MS, 115 * MS], [111 * MS, 116 * MS]])
    controller = touch_controller(reaction_log=log)
    body = touch_body(threshold_crossings=[crossing(100 * MS)], command_ns=command_ns)
    found, unanswered = reactions(TOUCH_DEPLOYMENT, controller, body)
    metrics = reaction_metrics(found, unanswered)
    assert metrics["reaction.count"] == 1
    assert metrics["reaction.unanswered"] == 0
    for name, expected_ms in (("sampling", 3), ("network", 1), ("control", 2), ("latency", 15)):
        assert metrics[f"reaction.{name}_ms.p50"] == pytest.approx(expected_ms)
        assert metrics[f"reaction.{name}_ms.p99"] == pytest.approx(expected_ms)


def test_percentiles_are_over_reactions() -> None:
    log = drives(
        *((100 * k * MS + 6 * MS, 100 * k * MS + k * MS, 100 * k * MS + 5 * MS, 7, 0, 0) for k in (1, 2, 3))
    )
    command_ns = np.column_stack([log["tick_ns"], log["tick_ns"] + 5 * MS])
    body = touch_body(threshold_crossings=[crossing(100 * k * MS) for k in (1, 2, 3)], command_ns=command_ns)
    metrics = reaction_metrics(*reactions(TOUCH_DEPLOYMENT, touch_controller(reaction_log=log), body))
    assert metrics["reaction.sampling_ms.p50"] == pytest.approx(2.0)
    assert metrics["reaction.sampling_ms.p99"] == pytest.approx(2.98)
    assert metrics["reaction.network_ms.p50"] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("log", "command_ns"),
    [
        (drives(), [[106 * MS, 111 * MS]]),
        (drives((106 * MS, 99 * MS, 104 * MS, 7, 0, 0)), [[106 * MS, 111 * MS]]),
        (drives((306 * MS, 201 * MS, 204 * MS, 7, 0, 0)), [[306 * MS, 311 * MS]]),
        (drives((106 * MS, 103 * MS, 104 * MS, 8, 0, 0)), [[106 * MS, 111 * MS]]),
        (drives((106 * MS, 103 * MS, 104 * MS, 7, 1, 0)), [[106 * MS, 111 * MS]]),
        (drives((106 * MS, 103 * MS, 104 * MS, 7, 0, 0)), [[101 * MS, 111 * MS]]),
    ],
    ids=["no drive", "sampled before", "too late", "other cell", "other channel", "never in effect"],
)
def test_a_crossing_without_its_reaction_is_unanswered(log: np.ndarray, command_ns: list[list[int]]) -> None:
    body = touch_body(threshold_crossings=[crossing(100 * MS)], command_ns=np.array(command_ns))
    found, unanswered = reactions(TOUCH_DEPLOYMENT, touch_controller(reaction_log=log), body)
    assert (found, unanswered) == ([], 1)
    assert reaction_metrics(found, unanswered) == {"reaction.count": 0, "reaction.unanswered": 1}


def test_actuation_is_from_effect_to_true_motion_and_no_setting() -> None:
    onsets = [[100 * MS, 108 * MS], [200 * MS, 212 * MS], [300 * MS, None], [2 * S, 3 * S]]
    metrics = actuation_metrics(TOUCH_DEPLOYMENT, touch_controller(), touch_body(motion_onsets=onsets))
    assert metrics == {
        "reaction.motions_from_rest": 2,
        "reaction.actuation_ms.p50": pytest.approx(10.0),
        "reaction.actuation_ms.p99": pytest.approx(11.96),
    }
    assert actuation_metrics(TOUCH_DEPLOYMENT, touch_controller(), touch_body()) == {}


def test_the_onset_distance_is_the_true_gap() -> None:
    joint_rad = np.zeros((len(ticks_ns(S)), N_DOFS), dtype=np.float32)
    joint_rad[60:, 3] = -0.02
    touches = [
        touch_facts(stage="proximity_guidance", contact_ns=None, onset_gap_m=gap_m, peak_force_n=force_n)
        for gap_m, force_n in ((0.052, 0.0), (0.047, 0.3), (None, 0.0))
    ]
    controller = touch_controller(stage="proximity_guidance")
    metrics = proximity_metrics(
        TOUCH_DEPLOYMENT, controller, touch_body(touches=touches, joint_rad=joint_rad)
    )
    assert metrics == {
        "proximity.touches": 3,
        "proximity.unanswered": 1,
        "proximity.moved_before_contact_rad.min": pytest.approx(0.02),
        "proximity.contacts": 0,
        "proximity.peak_force_n": 0.3,
        "proximity.onset_distance_mm.min": pytest.approx(47.0),
        "proximity.onset_distance_mm.max": pytest.approx(52.0),
    }
    touches[0]["contact_ns"] = 200 * MS
    metrics = proximity_metrics(
        TOUCH_DEPLOYMENT, controller, touch_body(touches=touches, joint_rad=joint_rad)
    )
    assert metrics["proximity.contacts"] == 1
    assert metrics["proximity.moved_before_contact_rad.min"] == 0.0, "it moved after the contact"


def test_the_peak_force_is_of_touches_along_a_path() -> None:
    touches = [touch_facts(peak_force_n=9.0)]
    assert "contact.peak_force_n" not in touch_metrics(
        TOUCH_DEPLOYMENT, touch_controller(), touch_body(touches=touches)
    )
    touches += [touch_facts(peak_force_n=force_n, depth_controlled=True) for force_n in (2.0, 3.5)]
    metrics = touch_metrics(TOUCH_DEPLOYMENT, touch_controller(), touch_body(touches=touches))
    assert metrics["contact.peak_force_n"] == 3.5
    assert TOUCH_DEPLOYMENT.controller.period_ns == TICK_NS


def test_what_the_skin_feels_is_compared_with_the_force_on_the_finger() -> None:
    whole = replace(TOUCH_DEPLOYMENT.teacher.touches[0], force_cell=None)
    deployment = replace(TOUCH_DEPLOYMENT, teacher=replace(TOUCH_DEPLOYMENT.teacher, touches=(whole,)))
    touches = [touch_facts(mean_felt_force_n=felt_n) for felt_n in (1.01, 0.9, 1.02)]
    metrics = force_metrics(deployment, touch_body(touches=touches))
    assert metrics["contact.felt_error.p50"] == pytest.approx(0.02)
    assert metrics["contact.felt_error.max"] == pytest.approx(0.1)
    others = [touch_facts(depth_controlled=True, peak_force_n=2.0), touch_facts(hold_ns=None)]
    assert force_metrics(deployment, touch_body(touches=others)) == {"contact.peak_force_n": 2.0}
    assert force_metrics(TOUCH_DEPLOYMENT, touch_body(touches=touches)) == {}, "of force cells"


def test_cells_that_move_inwards_evade_and_others_show_a_wrong_sign() -> None:
    ways_m = (0.02, 0.0005, -0.003, 0.004, None)
    touches = [touch_facts(evaded_m=way_m) for way_m in ways_m]
    touches.append(touch_facts(stage="proximity_guidance", evaded_m=0.1))
    metrics = evasion_metrics(TOUCH_DEPLOYMENT, touch_controller(), touch_body(touches=touches))
    assert metrics["evasion.touches"] == 4
    assert (metrics["evasion.inwards"], metrics["evasion.outwards"]) == (2, 1)
    assert metrics["evasion.way_mm.p50"] == pytest.approx(2.25)
    assert evasion_metrics(TOUCH_DEPLOYMENT, touch_controller(), touch_body()) == {}
