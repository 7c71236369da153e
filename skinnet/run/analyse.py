"""Analysis of an ended run: metrics and plots, from the results of its processes and the model."""

from functools import cached_property
from pathlib import Path

from skinnet.analysis.metrics import Metrics, compute_metrics
from skinnet.protocol.channels import RECORDER
from skinnet.run.prepare import PreparedRun
from skinnet.runtime.outcome import Outcome
from skinnet.runtime.process_result import ProcessResult

__all__ = ["RunAnalysis"]


class RunAnalysis:
    """Analysis of a run; metrics and plots see the same results.

    Args:
        prepared: Deployment and base folder.
        outcome: Results of the processes.
    """

    def __init__(self, prepared: PreparedRun, outcome: Outcome) -> None:
        self._deployment, self._base = prepared.deployment, prepared.base
        self._outcome = outcome

    @cached_property
    def metrics(self) -> Metrics:
        """Metrics that the results allow, flat by dotted name; those of the recording come last."""
        results = {result.name: result for result in self._outcome.results}
        return compute_metrics(self._deployment, self._base, results) | _recording_metrics(
            results.get(RECORDER)
        )

    def draw_plots(self, folder: Path) -> list[str]:
        """Draw the plots that the results allow into `folder`; return messages about those that failed."""
        from skinnet.analysis.plots import draw_plots  # matplotlib takes a second to import

        return draw_plots(self._deployment, self._base, self._outcome, folder)


def _recording_metrics(result: ProcessResult | None) -> Metrics:
    """Return the metrics of the recording: message counts, bytes, bytes per simulated second."""
    if result is None:
        return {}
    counts = {
        f"recording.messages.{name}": count for name, count in result.facts["messages"].items() if count
    }
    size, sim_s = result.facts["bytes"], result.facts["end_ns"] * 1e-9
    return counts | {"recording.bytes": size, "recording.bytes_per_sim_s": size / sim_s if sim_s > 0 else 0.0}
