"""State diagram as SVG: states on a ring, transitions as arcs through the inside."""

import html
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import NamedTuple

__all__ = ["INK", "NOW", "draw", "short"]

_WIDTH = 540.0
_RX, _RY = 205.0, 165.0
_PILL_H, _MARGIN = 22.0, 50.0
_CHARACTER = 6.3
"""Character width on a state label [px]."""
_BENT = 0.28
"""Arc deflection towards the centre, as a fraction of the chord's distance from it."""
_APART = 14.0
"""Arc deflection to the right [px], which separates the two directions."""
INK, NOW = "#1f2d3d", "#0b6e4f"

Point = tuple[float, float]


class _Kind(Enum):
    """Transition style: colour and line width."""

    PALE = ("#cfd8e0", 1.0)
    """Transition from another state."""
    OPEN = ("#2563a8", 1.6)
    """Transition from the present state."""
    LAST = ("#c92a2a", 2.4)
    """Transition by which the present state was reached."""


class _Arc(NamedTuple):
    path: str
    label: str


def draw(
    states: Sequence[str],
    ways: Mapping[tuple[str, str], Sequence[str]],
    now: str,
    last: tuple[str, str] | None,
) -> str:
    """State diagram as SVG.

    Args:
        states: All states, clockwise from the top.
        ways: Events by (source state, target state).
        now: Present state.
        last: Source and target state of the last transition.
    """
    few = min(0.25 + 0.1 * len(states), 1.0)
    centre = _WIDTH / 2, few * (_RY + _MARGIN)
    at: dict[str, Point] = {}
    for i, state in enumerate(states):
        angle = 2 * math.pi * i / len(states)
        at[state] = centre[0] + few * _RX * math.sin(angle), centre[1] - few * _RY * math.cos(angle)
    kinds = {
        way: _Kind.LAST if way == last else _Kind.OPEN if way[0] == now else _Kind.PALE
        for way in ways
        if way[0] != way[1]
    }
    order = sorted(kinds, key=lambda way: kinds[way].value[1])  # highlighted arcs on top
    arcs = [_arc(way, ways[way], kinds[way], at, centre) for way in order]
    pills = "".join(_pill(state, at[state], now=state == now) for state in states)
    marks = "".join(
        f'<marker id="sk-{kind.name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" '
        f'markerUnits="userSpaceOnUse" orient="auto">'
        f'<path d="M0 0 8 4 0 8z" fill="{kind.value[0]}"/></marker>'
        for kind in _Kind
    )
    paths, labels = ("".join(part) for part in zip(*arcs, strict=True)) if arcs else ("", "")
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {2 * centre[1]:.0f}" style="width:100%;display:block" '
        f'font-family="system-ui,sans-serif"><defs>{marks}</defs>{paths}{pills}{labels}</svg>'
    )


def short(state: str) -> str:
    """Short state name, without its stage."""
    return state.rpartition(".")[2]


def _arc(
    way: tuple[str, str], events: Sequence[str], kind: _Kind, at: Mapping[str, Point], centre: Point
) -> _Arc:
    """Transition arc; highlighted ones are labelled with their first event."""
    (xa, ya), (xb, yb) = at[way[0]], at[way[1]]
    xm, ym = 0.5 * (xa + xb), 0.5 * (ya + yb)
    length = math.hypot(xb - xa, yb - ya) or 1.0
    xc = xm + _BENT * (centre[0] - xm) + _APART * (ya - yb) / length
    yc = ym + _BENT * (centre[1] - ym) + _APART * (xb - xa) / length
    start, end = _rim((xa, ya), (xc, yc), way[0]), _rim((xb, yb), (xc, yc), way[1])
    colour, width = kind.value
    path = (
        f'<path d="M{start[0]:.1f} {start[1]:.1f}Q{xc:.1f} {yc:.1f} {end[0]:.1f} {end[1]:.1f}" fill="none" '
        f'stroke="{colour}" stroke-width="{width}" marker-end="url(#sk-{kind.name})"/>'
    )
    if kind is _Kind.PALE or not events:
        return _Arc(path, "")
    text = html.escape(events[0] + (f" +{len(events) - 1}" if len(events) > 1 else ""))
    xt, yt = 0.25 * start[0] + 0.5 * xc + 0.25 * end[0], 0.25 * start[1] + 0.5 * yc + 0.25 * end[1]
    anchor, shift = ("start", 6.0) if xt < centre[0] else ("end", -6.0)  # inwards, where there is space
    return _Arc(
        path,
        f'<text x="{xt + shift:.1f}" y="{yt + 3:.1f}" text-anchor="{anchor}" font-size="10" '
        f'fill="{colour}" stroke="#fff" stroke-width="3.5" paint-order="stroke">{text}</text>',
    )


def _rim(middle: Point, towards: Point, state: str) -> Point:
    """Intersection of the line from a label's centre to `towards` with the label's outline."""
    half_w, half_h = _half_width(state) + 2.0, 0.5 * _PILL_H + 2.0
    dx, dy = towards[0] - middle[0], towards[1] - middle[1]
    share = min(half_w / abs(dx) if dx else math.inf, half_h / abs(dy) if dy else math.inf, 1.0)
    return middle[0] + share * dx, middle[1] + share * dy


def _half_width(state: str) -> float:
    return 0.5 * _CHARACTER * len(short(state)) + 9.0


def _pill(state: str, at: Point, *, now: bool) -> str:
    half = _half_width(state)
    fill, ink, edge = (NOW, "#fff", NOW) if now else ("#fff", INK, "#aebac5")
    return (
        f'<rect x="{at[0] - half:.1f}" y="{at[1] - _PILL_H / 2:.1f}" width="{2 * half:.1f}" '
        f'height="{_PILL_H}" rx="11" fill="{fill}" stroke="{edge}" stroke-width="1.3"/>'
        f'<text x="{at[0]:.1f}" y="{at[1] + 4:.1f}" text-anchor="middle" font-size="11.5" fill="{ink}">'
        f"{html.escape(short(state))}<title>{html.escape(state)}</title></text>"
    )
