"""Network panel: link loads, routing tree, broken links and unreachable cells on the flattened skin."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from skinnet.skin.lattice import PORT_ANGLES_RAD
from skinnet.view.panels.skin_map import (
    COMMON_STYLE,
    captions,
    map_element,
    map_line,
    skin_map,
    style_rules,
    tooltip_rules,
)
from skinnet.view.state.run_state import RunState
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["render", "render_legend", "render_style", "render_tooltips"]

_CSS_CLASS = "sk-net"
_SEAM_LENGTH = 1.5
"""Length [pitches] above which a wire crosses a seam of the flattening, or is a bridge."""
_LOAD_COLOURS = (
    "#9fb6c9",
    "#7fb3a8",
    "#b9c96a",
    "#f0c54a",
    "#f2a33c",
    "#e8742c",
    "#d9481c",
    "#b3261a",
    "#8e0b1d",
)
_SCALE_MAXIMA = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)
_FAULT_COLOUR, _UNREACHABLE_COLOUR, _GATEWAY_COLOUR, _BRIDGE_COLOUR = (
    "#e03131",
    "#16161a",
    "#0b6e4f",
    "#6a3d9a",
)
_BROKEN_STYLE = (
    "z-index:3;height:3px;"
    f"background:repeating-linear-gradient(90deg,{_FAULT_COLOUR} 0 4px,transparent 4px 7px)"
)
_UNREACHABLE_STYLE = f"background:{_UNREACHABLE_COLOUR};box-shadow:0 0 0 2.5px {_FAULT_COLOUR};z-index:4"


def render(layout: SkinLayout) -> str:
    """Network map as HTML, with all wires and no connected cells."""
    paper = layout.flattening
    dot = 46.0 / paper.width
    style = (
        f"{COMMON_STYLE}.{_CSS_CLASS} i{{width:{dot:.3f}%;aspect-ratio:1;border-radius:50%;"
        "background:#c9d2da;z-index:2}"
        f".{_CSS_CLASS} b{{height:1.5px;background:#dde3e9}}"
        f".{_CSS_CLASS} b::before{{content:'';position:absolute;left:0;right:0;top:-4px;bottom:-4px}}"
        f".{_CSS_CLASS} b.br{{background:"
        f"repeating-linear-gradient(90deg,{_BRIDGE_COLOUR} 0 5px,transparent 5px 9px)}}"
        f".{_CSS_CLASS} u{{height:3px;background:{_GATEWAY_COLOUR}}}"
        f".{_CSS_CLASS} u.pc{{width:{dot:.3f}%;height:auto;aspect-ratio:1;z-index:2}}"
        f".{_CSS_CLASS} i:hover,.{_CSS_CLASS} b:hover{{filter:brightness(.75)}}"
    )
    names = list(layout.first_taxel)
    font_px = min(max(330.0 / paper.width, 6.5), 12.0)
    cells = (
        map_element(paper, "i", f"n{n}", (x, y))
        for n, (x, y) in enumerate(paper.position[: layout.n_cells].tolist())
    )
    parts = [*_wires(layout), *_gateways(layout), *cells, *captions(paper, names, font_px)]
    hint = "hover over a cell, link or gateway"
    return f"<style>{style}</style>{skin_map(_CSS_CLASS, paper, parts, hint)}"


def render_style(layout: SkinLayout, run_state: RunState) -> str:
    """Style sheet for link loads, broken links and unreachable cells."""
    network = run_state.network
    load, tree, cut = network.wire_utilisation, network.in_tree, network.broken
    top = _scale_maximum(run_state)
    shade = np.minimum(load / top * len(_LOAD_COLOURS), len(_LOAD_COLOURS) - 1).astype(int)
    looks = []
    for wire in np.flatnonzero(tree | cut | (load > 0.0)).tolist():
        if cut[wire]:
            looks.append((wire, _BROKEN_STYLE))
        else:
            thickness = (2.5 if tree[wire] else 1.5) + 3.0 * min(float(load[wire]) / top, 1.0)
            looks.append(
                (wire, f"z-index:1;height:{thickness:.0f}px;background:{_LOAD_COLOURS[shade[wire]]}")
            )
    dead = network.unreachable
    nodes = [
        (cell, _UNREACHABLE_STYLE if dead[cell] else "background:#1f2d3d")
        for cell in np.flatnonzero(network.connected | dead).tolist()
    ]
    ways = [
        (g, "background:" + (_FAULT_COLOUR if network.link_down[cell, port] else _GATEWAY_COLOUR))
        for g, (cell, port) in enumerate(layout.gateways.tolist())
    ]
    return f"<style>{style_rules('w', looks)}{style_rules('n', nodes)}{style_rules('g', ways)}</style>"


def render_tooltips(layout: SkinLayout, run_state: RunState) -> str:
    """Style sheet with the tooltips of cells, links and gateways."""
    network, names = run_state.network, layout.taxel_names
    dead, cut = network.unreachable, network.broken
    cells = []
    for n in range(layout.n_cells):
        if dead[n]:
            cells.append((n, f"{names[n]} · {'no power' if network.unpowered[n] else 'out of the network'}"))
        elif network.connected[n]:
            parent = int(network.parent[n])
            to = names[parent] if parent >= 0 else "the computer"
            hops = int(network.depth[n])
            cells.append((n, f"{names[n]} · sends to {to} by port {network.master_port[n]} · hops {hops}"))
        else:
            cells.append((n, f"{names[n]} · not yet connected"))
    wires = [
        (
            w,
            f"{names[a]}:{pa} ↔ {names[b]}:{pb} · "
            f"{'broken' if cut[w] else _link_text(run_state, (a, pa), (b, pb))}",
        )
        for w, (a, pa, b, pb) in enumerate(layout.wires.tolist())
    ]
    gateways = [
        (g, f"gateway at {names[cell]}:{port} · {_link_text(run_state, (cell, port))}")
        for g, (cell, port) in enumerate(layout.gateways.tolist())
    ]
    return (
        f"<style>{tooltip_rules(_CSS_CLASS, 'n', cells)}{tooltip_rules(_CSS_CLASS, 'w', wires)}"
        f"{tooltip_rules(_CSS_CLASS, 'g', gateways)}</style>"
    )


def render_legend(run_state: RunState) -> str:
    """Legend of link colours, with counts of broken links and unreachable cells."""
    network = run_state.network
    cut, out = int(network.broken.sum()), int(network.unreachable.sum())
    source = "reported by the cell processes" if network.measured_ns >= 0 else "inferred from deliveries"
    bad = f'<b style="color:{_FAULT_COLOUR}">'
    words = [
        f"{int(network.connected.sum())} of {len(network.connected)} cells in the network",
        f"{bad}{cut} broken links</b>" if cut else "no broken links",
        f"{bad}{out} unreachable cells</b>" if out else "no unreachable cells",
    ]
    if network.measured_ns >= 0:
        words.append(f"{int(network.dropped.sum())} packets lost on links")
    return (
        f'<div style="font-size:11px;color:#495766;padding:2px 10px">{" · ".join(words)}'
        f'<div style="height:7px;border-radius:3px;margin-top:3px;'
        f'background:linear-gradient(90deg,{",".join(_LOAD_COLOURS)})"></div>'
        f"<div>0<span style='float:right'>{_scale_maximum(run_state):.0%}</span>"
        f"<div style='text-align:center'>link utilisation, {source}</div></div></div>"
    )


def _wires(layout: SkinLayout) -> Iterator[str]:
    """Wire elements; stubs at both ends for wires that cross a seam."""
    paper, turn = layout.flattening, layout.flattening.angle_rad
    first_bridge = len(layout.wires) - layout.n_bridges
    for wire, (a, port_a, b, port_b) in enumerate(layout.wires.tolist()):
        ends = paper.position[a], paper.position[b]
        if wire >= first_bridge:
            yield map_line(paper, "b", f"w{wire} br", _as_tuple(ends[0]), _as_tuple(ends[1]))
        elif np.linalg.norm(ends[0] - ends[1]) < _SEAM_LENGTH:
            yield map_line(paper, "b", f"w{wire}", _as_tuple(ends[0]), _as_tuple(ends[1]))
        else:
            for at, cell, port in ((ends[0], a, port_a), (ends[1], b, port_b)):
                yield map_line(paper, "b", f"w{wire}", _as_tuple(at), _outwards(at, turn[cell], port, 0.75))


def _gateways(layout: SkinLayout) -> Iterator[str]:
    paper = layout.flattening
    for number, (cell, port) in enumerate(layout.gateways.tolist()):
        at, end = paper.position[cell], _outwards(paper.position[cell], paper.angle_rad[cell], port, 0.95)
        yield map_line(paper, "u", f"g{number}", _as_tuple(at), end)
        yield map_element(paper, "u", f"g{number} pc", end)


def _as_tuple(at: NDArray[np.float64]) -> tuple[float, float]:
    return float(at[0]), float(at[1])


def _outwards(at: NDArray[np.float64], turn_rad: float, port: int, length: float) -> tuple[float, float]:
    angle = float(turn_rad) + PORT_ANGLES_RAD[port]
    return float(at[0]) + length * math.cos(angle), float(at[1]) + length * math.sin(angle)


def _scale_maximum(run_state: RunState) -> float:
    """Link load at the upper end of the colour scale."""
    most = float(run_state.network.utilisation.max(initial=0.0))
    return next((top for top in _SCALE_MAXIMA if top >= most), 1.0)


def _link_text(run_state: RunState, *ends: tuple[int, int]) -> str:
    """Link load, queue length and losses of the given ends, as text."""
    network = run_state.network
    words = " and ".join(f"{network.utilisation[end]:.1%}" for end in ends)
    text = f"utilisation {words}"
    lost, waited = (sum(int(a[end]) for end in ends) for a in (network.dropped, network.max_queue_length))
    if waited:
        text += f" · queue up to {waited}"
    return text + (f" · lost {lost}" if lost else "")
