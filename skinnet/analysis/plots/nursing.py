"""Plots of the nursing task, as Figs. 9, 10, 12, 13 and 14 of [R11]."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from skinnet.analysis.metrics.nursing import contact_label
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.runtime.process_result import ProcessResult
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["plot_deviations", "plot_feedback", "plot_object", "plot_patterns"]

_COLOURS = ("#1f4e79", "#b3261e", "#2e7d5b", "#b7791f", "#6b4fa0", "#5f6b76")
_STATE_COLOUR = "#9aa5b1"


def plot_deviations(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot displacement, evaluation function, and deviations of position and rotation (Figs. 9, 10)."""
    controller = _controller(deployment, results)
    if controller is None:
        return None
    arrays, names = controller.arrays, _contact_labels(controller)
    t_s = arrays["t_ns"] * 1e-9
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    top, middle, bottom = figure.subplots(3, sharex=True)
    for axis, label in enumerate("xyz"):
        top.plot(t_s, 1e3 * arrays["object_m"][:, axis], color=_COLOURS[axis], label=label)
    top.set_ylabel("displacement [mm]")
    top.legend(loc="upper left", ncols=3, frameon=False)
    right = top.twinx()
    right.plot(t_s, arrays["evaluation"], color=_STATE_COLOUR, linewidth=1.0)
    right.set_ylabel("evaluation function E", color="#5f6b76")
    _plot_curves(middle, t_s, 1e3 * arrays["position_dev_m"], names, "deviation of position [mm]")
    _plot_curves(bottom, t_s, np.degrees(arrays["rotation_dev_rad"]), names, "deviation of rotation [°]")
    _mark_states(controller, (top, middle, bottom))
    bottom.set_xlabel("time [s]")
    figure.suptitle("Object, evaluation function and deviations of the contacts")
    return figure


