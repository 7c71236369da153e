"""Plots of touch over time [M14, Fig. 8]: readings of the cells, joint motion, reaction latencies."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from skinnet.analysis.metrics.stages import stage_intervals
from skinnet.analysis.metrics.touch import reactions
from skinnet.analysis.plots.self_organisation import patch_ticks
from skinnet.deployment import Deployment
from skinnet.runtime.process_result import ProcessResult

__all__ = ["plot_reactions", "plot_touch"]

_COLUMNS = 500
_PROXIMITY = 3


def plot_touch(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot force and proximity of every cell over time, and joint motion below, during guidance."""
    controller, body = results.get("controller"), results.get("body")
    if controller is None or body is None:
        return None
    span_s = _guidance_interval_s(deployment, controller)
    if span_s is None:
        return None
    touch = _readings_per_tick(controller, span_s)
    figure = Figure(figsize=(12.0, 13.0), layout="constrained")
    grid = figure.add_gridspec(4, 2, width_ratios=[1.0, 0.15], height_ratios=[2.2, 2.2, 1.3, 1.3])
    main = [figure.add_subplot(grid[0, 0])]
    main += [figure.add_subplot(grid[row, 0], sharex=main[0]) for row in range(1, 4)]
    side = [figure.add_subplot(grid[row, 1]) for row in range(4)]
    for axes in side:
        axes.set_axis_off()
    for axes in main[:-1]:
        axes.tick_params(labelbottom=False)
    force = touch[:, :, :_PROXIMITY].max(axis=2)
    for row, (image, name, colours, most) in enumerate(
        ((force, "force", "Reds", 0.3), (touch[:, :, _PROXIMITY], "proximity", "Blues", 0.5))
    ):
        shown = _plot_raster(main[row], image, span_s, colours, most)
        figure.colorbar(
            shown, ax=side[row], label=f"{name} reading", fraction=0.9, aspect=25, location="left"
        )
        patch_ticks(main[row], deployment)
    _plot_joints(deployment, body, span_s, main[2:], side[2:])
    _mark_stages(main[0], controller, span_s)
    main[-1].set_xlabel("simulated time [s]")
    figure.suptitle("Touch and joint motion")
    return figure


def _plot_joints(
    deployment: Deployment,
    body: ProcessResult,
    span_s: tuple[float, float],
    main: list[Axes],
    side: list[Axes],
) -> None:
    """Plot joint motion since the start of the span, the first half of the joints above the other."""
    t_s, position_rad = body.arrays["joint_t_ns"] * 1e-9, body.arrays["joint_rad"]
    within = (t_s >= span_s[0]) & (t_s <= span_s[1])
    names = list(enumerate(deployment.body.joints))
    half = (len(names) + 1) // 2
    for axes, legend_axes, group in zip(main, side, (names[:half], names[half:]), strict=True):
        for dof, name in group:
            moved = position_rad[within, dof] - position_rad[within, dof][:1]
            axes.plot(t_s[within], moved, label=f"{dof}: {name}", linewidth=1.2)
        axes.set_ylabel("joint moved by [rad, slides m]")
        axes.grid(alpha=0.3)
        handles, labels = axes.get_legend_handles_labels()
        if handles:
            legend_axes.legend(handles, labels, fontsize=7, loc="upper left", frameon=False)


def _mark_stages(axes: Axes, controller: ProcessResult, span_s: tuple[float, float]) -> None:
    """Label the stages above the first plot, in two alternating rows so that short ones do not overlap."""
    stages = [(name, t_ns * 1e-9) for name, t_ns in controller.facts["stages"]]
    inside = [(name, t_s) for name, t_s in stages if span_s[0] <= t_s <= span_s[1]]
    for index, (name, t_s) in enumerate(inside):
        axes.axvline(t_s, color="black", linewidth=0.6)
        height = 1.01 + 0.045 * (index % 2)
        axes.annotate(name, (t_s, height), xycoords=("data", "axes fraction"), fontsize=8, va="bottom")


def _readings_per_tick(controller: ProcessResult, span_s: tuple[float, float]) -> NDArray[np.float32]:
    """Readings in the span (ticks, S, 4); 0 between the stages that react."""
    t_s = controller.arrays["t_ns"] * 1e-9
    ticks = controller.arrays["t_ns"][(t_s >= span_s[0]) & (t_s <= span_s[1])]
    felt = controller.arrays["tactile_input"]
    touch = np.zeros((len(ticks), *felt.shape[1:]), dtype=np.float32)
    touch[np.searchsorted(ticks, controller.arrays["tactile_input_t_ns"])] = felt
    return touch


def _guidance_interval_s(deployment: Deployment, controller: ProcessResult) -> tuple[float, float] | None:
    """Interval of guidance [s], from its first to its last moment."""
    spans = stage_intervals(deployment, controller, "guide")
    return (spans[0].start_ns * 1e-9, spans[-1].end_ns * 1e-9) if spans else None


def _plot_raster(
    axes: Axes, readings: NDArray[np.float32], span_s: tuple[float, float], colours: str, most: float
) -> AxesImage:
    """Raster image of cells over time; each column shows the largest reading of its slice."""
    columns = min(_COLUMNS, len(readings))
    edges = np.linspace(0, len(readings), columns + 1).astype(int)[:-1]
    image = np.maximum.reduceat(readings, edges, axis=0).T
    return axes.imshow(
        image,
        aspect="auto",
        interpolation="none",
        cmap=colours,
        vmin=0.0,
        vmax=most,
        extent=(span_s[0], span_s[1], image.shape[0] - 0.5, -0.5),
    )


def plot_reactions(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the latency components of each reaction, from the stimulus to the command in effect."""
    controller, body = results.get("controller"), results.get("body")
    if controller is None or body is None:
        return None
    found, _ = reactions(deployment, controller, body)
    if not found:
        return None
    t_ms = np.array([reaction[2:] for reaction in found], dtype=np.float64) * 1e-6
    spent = np.diff(t_ms, axis=1)
    spent = spent[np.argsort(spent.sum(axis=1))]
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    left = np.minimum(spent[:, 0], 0.0)
    for column, (name, colour) in enumerate(
        (
            ("sampling", "#8fb8de"),
            ("network", "#f2b134"),
            ("control", "#4f9d69"),
            ("command delay", "#b0b7bf"),
        )
    ):
        axes.barh(np.arange(len(spent)), spent[:, column], left=left, label=name, color=colour)
        left = left + spent[:, column]
    axes.set_xlabel("after the stimulus crossed the threshold [ms]")
    axes.set_ylabel("reaction")
    axes.set_title("From the stimulus to the command in effect")
    axes.legend(loc="lower right")
    return figure
