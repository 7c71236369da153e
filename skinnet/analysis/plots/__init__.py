"""Plots of a run, one file each, from the results of its processes."""

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from skinnet.analysis.plots.body_picture import draw_body
from skinnet.analysis.plots.grasp import plot_grasp
from skinnet.analysis.plots.latency import plot_latency
from skinnet.analysis.plots.nursing import plot_deviations, plot_feedback, plot_object, plot_patterns
from skinnet.analysis.plots.self_organisation import plot_activity, plot_map, plot_tree
from skinnet.analysis.plots.touch import plot_reactions, plot_touch
from skinnet.deployment import Deployment
from skinnet.runtime.outcome import Outcome
from skinnet.runtime.process_result import ProcessResult

__all__ = ["draw_plots"]

_DPI = 130
_Plot = Callable[[Deployment, dict[str, ProcessResult]], Figure | None]
_PLOTS: tuple[tuple[str, _Plot], ...] = (
    ("activity_matrix", plot_activity),
    ("kinematic_tree", plot_tree),
    ("sensory_motor_map", plot_map),
    ("touch", plot_touch),
    ("reactions", plot_reactions),
    ("latency", plot_latency),
    ("grasp", plot_grasp),
)
_NURSING: tuple[tuple[str, _Plot], ...] = (
    ("deviations", plot_deviations),
    ("feedback", plot_feedback),
    ("object", plot_object),
    ("patterns", plot_patterns),
)


def draw_plots(deployment: Deployment, base: Path, outcome: Outcome, out: Path) -> list[str]:
    """Draw the plots that the process results allow into `out`; return messages about those that failed."""
    parts = {part.name: part for part in outcome.results}
    told = []
    for name, plot in _PLOTS if deployment.nursing is None else _NURSING:
        figure = plot(deployment, parts)
        if figure is not None:
            figure.savefig(out / f"{name}.png", dpi=_DPI)
    problem = draw_body(deployment, base, parts, out)
    if problem is not None:
        told.append(f"the body was not rendered: {problem}")
    return told
