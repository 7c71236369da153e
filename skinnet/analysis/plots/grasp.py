"""Plot of a grasp over time, as Fig. 10 [M14]: joints, pre-contact and force by patch, and the object."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skinnet.analysis.metrics.teach_and_grasp import StateInterval, state_intervals
from skinnet.deployment import Deployment
from skinnet.protocol.states import GRASP_STATES
from skinnet.runtime.process_result import ProcessResult

__all__ = ["plot_grasp"]

_SHADES = ("#f3f5f9", "#e3e8f1")
_PAIN = 0.45
_MARGIN_S = 1.0


def plot_grasp(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the last grasp of the run, with its states shaded; None without one."""
    controller, body = results.get("controller"), results.get("body")
    if controller is None or body is None:
        return None
    spans = state_intervals(controller)
    begins = [i for i, span in enumerate(spans) if span.state == "open"]
    if not begins:
        return None
    grasp = [span for span in spans[begins[-1] :] if span.state in GRASP_STATES]
    span_s = (grasp[0].start_ns * 1e-9 - _MARGIN_S, grasp[-1].end_ns * 1e-9 + _MARGIN_S)
    with_object = body.facts.get("object") is not None
    figure = Figure(figsize=(12.0, 12.5 if with_object else 10.0), layout="constrained")
    rows = list(figure.subplots(5 if with_object else 4, sharex=True))
    _plot_joints(deployment, body, rows[:2], span_s)
    _plot_patch_readings(deployment, controller, rows[2:4], span_s)
    if with_object:
        _plot_object(body, rows[4], span_s, grasp[0].end_ns * 1e-9)
    for axes in rows:
        _shade(axes, grasp)
        axes.grid(alpha=0.3)
    _label_states(rows[0], grasp)
    rows[-1].set_xlim(span_s)
    rows[-1].set_xlabel("simulated time [s]")
    figure.suptitle(f"Grasp of {deployment.object}", fontsize=13)
    return figure


def _plot_joints(
    deployment: Deployment, body: ProcessResult, rows: list[Axes], span_s: tuple[float, float]
) -> None:
    t_s = body.arrays["joint_t_ns"] * 1e-9
    within = (t_s >= span_s[0]) & (t_s <= span_s[1])
    names = list(enumerate(deployment.body.joints))
    half = (len(names) + 1) // 2
    for axes, group in zip(rows, (names[:half], names[half:]), strict=True):
        for dof, name in group:
            axes.plot(t_s[within], body.arrays["joint_rad"][within, dof], label=name, linewidth=1.1)
        axes.set_ylabel("joint [rad, slides m]")
        axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _plot_patch_readings(
    deployment: Deployment, controller: ProcessResult, rows: list[Axes], span_s: tuple[float, float]
) -> None:
    """Plot the largest reading of each patch that exceeds the display threshold."""
    t_s = controller.arrays["patch_t_ns"] * 1e-9
    within = (t_s >= span_s[0]) & (t_s <= span_s[1])
    felt = controller.arrays["patch_readings"][within]
    names = [patch.name for patch in deployment.patches]
    for axes, column, label, least in ((rows[0], 1, "pre-contact", 0.02), (rows[1], 0, "force", 0.04)):
        for patch, name in enumerate(names):
            if felt[:, patch, column].max(initial=0.0) >= least:
                axes.plot(t_s[within], felt[:, patch, column], label=name, linewidth=1.1)
        axes.set_ylabel(f"{label} reading")
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    rows[1].axhline(_PAIN, color="firebrick", linewidth=0.8, linestyle="--")
    rows[1].annotate("pain", (span_s[0], _PAIN), color="firebrick", fontsize=8, va="bottom")


def _plot_object(body: ProcessResult, axes: Axes, span_s: tuple[float, float], zero_s: float) -> None:
    """Plot the object's displacement forward and up, and the stand's, from their positions at `zero_s`."""
    t_s = body.arrays["object_t_ns"] * 1e-9
    within = (t_s >= span_s[0]) & (t_s <= span_s[1])
    zero = int(np.searchsorted(t_s, zero_s))
    pose, top_m = body.arrays["object_pose"], body.arrays["stand_top_m"]
    moved_mm = 1e3 * (pose[within] - pose[zero])
    axes.plot(t_s[within], moved_mm[:, 0], label="object, forward", color="tab:blue")
    axes.plot(t_s[within], moved_mm[:, 2], label="object, up", color="tab:orange")
    lowered_mm = 1e3 * (top_m[within] - top_m[zero])
    axes.plot(t_s[within], lowered_mm, label="stand, up", color="0.5", linestyle="--")
    axes.set_ylabel("moved by [mm]")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _shade(axes: Axes, grasp: list[StateInterval]) -> None:
    for index, span in enumerate(grasp):
        axes.axvspan(span.start_ns * 1e-9, span.end_ns * 1e-9, color=_SHADES[index % 2], zorder=0)


def _label_states(axes: Axes, grasp: list[StateInterval]) -> None:
    for index, span in enumerate(grasp):
        height = 1.02 + 0.09 * (index % 4)  # labels of short states would overlap
        axes.annotate(
            span.state, (span.start_ns * 1e-9, height), xycoords=("data", "axes fraction"), fontsize=9
        )
