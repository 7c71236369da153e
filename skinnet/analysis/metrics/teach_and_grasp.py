"""Teach-and-grasp metrics: state intervals of the controller, and the events that ended them."""

from typing import Any, NamedTuple

from skinnet.runtime.process_result import ProcessResult

__all__ = ["StateInterval", "state_intervals", "teach_and_grasp_metrics"]


class StateInterval(NamedTuple):
    """State interval [ns], the event that ended it, and the cells in contact then, by arm, then chest.

    `argument` is that of the request that began it.
    """

    state: str
    start_ns: int
    end_ns: int
    event: str
    argument: str
    contacts: tuple[int, ...]


def state_intervals(controller: ProcessResult) -> list[StateInterval]:
    """State intervals in order; the last one ends with the run, without an event."""
    log: list[dict[str, Any]] = controller.facts.get("transitions", [])
    if not log:
        return []
    spans = []
    start_ns, argument = _begin_ns(controller), ""
    for entry in log:
        spans.append(
            StateInterval(
                entry["state"], start_ns, entry["t_ns"], entry["event"], argument, tuple(entry["contacts"])
            )
        )
        start_ns, argument = entry["t_ns"], entry["argument"]
    end_ns = controller.facts["end_ns"]
    if log[-1]["next_state"] != "ended":
        spans.append(StateInterval(log[-1]["next_state"], start_ns, end_ns, "", argument, ()))
    return spans


def _begin_ns(controller: ProcessResult) -> int:
    """Start of the session's stage [ns]: the last stage that began before its first transition."""
    first_ns = controller.facts["transitions"][0]["t_ns"]
    return max((t_ns for _, t_ns in controller.facts["stages"] if t_ns <= first_ns), default=0)


def teach_and_grasp_metrics(controller: ProcessResult) -> dict[str, Any]:
    """Metrics of a session: poses, areas, refused requests, and the time in each state."""
    spans = state_intervals(controller)
    if not spans:
        return {}
    metrics: dict[str, Any] = {
        "teach_and_grasp.poses": sorted(controller.facts["poses"]),
        "teach_and_grasp.refused_requests": len(controller.facts["refused_requests"]),
    }
    for label, cells in sorted(controller.facts["areas"].items()):
        metrics[f"teach_and_grasp.area_cells.{label}"] = len(cells)
    for span in spans:
        key = f"teach_and_grasp.state_s.{span.state}"
        metrics[key] = metrics.get(key, 0.0) + (span.end_ns - span.start_ns) * 1e-9
    return metrics
