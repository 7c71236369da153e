"""Plots of a stress sweep, one file each."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from skinnet.deployment import Deployment
from skinnet.deployment.experiment.stress import StressSpec
from skinnet.tools.stress.points import Point
from skinnet.tools.stress.sweep import PointResult
from skinnet.tools.stress.sweep_metrics import (
    full_size_points,
    is_stimulated,
    nearest_delta,
    points_at_delta,
    thresholds,
)

__all__ = ["draw_plots"]

_DPI = 130
_COLOURS = {"periodic": "#6b7280", "send_on_delta": "#2f6fab", "level_crossing": "#3f8f5f"}
_PALE = 0.45
_PUBLISHED = "#b3261e"
_MIN_FRACTION = 1e-4
"""Smallest fraction shown: below it, a run of some seconds has too few packets to measure a rate."""
_PROCESS_COLOURS = {"controller": "#2f6fab", "body": "#c9a227"}
_CELL_PROCESS_COLOURS = ("#8aa39b", "#a9bdb6", "#c3d1cc", "#dbe4e1")
_Plot = Callable[[Deployment, StressSpec, list[PointResult]], Figure | None]


def draw_plots(deployment: Deployment, spec: StressSpec, results: list[PointResult], out: Path) -> None:
    """Draw every plot that the successful points allow into `out`."""
    out.mkdir(parents=True, exist_ok=True)
    done = [result for result in results if result.failure is None]
    for name, plot in _PLOTS:
        figure = plot(deployment, spec, done) if done else None
        if figure is not None:
            figure.savefig(out / f"{name}.png", dpi=_DPI)


def _point_label(point: Point) -> str:
    """Axis label of a point."""
    words = [f"{point.cells} cells", point.encoding]
    if point.delta_sigma is not None:
        words[-1] += f" {point.delta_sigma:g} σ"
    if point.stimulated is not None:
        words.append(f"{100 * point.stimulated:g} % touched")
    if point.gateways is not None:
        words.append(f"{point.gateways} gateway{'s' if point.gateways > 1 else ''}")
    return ", ".join(words)


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2g} %" if fraction == 0.0 or fraction > _MIN_FRACTION else "< 0.01 %"


def _alpha(point: Point) -> float:
    return 1.0 if is_stimulated(point) or point.stimulated is None else _PALE


def _at_own_thresholds(results: list[PointResult]) -> list[PointResult]:
    """Points with the deployment's own thresholds."""
    return [result for result in results if result.point.delta_sigma is None]


def _point_axes(figure: Figure, results: list[PointResult]) -> Axes:
    """Axes with one row for each point, the first on top."""
    axes = figure.add_subplot()
    axes.set_yticks(range(len(results)), [_point_label(result.point) for result in results], fontsize=8)
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", alpha=0.3)
    axes.set_axisbelow(True)
    return axes


def _point_figure(results: list[PointResult]) -> Figure:
    return Figure(figsize=(9.0, 1.6 + 0.3 * len(results)), layout="constrained")


