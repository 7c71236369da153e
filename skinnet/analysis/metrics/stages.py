"""Stage intervals of the controller's program."""

from typing import NamedTuple

from skinnet.deployment import Deployment
from skinnet.deployment.controller.stages import StageSpec
from skinnet.runtime.process_result import ProcessResult

__all__ = ["StageInterval", "stage_intervals"]


class StageInterval(NamedTuple):
    """Stage interval, from its first tick to that of the next stage [ns]."""

    name: str
    start_ns: int
    end_ns: int
    spec: StageSpec


def stage_intervals(deployment: Deployment, controller: ProcessResult, kind: str) -> list[StageInterval]:
    """Intervals of the stages of one kind that were begun, in order."""
    log = controller.facts["stages"]
    begins = [t_ns for _, t_ns in log] + [controller.facts["end_ns"]]
    spans = [
        StageInterval(name, begins[i], begins[i + 1], deployment.controller.stages[name])
        for i, (name, _) in enumerate(log)
    ]
    return [span for span in spans if span.spec.kind == kind]
