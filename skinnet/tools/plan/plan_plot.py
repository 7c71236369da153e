"""Plot of a plan: the flattened skin with the load of every link and the voltage of every cell."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from skinnet.skin.flattening import FlattenedSkin, flatten_skin
from skinnet.skin.lattice import PORT_ANGLES_RAD
from skinnet.tools.plan.plan import Plan

__all__ = ["draw_plan"]

Floats = NDArray[np.float64]

_WIDTH_IN, _PITCH_IN = 14.0, 0.44
"""Width of the flattened skin and largest pitch of its cells in the figure [in]."""
_INK, _PALE, _GATEWAY, _BRIDGE, _BAD = "#1f2d3d", "#c3ccd5", "#0b6e4f", "#6a3d9a", "#3b0a45"
_LOAD = LinearSegmentedColormap.from_list("load", ["#eef3f7", "#fbe3a2", "#f2a33c", "#d9481c", "#8e0b1d"])
_VOLTAGE = LinearSegmentedColormap.from_list(
    "voltage", ["#7a1230", "#d9704a", "#f7e3b5", "#8fc3c9", "#1d5b79"]
)
_LOAD_SCALES = (0.05, 0.1, 0.25, 0.5, 1.0)


def draw_plan(plan: Plan) -> Figure:
    """Draw the skin coloured by load and, if the deployment has power wires, by voltage."""
    paper = flatten_skin(plan.skin.patches)
    panels = 1 if plan.budget.power is None else 2
    inch = min(_WIDTH_IN / paper.width, _PITCH_IN)  # per pitch
    size = (paper.width * inch + 1.1, panels * (paper.height * inch + 0.6))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(panels, 1, squeeze=False)[:, 0]
    _draw_load(figure, axes[0], plan, paper, inch)
    if panels == 2:
        _draw_voltage(figure, axes[1], plan, paper, inch)
    return figure


def _draw_load(figure: Figure, axes: Axes, plan: Plan, flattening: FlattenedSkin, inch: float) -> None:
    budget = plan.budget
    load = budget.utilisation
    top = next((top for top in _LOAD_SCALES if top >= load.max()), 1.0)
    colours, norm = _LOAD.with_extremes(over=_BAD), Normalize(0.0, top)
    _prepare_axes(axes, flattening)
    _draw_wires(axes, plan, flattening, inch)
    _draw_cells(axes, flattening, load, colours, norm, inch)
    sends = np.flatnonzero(budget.forest.parent >= 0)
    ends = np.stack([flattening.position[sends], flattening.position[budget.forest.parent[sends]]], axis=1)
    near = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) < 1.5  # else it crosses a cut, or is a bridge
    ends, sends = ends[near], sends[near]
    points = 72 * inch
    widths = _line_widths(load[sends], top, points)
    axes.add_collection(LineCollection(list(ends), linewidths=widths, colors=_INK, capstyle="round"))
    axes.plot(*flattening.position.T, "o", color=_INK, markersize=0.16 * points, zorder=3, markeredgewidth=0)
    _draw_gateways(axes, plan, flattening, points, top)
    texts = []
    for patch in range(len(flattening.boxes)):
        cells = _cells_of(plan, patch)
        worst = float(budget.worst_latency_ns[cells].max()) * 1e-6
        late = f"≤ {worst:.1f} ms" if math.isfinite(worst) else "no bound"
        texts.append(f"{len(cells)} cells · {load[cells].max():.0%} · {late}")
    _draw_labels(axes, plan, flattening, texts, points)
    _add_colorbar(
        figure,
        axes,
        colours,
        norm,
        "link utilisation",
        PercentFormatter(1.0, decimals=0),
        over=load.max() > 1.0,
    )
    worst_cell = int(load.argmax())
    axes.set_title(
        f"{plan.deployment.name}: load of the links, {plan.traffic.encoding} · most {load.max():.0%} "
        f"at {plan.link_name(worst_cell)}",
        fontsize=12,
    )


def _draw_voltage(figure: Figure, axes: Axes, plan: Plan, flattening: FlattenedSkin, inch: float) -> None:
    power, spec = plan.budget.power, plan.deployment.power
    assert power is not None
    assert spec is not None
    colours = _VOLTAGE.with_extremes(under="#111111")
    norm = Normalize(spec.brown_out_v, spec.supply_v)
    _prepare_axes(axes, flattening)
    _draw_wires(axes, plan, flattening, inch)
    _draw_cells(axes, flattening, power.voltage_v, colours, norm, inch)
    gone = flattening.position[power.browned_out]
    axes.plot(*gone.T, "x", color="black", markersize=30 * inch, markeredgewidth=7 * inch, linestyle="none")
    feeds = flattening.position[np.unique(plan.feeds)]
    axes.plot(
        *feeds.T, "o", color="white", markeredgecolor=_INK, markersize=26 * inch, markeredgewidth=5 * inch
    )
    texts = []
    for patch in range(len(flattening.boxes)):
        cells = _cells_of(plan, patch)
        out = int(power.browned_out[cells].sum())
        texts.append(f"≥ {power.voltage_v[cells].min():.2f} V" + (f" · {out} out" if out else ""))
    _draw_labels(axes, plan, flattening, texts, 72 * inch)
    _add_colorbar(
        figure,
        axes,
        colours,
        norm,
        "voltage at the cell [V]",
        "%.1f",
        under=bool((power.voltage_v < spec.brown_out_v).any()),
    )
    worst = int(power.voltage_v.argmin())
    axes.set_title(
        f"voltage of the cells · lowest {power.voltage_v[worst]:.2f} V at {plan.skin.cell_name(worst)} · "
        f"circles are fed{', crosses browned out' if len(gone) else ''}",
        fontsize=12,
    )


def _prepare_axes(axes: Axes, flattening: FlattenedSkin) -> None:
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(0.0, flattening.width)
    axes.set_ylim(-flattening.height, 0.0)


def _cells_of(plan: Plan, patch: int) -> NDArray[np.int64]:
    return np.arange(plan.skin.first_cell[patch], plan.skin.first_cell[patch + 1])


def _draw_cells(
    axes: Axes, flattening: FlattenedSkin, values: Floats, colours: Colormap, norm: Normalize, inch: float
) -> None:
    corners = flattening.angle_rad[:, None] + np.pi / 6 + np.pi / 3 * np.arange(6)
    ring = 0.965 / math.sqrt(3.0) * np.stack([np.cos(corners), np.sin(corners)], axis=2)
    hexagons = PolyCollection(
        list(flattening.position[:, None] + ring),
        facecolors=colours(norm(values)),
        edgecolors=_PALE,
        linewidths=4 * inch,
    )
    axes.add_collection(hexagons)


def _draw_wires(axes: Axes, plan: Plan, flattening: FlattenedSkin, inch: float) -> None:
    """Draw bridges between patches, and stubs of wires that cross a cut of the flattening."""
    bridges = flattening.position[plan.skin.bridges[:, [0, 2]]]
    axes.add_collection(
        LineCollection(list(bridges), colors=_BRIDGE, linewidths=9 * inch, linestyles="dashed")
    )
    inner = plan.skin.wires[: len(plan.skin.wires) - len(plan.skin.bridges)]
    far = np.linalg.norm(flattening.position[inner[:, 0]] - flattening.position[inner[:, 2]], axis=1) > 1.5
    stubs = [
        _port_segment(flattening, int(cell), int(port), 0.72)
        for a, port_a, b, port_b in inner[far].tolist()
        for cell, port in ((a, port_a), (b, port_b))
    ]
    axes.add_collection(LineCollection(stubs, colors=_PALE, linewidths=10 * inch))


def _port_segment(
    flattening: FlattenedSkin, cell: int, port: int, length: float
) -> list[tuple[float, float]]:
    """Line segment from the centre of a cell through one of its ports."""
    angle = flattening.angle_rad[cell] + PORT_ANGLES_RAD[port]
    x, y = flattening.position[cell]
    return [(x, y), (x + length * math.cos(angle), y + length * math.sin(angle))]


def _line_widths(load: Floats, top: float, points: float) -> Floats:
    """Line widths [pt], increasing with link load."""
    widths: Floats = points * (0.05 + 0.2 * np.minimum(load / top, 1.0))
    return widths


def _draw_gateways(axes: Axes, plan: Plan, flattening: FlattenedSkin, points: float, top: float) -> None:
    ways = [_port_segment(flattening, cell, port, 0.98) for cell, port in plan.skin.gateways.tolist()]
    load = plan.budget.utilisation[plan.skin.gateways[:, 0]]
    widths = _line_widths(load, top, points)
    axes.add_collection(LineCollection(ways, colors=_GATEWAY, linewidths=widths, zorder=3))
    axes.plot(*np.array([way[1] for way in ways]).T, "s", color=_GATEWAY, markersize=0.34 * points, zorder=4)


def _draw_labels(axes: Axes, plan: Plan, flattening: FlattenedSkin, texts: list[str], points: float) -> None:
    """Draw the patch names and texts below the patches, all in one font size that fits."""
    names = [patch.name for patch in plan.skin.patches]
    for lines, most, height, colour in ((names, 0.6, 1.75, _INK), (texts, 0.5, 1.05, "#5b6b7a")):
        fit = min(box.width / (0.58 * len(line)) for box, line in zip(flattening.boxes, lines, strict=True))
        size = min(points * min(most, fit), 13.0)
        for box, line in zip(flattening.boxes, lines, strict=True):
            axes.text(
                box.x + box.width / 2,
                box.y + height,
                line,
                fontsize=size,
                ha="center",
                va="center",
                color=colour,
            )


def _add_colorbar(
    figure: Figure,
    axes: Axes,
    colours: Colormap,
    norm: Normalize,
    text: str,
    form: str | PercentFormatter,
    *,
    over: bool = False,
    under: bool = False,
) -> None:
    extend = "max" if over else "min" if under else "neither"
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, extend=extend, shrink=0.75, aspect=28, pad=0.015, format=form
    )
    bar.set_label(text)
    bar.outline.set_visible(False)