def _plot_rates(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Figure | None:
    """Packet rates into the controller."""
    own = _at_own_thresholds(results)
    figure = _point_figure(own)
    axes = _point_axes(figure, own)
    for row, result in enumerate(own):
        rate, share = result.metrics["packets_per_s"], result.metrics["fraction.packets"]
        axes.barh(row, rate, color=_COLOURS[result.point.encoding], alpha=_alpha(result.point))
        text = f" {rate:,.0f}/s" + ("" if result.point.encoding == "periodic" else f" = {_percent(share)}")
        axes.annotate(text, (max(rate, 1.0), row), va="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(1.0, 8.0 * max(result.metrics["clock_packets_per_s"] for result in own))
    axes.set_xlabel("packets per second into the controller")
    axes.set_title(f"{deployment.name}: rates, and their fraction of clock-driven", fontsize=11)
    return figure


def _plot_latency(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Figure | None:
    """Latency percentiles of the modelled network and between processes."""
    own = _at_own_thresholds(results)
    figure = _point_figure(own)
    axes = _point_axes(figure, own)
    kinds = (("latency_us", "#2f6fab", -0.16), ("machine_us", "#c9a227", 0.16))
    for row, result in enumerate(own):
        for name, colour, shift in kinds:
            if f"{name}.p50" not in result.metrics:
                continue
            low, mid, high = (max(1.0, result.metrics[f"{name}.{p}"]) for p in ("p50", "p99", "p999"))
            axes.plot([low, high], [row + shift] * 2, color=colour, linewidth=2.0, alpha=0.5)
            for value, marker in ((low, "o"), (mid, "D"), (high, "|")):
                axes.plot(value, row + shift, marker, color=colour, markersize=5)
    axes.set_xscale("log")
    axes.set_xlabel("latency [µs]")
    handles = [
        Line2D([], [], color=kinds[0][1], label="modelled: sample to gateway"),
        Line2D([], [], color=kinds[1][1], label="measured: batches between processes"),
        *(
            Line2D([], [], marker=marker, color="#555", linestyle="", label=label)
            for marker, label in (("o", "median"), ("D", "99 %"), ("|", "99.9 %"))
        ),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    axes.set_title(f"{deployment.name}: latency", fontsize=11)
    return figure


def _plot_cpu(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Figure | None:
    """CPU time of each process per simulated second."""
    own = _at_own_thresholds(results)
    figure = _point_figure(own)
    axes = _point_axes(figure, own)
    names = sorted(
        {
            name[4:]
            for result in own
            for name in result.metrics
            if name.startswith("cpu.") and name != "cpu.all"
        },
        key=lambda name: (name != "controller", name != "body", name),
    )
    colours = dict(_PROCESS_COLOURS)
    for index, name in enumerate(name for name in names if name not in colours):
        colours[name] = _CELL_PROCESS_COLOURS[index % len(_CELL_PROCESS_COLOURS)]
    for row, result in enumerate(own):
        left = 0.0
        for name in names:
            width = result.metrics.get(f"cpu.{name}", 0.0)
            axes.barh(row, width, left=left, color=colours[name])
            left += width
        text = f" controller {result.metrics['cpu.controller']:.2f}, {result.metrics['rtf']:.2f} × real time"
        axes.annotate(text, (left, row), va="center", fontsize=8)
    axes.margins(x=0.35)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("CPU time per simulated second, start-up not counted [s/s]")
    handles = [Patch(color=colours[name], label=name) for name in names]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(8, len(names)), fontsize=8, frameon=False
    )
    axes.set_title(f"{deployment.name}: CPU time", fontsize=11)
    return figure


def _plot_event_driven(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Figure | None:
    """Event-driven rates as fractions of the clock-driven rate, with the published values."""
    events = [result for result in full_size_points(results) if result.point.encoding != "periodic"]
    sigma = nearest_delta(results, spec)
    events += [] if sigma is None else points_at_delta(results, sigma)
    events.sort(key=lambda r: (r.point.delta_sigma or 0.0, r.point.encoding, r.point.stimulated or 0.0))
    if not events:
        return None
    figure = Figure(figsize=(11.0, 4.8), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    labels = [
        _point_label(result.point).partition(", ")[2].replace(", ", "\n").replace(" t", "\nt")
        for result in events
    ]
    for axes, of in zip(both, ("bytes", "packets"), strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="y", alpha=0.3)
        axes.set_axisbelow(True)
        for column, result in enumerate(events):
            share = result.metrics[f"fraction.{of}"]
            axes.bar(column, share, color=_COLOURS[result.point.encoding], alpha=_alpha(result.point))
            axes.annotate(_percent(share), (column, share), ha="center", va="bottom", fontsize=9)
        _mark_published(axes, spec, of, "left")
        axes.set_xticks(range(len(events)), labels, fontsize=8)
        axes.set_title(f"{of} per second", fontsize=10)
    most = max(max(r.metrics["fraction.bytes"], r.metrics["fraction.packets"]) for r in events)
    both[0].set_ylim(0.0, 1.2 * max([most, *(published.fraction for published in spec.published)]))
    both[0].yaxis.set_major_formatter(PercentFormatter(1.0))
    both[0].set_ylabel("fraction of clock-driven")
    cells = events[0].point.cells
    figure.suptitle(
        f"{deployment.name}, {cells} cells: event-driven rates as fractions of the clock-driven rate",
        fontsize=11,
    )
    return figure


def _mark_published(axes: Axes, spec: StressSpec, rate_kind: str, side: Literal["left", "right"]) -> None:
    for published in spec.published:
        if not published.applies_to(rate_kind):
            continue
        axes.axhline(published.fraction, color=_PUBLISHED, linewidth=1.0, linestyle="--")
        touched = "touched" if published.stimulated else "untouched"
        most = "≤ " if published.is_upper_bound else ""
        text = f"[{published.source}] {touched}: {most}{100 * published.fraction:g} %"
        axes.annotate(
            text,
            (0.01 if side == "left" else 0.99, published.fraction),
            xycoords=("axes fraction", "data"),
            ha=side,
            va="bottom",
            fontsize=8,
            color=_PUBLISHED,
        )


def _plot_thresholds(deployment: Deployment, spec: StressSpec, results: list[PointResult]) -> Figure | None:
    """Fraction of the clock-driven rate over the send-on-delta threshold, in multiples of the noise."""
    swept = [result for result in results if result.point.delta_sigma is not None]
    if not swept:
        return None
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    both = figure.subplots(1, 2, sharey=True)
    shares = sorted({result.point.stimulated or 0.0 for result in swept})
    own = thresholds(deployment)
    for axes, of in zip(both, ("bytes", "packets"), strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.3, which="both")
        for stimulated in shares:
            line = sorted(
                (r for r in swept if (r.point.stimulated or 0.0) == stimulated),
                key=lambda r: r.point.delta_sigma or 0.0,
            )
            line = [r for r in line if r.metrics[f"fraction.{of}"] >= _MIN_FRACTION]
            axes.plot(
                [r.point.delta_sigma for r in line],
                [r.metrics[f"fraction.{of}"] for r in line],
                marker="o",
                markersize=4,
                color=_COLOURS["send_on_delta"],
                alpha=1.0 if stimulated else _PALE,
                label=f"{100 * stimulated:g} % of the cells touched",
            )
        _mark_published(axes, spec, of, "right")
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda share, _: f"{100.0 * share:g} %")
        axes.set_xlabel("delta of every sensor [multiples of its noise σ]")
        axes.set_title(f"{of} per second", fontsize=10)
    both[0].set_ylabel("fraction of clock-driven")
    most = max(result.metrics["fraction.packets"] for result in swept)
    both[0].set_ylim(_MIN_FRACTION, 1.5 * max(1.0, most))
    handles, labels = both[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    used = ", ".join(
        f"{name} {own[f'delta_sigmas.{name}']:.0f} σ"
        for name in ("force", "proximity", "acceleration", "temperature")
        if f"delta_sigmas.{name}" in own
    )
    figure.suptitle(
        f"{deployment.name}: send-on-delta by threshold\nthe deployment's own deltas: {used}", fontsize=10
    )
    return figure


_PLOTS: tuple[tuple[str, _Plot], ...] = (
    ("rates", _plot_rates),
    ("latency", _plot_latency),
    ("cpu", _plot_cpu),
    ("event_driven", _plot_event_driven),
    ("thresholds", _plot_thresholds),
)
