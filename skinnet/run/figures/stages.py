"""When the controller was in which stage of its program."""

from typing import NamedTuple

from skinnet.deployment import Deployment
from skinnet.deployment.schema import StageSpec
from skinnet.part import Part

__all__ = ["StageSpan", "stage_spans"]


class StageSpan(NamedTuple):
    """One stage, from its first tick to the next one's [ns]."""

    name: str
    start_ns: int
    end_ns: int
    spec: StageSpec


def stage_spans(deployment: Deployment, controller: Part, kind: str) -> list[StageSpan]:
    """The stages of a kind that were begun, in their order."""
    log = controller.facts["stages"]
    begins = [t_ns for _, t_ns in log] + [controller.facts["end_ns"]]
    spans = [
        StageSpan(name, begins[i], begins[i + 1], deployment.controller.stages[name])
        for i, (name, _) in enumerate(log)
    ]
    return [span for span in spans if span.spec.kind == kind]
