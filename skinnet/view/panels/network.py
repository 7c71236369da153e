"""Network panel: link loads, routing tree, broken links and unreachable cells on the flattened skin."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from skinnet.skin.lattice import PORT_ANGLES_RAD
from skinnet.view.atlas import Atlas
from skinnet.view.panels.sheet import STYLE, bar, captions, rules, sheet, spot, tips
from skinnet.view.state import Scene

__all__ = ["draw", "legend", "paint", "tell"]

_NAME = "sk-net"
_FAR = 1.5
"""Length [pitches] above which a wire crosses a seam of the flattening, or is a bridge."""
_HEAT = ("#9fb6c9", "#7fb3a8", "#b9c96a", "#f0c54a", "#f2a33c", "#e8742c", "#d9481c", "#b3261a", "#8e0b1d")
_TOPS = (0.02, 0.05, 0.1, 0.25, 0.5, 1.0)
_BAD, _DEAD_CELL, _GATEWAY, _BRIDGE = "#e03131", "#16161a", "#0b6e4f", "#6a3d9a"
_CUT = f"z-index:3;height:3px;background:repeating-linear-gradient(90deg,{_BAD} 0 4px,transparent 4px 7px)"
_OUT = f"background:{_DEAD_CELL};box-shadow:0 0 0 2.5px {_BAD};z-index:4"


def draw(atlas: Atlas) -> str:
    """Network map as HTML, with all wires and no connected cells."""
    paper = atlas.paper
    dot = 46.0 / paper.width
    style = (
        f"{STYLE}.{_NAME} i{{width:{dot:.3f}%;aspect-ratio:1;border-radius:50%;background:#c9d2da;z-index:2}}"
        f".{_NAME} b{{height:1.5px;background:#dde3e9}}"
        f".{_NAME} b::before{{content:'';position:absolute;left:0;right:0;top:-4px;bottom:-4px}}"
        f".{_NAME} b.br{{background:repeating-linear-gradient(90deg,{_BRIDGE} 0 5px,transparent 5px 9px)}}"
        f".{_NAME} u{{height:3px;background:{_GATEWAY}}}"
        f".{_NAME} u.pc{{width:{dot:.3f}%;height:auto;aspect-ratio:1;z-index:2}}"
        f".{_NAME} i:hover,.{_NAME} b:hover{{filter:brightness(.75)}}"
    )
    names = list(atlas.first)
    font_px = min(max(330.0 / paper.width, 6.5), 12.0)
    cells = (spot(paper, "i", f"n{n}", (x, y)) for n, (x, y) in enumerate(paper.at[: atlas.n_cells].tolist()))
    parts = [*_wires(atlas), *_gateways(atlas), *cells, *captions(paper, names, font_px)]
    hint = "point at a cell, a link or a gateway"
    return f"<style>{style}</style>{sheet(_NAME, paper, parts, hint)}"


def paint(atlas: Atlas, scene: Scene) -> str:
    """Style sheet for link loads, broken links and unreachable cells."""
    network = scene.network
    load, tree, cut = network.wire_load, network.in_tree, network.cut
    top = _top(scene)
    shade = np.minimum(load / top * len(_HEAT), len(_HEAT) - 1).astype(int)
    looks = []
    for wire in np.flatnonzero(tree | cut | (load > 0.0)).tolist():
        if cut[wire]:
            looks.append((wire, _CUT))
        else:
            thickness = (2.5 if tree[wire] else 1.5) + 3.0 * min(float(load[wire]) / top, 1.0)
            looks.append((wire, f"z-index:1;height:{thickness:.0f}px;background:{_HEAT[shade[wire]]}"))
    dead = network.dead
    nodes = [
        (cell, _OUT if dead[cell] else "background:#1f2d3d")
        for cell in np.flatnonzero(network.found | dead).tolist()
    ]
    ways = [
        (g, "background:" + (_BAD if network.down[cell, port] else _GATEWAY))
        for g, (cell, port) in enumerate(atlas.gateways.tolist())
    ]
    return f"<style>{rules('w', looks)}{rules('n', nodes)}{rules('g', ways)}</style>"


def tell(atlas: Atlas, scene: Scene) -> str:
    """Style sheet with the tooltips of cells, links and gateways."""
    network, names = scene.network, atlas.names
    dead, cut = network.dead, network.cut
    cells = []
    for n in range(atlas.n_cells):
        if dead[n]:
            cells.append((n, f"{names[n]} · {'no power' if network.dark[n] else 'out of the network'}"))
        elif network.found[n]:
            parent = int(network.parent[n])
            to = names[parent] if parent >= 0 else "the computer"
            hops = int(network.depth[n])
            cells.append((n, f"{names[n]} · sends to {to} by port {network.master_port[n]} · hops {hops}"))
        else:
            cells.append((n, f"{names[n]} · not yet in the network"))
    wires = [
        (w, f"{names[a]}:{pa} ↔ {names[b]}:{pb} · {'cut' if cut[w] else _flow(scene, (a, pa), (b, pb))}")
        for w, (a, pa, b, pb) in enumerate(atlas.wires.tolist())
    ]
    gateways = [
        (g, f"gateway at {names[cell]}:{port} · {_flow(scene, (cell, port))}")
        for g, (cell, port) in enumerate(atlas.gateways.tolist())
    ]
    return f"<style>{tips(_NAME, 'n', cells)}{tips(_NAME, 'w', wires)}{tips(_NAME, 'g', gateways)}</style>"


def legend(scene: Scene) -> str:
    """Legend of link colours, with counts of broken links and unreachable cells."""
    network = scene.network
    cut, out = int(network.cut.sum()), int(network.dead.sum())
    source = "told by the hosts" if network.measured_ns >= 0 else "inferred from what was delivered"
    bad = f'<b style="color:{_BAD}">'
    words = [
        f"{int(network.found.sum())} of {len(network.found)} cells in the network",
        f"{bad}{cut} cut</b>" if cut else "no link cut",
        f"{bad}{out} out</b>" if out else "no cell out",
    ]
    if network.measured_ns >= 0:
        words.append(f"{int(network.dropped.sum())} packets lost on links")
    return (
        f'<div style="font-size:11px;color:#495766;padding:2px 10px">{" · ".join(words)}'
        f'<div style="height:7px;border-radius:3px;margin-top:3px;'
        f'background:linear-gradient(90deg,{",".join(_HEAT)})"></div>'
        f"<div>0<span style='float:right'>{_top(scene):.0%}</span>"
        f"<div style='text-align:center'>share of its time that a link sends, {source}</div></div></div>"
    )


def _wires(atlas: Atlas) -> Iterator[str]:
    """Wire elements; stubs at both ends for wires that cross a seam."""
    paper, turn = atlas.paper, atlas.paper.turn
    first_bridge = len(atlas.wires) - atlas.n_bridges
    for wire, (a, port_a, b, port_b) in enumerate(atlas.wires.tolist()):
        ends = paper.at[a], paper.at[b]
        if wire >= first_bridge:
            yield bar(paper, "b", f"w{wire} br", _point(ends[0]), _point(ends[1]))
        elif np.linalg.norm(ends[0] - ends[1]) < _FAR:
            yield bar(paper, "b", f"w{wire}", _point(ends[0]), _point(ends[1]))
        else:
            for at, cell, port in ((ends[0], a, port_a), (ends[1], b, port_b)):
                yield bar(paper, "b", f"w{wire}", _point(at), _outwards(at, turn[cell], port, 0.75))


def _gateways(atlas: Atlas) -> Iterator[str]:
    paper = atlas.paper
    for number, (cell, port) in enumerate(atlas.gateways.tolist()):
        at, end = paper.at[cell], _outwards(paper.at[cell], paper.turn[cell], port, 0.95)
        yield bar(paper, "u", f"g{number}", _point(at), end)
        yield spot(paper, "u", f"g{number} pc", end)


def _point(at: NDArray[np.float64]) -> tuple[float, float]:
    return float(at[0]), float(at[1])


def _outwards(at: NDArray[np.float64], turn_rad: float, port: int, reach: float) -> tuple[float, float]:
    angle = float(turn_rad) + PORT_ANGLES_RAD[port]
    return float(at[0]) + reach * math.cos(angle), float(at[1]) + reach * math.sin(angle)


def _top(scene: Scene) -> float:
    """Link load at the upper end of the colour scale."""
    most = float(scene.network.load.max(initial=0.0))
    return next((top for top in _TOPS if top >= most), 1.0)


def _flow(scene: Scene, *ends: tuple[int, int]) -> str:
    """Link load, queue length and losses of the given ends, as text."""
    network = scene.network
    words = " and ".join(f"{network.load[end]:.1%}" for end in ends)
    text = f"sends {words} of its time"
    lost, waited = (sum(int(a[end]) for end in ends) for a in (network.dropped, network.high_water))
    if waited:
        text += f" · queue up to {waited}"
    return text + (f" · lost {lost}" if lost else "")