def plot_feedback(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot contact forces, centres of pressure, and the adjustments by feedback (Figs. 12, 13)."""
    controller = _controller(deployment, results)
    if controller is None or not controller.arrays["force_n"].any():
        return None
    arrays, names = controller.arrays, _contact_labels(controller)
    t_s = arrays["t_ns"] * 1e-9
    figure = Figure(figsize=(8.0, 9.5), layout="constrained")
    axes = figure.subplots(4, sharex=True)
    _plot_curves(axes[0], t_s, arrays["force_n"], names, "normal force f [N]")
    _plot_curves(axes[1], t_s, 1e3 * arrays["s_m"], names, "adjustment s [mm]")
    for axis, key, scale, label in (
        (axes[2], "cop_m", 1e3, "centre of pressure ξ − ξ(0) [mm]"),
        (axes[3], "alpha_rad", 180.0 / np.pi, "adjustment α [°]"),
    ):
        for c, name in enumerate(names):
            for i, style in enumerate(("-", "--")):
                axis.plot(
                    t_s,
                    scale * arrays[key][:, c, i],
                    style,
                    color=_COLOURS[c % len(_COLOURS)],
                    label=f"{name}, {i + 1}",
                )
        axis.set_ylabel(label)
        axis.legend(loc="upper right", ncols=2, frameon=False, fontsize=8)
    _mark_states(controller, axes)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(f"Tactile feedback: {deployment.nursing.feedback if deployment.nursing else ''}")
    return figure


def plot_object(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the object's true displacement and slip."""
    controller, body = _controller(deployment, results), results.get("body")
    if controller is None or body is None or "object_pose" not in body.arrays:
        return None
    t_s, pose = body.arrays["object_t_ns"] * 1e-9, body.arrays["object_pose"]
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    top, bottom = figure.subplots(2, sharex=True, height_ratios=(2, 1))
    for axis, label in enumerate("xyz"):
        top.plot(t_s, 1e3 * (pose[:, axis] - pose[0, axis]), color=_COLOURS[axis], label=label)
    top.set_ylabel("object displacement [mm]")
    top.legend(loc="upper left", ncols=3, frameon=False)
    bottom.plot(t_s, 1e3 * body.arrays["object_sliding_distance_m"], color=_COLOURS[3])
    bottom.set_ylabel("slip [mm]")
    bottom.set_xlabel("time [s]")
    _mark_states(controller, (top, bottom))
    dropped = body.facts["payload"]["dropped_ns"] is not None
    figure.suptitle("The object: dropped" if dropped else "The object")
    return figure


def plot_patterns(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot pressure patterns of the sheets in contact at the start, midway and end of motion (Fig. 14)."""
    controller, boards = _controller(deployment, results), results.get(BOARD_PROCESS)
    if controller is None or boards is None or not boards.arrays["pattern_kpa"].any():
        return None
    sheets = place_sheets(deployment.surfaces, deployment.sheets)
    first = np.cumsum([0, *(sheet.n_elements for sheet in sheets)])
    touched = {contact["name"].split(".")[0] for contact in controller.facts["contacts"]}
    shown = [i for i, sheet in enumerate(sheets) if sheet.surface.name in touched]
    begins = dict(controller.facts["states"])
    end_ns = controller.facts["end_ns"]
    move_ns = begins.get("move", 0)
    moments = (move_ns, (move_ns + begins.get("settle", end_ns)) // 2, end_ns)
    t_ns, kpa = boards.arrays["pattern_t_ns"], boards.arrays["pattern_kpa"]
    figure = Figure(figsize=(9.0, 3.2 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), len(moments), squeeze=False)
    largest = np.log1p(float(kpa.max()))
    for row, index in enumerate(shown):
        sheet = sheets[index]
        for column, moment in enumerate(moments):
            at = int(np.clip(np.searchsorted(t_ns, moment), 0, len(t_ns) - 1))
            pressure = kpa[at, first[index] : first[index + 1]]
            axes = grid[row, column]
            axes.scatter(*(1e3 * sheet.xi_m.T), s=3, color=_STATE_COLOUR)
            side = 150.0 * np.log1p(pressure) / largest
            axes.scatter(*(1e3 * sheet.xi_m.T), s=side, marker="s", color=_COLOURS[0])
            axes.set_aspect("equal")
            axes.set_title(f"{sheet.name}, {t_ns[at] * 1e-9:.1f} s", fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("ξ1 [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("ξ2 [mm]")
    figure.suptitle("Readings of the elements; area of a square: logarithm of the pressure")
    return figure


def _controller(deployment: Deployment, results: dict[str, ProcessResult]) -> ProcessResult | None:
    controller = results.get("controller")
    if deployment.nursing is None or controller is None or not len(controller.arrays.get("t_ns", ())):
        return None
    return controller


def _contact_labels(controller: ProcessResult) -> list[str]:
    names = [contact["name"] for contact in controller.facts["contacts"]]
    return [contact_label(name, names) for name in names]


def _plot_curves(axes: Axes, t_s: NDArray[Any], values: NDArray[Any], names: list[str], label: str) -> None:
    for c, name in enumerate(names):
        axes.plot(t_s, values[:, c], color=_COLOURS[c % len(_COLOURS)], label=name)
    axes.set_ylabel(label)
    axes.legend(loc="upper left", ncols=2, frameon=False, fontsize=8)


def _mark_states(controller: ProcessResult, plots: Any) -> None:
    """Mark the state transitions of the program."""
    for index, axes in enumerate(plots):
        for state, t_ns in controller.facts["states"]:
            axes.axvline(t_ns * 1e-9, color=_STATE_COLOUR, linewidth=0.8, linestyle=":")
            if index == 0 and state != "record":  # too short for a label
                at = (t_ns * 1e-9, 1.0)
                axes.annotate(f" {state}", at, xycoords=("data", "axes fraction"), fontsize=8, va="bottom")
        axes.spines[["top", "right"]].set_visible(False)
