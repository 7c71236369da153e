"""State intervals of a session: where the first one begins, how the last one ends, and the time in each."""

from typing import Any

import pytest
from synthetic_results import S, grasp_controller

from skinnet.analysis.metrics.teach_and_grasp import state_intervals, teach_and_grasp_metrics
from skinnet.runtime.process_result import ProcessResult


def session(*log: tuple[str, int, str], **facts: Any) -> ProcessResult:
    """Session with transitions (state, end [s], next state), each by an event and an argument of its own."""
    transitions = [
        {
            "state": state,
            "t_ns": end_s * S,
            "event": f"end of {state}",
            "next_state": following,
            "argument": f"for {following}",
            "contacts": [1, 2, 3],
        }
        for state, end_s, following in log
    ]
    controller = grasp_controller(transitions)
    controller.facts |= {"stages": [["teach_and_grasp", 0]], "end_ns": 30 * S} | facts
    return controller


STAGES = [["guide", 0], ["teach_and_grasp", 2 * S], ["guide", 12 * S]]


@pytest.mark.parametrize(
    ("log", "start_s"),
    [
        ([("idle", 5, "open"), ("open", 13, "ended")], 2),
        ([("idle", 5, "ended")], 2),
        ([("idle", 2, "open"), ("open", 13, "ended")], 2),
        ([("idle", 1, "open"), ("open", 13, "ended")], 0),
    ],
    ids=["a later stage too", "one transition", "at once", "in the first stage"],
)
def test_a_session_begins_with_the_stage_of_its_first_transition(
    log: list[tuple[str, int, str]], start_s: int
) -> None:
    spans = state_intervals(session(*log, stages=STAGES))
    assert [span.state for span in spans] == [state for state, *_ in log]
    assert [span.start_ns for span in spans] == [start_s * S, *(end_s * S for _, end_s, _ in log[:-1])]
    assert [span.end_ns for span in spans] == [end_s * S for _, end_s, _ in log]


def test_a_session_without_a_stage_begins_with_the_run() -> None:
    assert state_intervals(session(("idle", 5, "ended"), stages=[]))[0].start_ns == 0


def test_the_last_state_lasts_to_the_end_of_the_run_unless_the_session_ended() -> None:
    log = [("idle", 5, "open"), ("open", 13, "hold")]
    spans = state_intervals(session(*log))
    assert [(span.state, span.event, span.argument) for span in spans] == [
        ("idle", "end of idle", ""),
        ("open", "end of open", "for open"),
        ("hold", "", "for hold"),
    ]
    assert spans[1].contacts == (1, 2, 3)
    assert (spans[-1].start_ns, spans[-1].end_ns, spans[-1].contacts) == (13 * S, 30 * S, ())
    assert len(state_intervals(session(log[0], ("open", 13, "ended")))) == 2


def test_the_time_in_a_state_adds_up_over_its_intervals() -> None:
    log = [("idle", 5, "open"), ("open", 8, "idle"), ("idle", 12, "open"), ("open", 13, "ended")]
    facts = {"poses": ["open", "closed"], "areas": {"palm": [4, 5, 6]}, "refused_requests": [{}, {}]}
    assert teach_and_grasp_metrics(session(*log, **facts)) == {
        "teach_and_grasp.poses": ["closed", "open"],
        "teach_and_grasp.refused_requests": 2,
        "teach_and_grasp.area_cells.palm": 3,
        "teach_and_grasp.state_s.idle": pytest.approx(9.0),
        "teach_and_grasp.state_s.open": pytest.approx(4.0),
    }


def test_a_run_without_a_session_has_none_of_these_metrics() -> None:
    assert teach_and_grasp_metrics(session()) == {}
    assert state_intervals(ProcessResult("controller", "controller", {})) == []
