"""Touch over time [M14, Fig. 8]: what the cells felt, what the joints answered, how long that took."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from skinnet.deployment import Deployment
from skinnet.part import Part
from skinnet.run.figures.stages import stage_spans
from skinnet.run.figures.touch import reactions
from skinnet.run.plots.self_organisation import patch_ticks

__all__ = ["plot_reactions", "plot_touch"]

_COLUMNS = 1200
_PROXIMITY = 3


def plot_touch(deployment: Deployment, parts: dict[str, Part]) -> Figure | None:
    """Force and proximity of every cell over time, and the joint angles below, while the robot is guided."""
    controller, body = parts.get("controller"), parts.get("body")
    if controller is None or body is None:
        return None
    span_s = _guided_s(deployment, controller)
    if span_s is None:
        return None
    touch = _on_every_tick(controller, span_s)
    figure = Figure(figsize=(11.0, 13.0), layout="constrained")
    force_axes, proximity_axes, *joint_axes = figure.subplots(
        4, 1, sharex=True, gridspec_kw={"height_ratios": [2.2, 2.2, 1.3, 1.3]}
    )
    _raster(figure, force_axes, touch[:, :, :_PROXIMITY].max(axis=2), span_s, "force reading", 0.5)
    _raster(figure, proximity_axes, touch[:, :, _PROXIMITY], span_s, "proximity reading", 0.5)
    for axes in (force_axes, proximity_axes):
        patch_ticks(axes, deployment)
    joint_t_s, joint_rad = body.arrays["joint_t_ns"] * 1e-9, body.arrays["joint_rad"]
    within = (joint_t_s >= span_s[0]) & (joint_t_s <= span_s[1])
    half = (len(deployment.body.joints) + 1) // 2
    for axes, first in zip(joint_axes, (0, half), strict=True):
        for dof, name in list(enumerate(deployment.body.joints))[first : first + half]:
            moved = joint_rad[within, dof] - joint_rad[within, dof][:1]
            axes.plot(joint_t_s[within], moved, label=f"{dof}: {name}", linewidth=1.0)
        axes.set_ylabel("joint moved by [rad]")
        axes.legend(fontsize=6, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        axes.grid(alpha=0.3)
    for name, start_ns in controller.facts["stages"]:
        if span_s[0] <= start_ns * 1e-9 <= span_s[1]:
            joint_axes[0].axvline(start_ns * 1e-9, color="black", linewidth=0.6)
            joint_axes[0].annotate(
                name, (start_ns * 1e-9, 1.0), xycoords=("data", "axes fraction"), fontsize=7, va="bottom"
            )
    joint_axes[-1].set_xlabel("simulated time [s]")
    figure.suptitle("Touch and the joints' answer")
    return figure


def _on_every_tick(controller: Part, span_s: tuple[float, float]) -> NDArray[np.float32]:
    """(ticks, S, 4) what was felt in the span; nothing in between the stages that react."""
    t_s = controller.arrays["t_ns"] * 1e-9
    ticks = controller.arrays["t_ns"][(t_s >= span_s[0]) & (t_s <= span_s[1])]
    felt = controller.arrays["touch"]
    touch = np.zeros((len(ticks), *felt.shape[1:]), dtype=np.float32)
    touch[np.searchsorted(ticks, controller.arrays["touch_t_ns"])] = felt
    return touch


def _guided_s(deployment: Deployment, controller: Part) -> tuple[float, float] | None:
    """From the first to the last moment of guidance [s]."""
    spans = stage_spans(deployment, controller, "guide")
    return (spans[0].start_ns * 1e-9, spans[-1].end_ns * 1e-9) if spans else None


def _raster(
    figure: Figure,
    axes: Axes,
    readings: NDArray[np.float32],
    span_s: tuple[float, float],
    label: str,
    most: float,
) -> None:
    """Cells over time as an image; each column shows the largest reading of its slice, so no peak is lost."""
    columns = min(_COLUMNS, len(readings))
    edges = np.linspace(0, len(readings), columns + 1).astype(int)[:-1]
    image = np.maximum.reduceat(readings, edges, axis=0).T
    shown = axes.imshow(
        image,
        aspect="auto",
        interpolation="none",
        cmap="magma_r",
        vmin=0.0,
        vmax=most,
        extent=(span_s[0], span_s[1], image.shape[0] - 0.5, -0.5),
    )
    figure.colorbar(shown, ax=axes, label=label, pad=0.01, fraction=0.03)


def plot_reactions(deployment: Deployment, parts: dict[str, Part]) -> Figure | None:
    """Where the time of each reaction went, from the stimulus to the command in effect."""
    controller, body = parts.get("controller"), parts.get("body")
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
        (("sampling", "#8fb8de"), ("network", "#f2b134"), ("control", "#4f9d69"), ("actuation", "#b0b7bf"))
    ):
        axes.barh(np.arange(len(spent)), spent[:, column], left=left, label=name, color=colour)
        left = left + spent[:, column]
    axes.set_xlabel("after the stimulus crossed the threshold [ms]")
    axes.set_ylabel("reaction")
    axes.set_title("From the stimulus to the command in effect")
    axes.legend(loc="lower right")
    return figure
