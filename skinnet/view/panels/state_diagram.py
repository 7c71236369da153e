"""State diagram as SVG: states on a ring, transitions as arcs through the inside."""

import html
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import NamedTuple

__all__ = ["CURRENT_STATE_COLOUR", "TEXT_COLOUR", "render", "short_state_name"]

_WIDTH = 540.0
_RADIUS_X, _RADIUS_Y = 205.0, 165.0
_LABEL_HEIGHT, _MARGIN = 22.0, 50.0
_CHARACTER_WIDTH = 6.3
"""Character width on a state label [px]."""
_BEND = 0.28
"""Arc deflection towards the centre, as a fraction of the chord's distance from it."""
_SEPARATION = 14.0
"""Arc deflection to the right [px], which separates the two directions."""
TEXT_COLOUR, CURRENT_STATE_COLOUR = "#1f2d3d", "#0b6e4f"

Point = tuple[float, float]


class _TransitionStyle(Enum):
    """Transition style: colour and line width."""

    INACTIVE = ("#cfd8e0", 1.0)
    """Transition from another state."""
    OUTGOING = ("#2563a8", 1.6)
    """Transition from the present state."""
    LAST = ("#c92a2a", 2.4)
    """Transition by which the present state was reached."""


class _Arc(NamedTuple):
    path: str
    label: str


def render(
    states: Sequence[str],
    transitions: Mapping[tuple[str, str], Sequence[str]],
    current: str,
    last_transition: tuple[str, str] | None,
) -> str:
    """State diagram as SVG.

    Args:
        states: All states, clockwise from the top.
        transitions: Events by (source state, target state).
        current: Present state.
        last_transition: Source and target state of the last transition.
    """
    few = min(0.25 + 0.1 * len(states), 1.0)
    centre = _WIDTH / 2, few * (_RADIUS_Y + _MARGIN)
    at: dict[str, Point] = {}
    for i, state in enumerate(states):
        angle = 2 * math.pi * i / len(states)
        at[state] = (
            centre[0] + few * _RADIUS_X * math.sin(angle),
            centre[1] - few * _RADIUS_Y * math.cos(angle),
        )
    kinds = {
        way: _TransitionStyle.LAST
        if way == last_transition
        else _TransitionStyle.OUTGOING
        if way[0] == current
        else _TransitionStyle.INACTIVE
        for way in transitions
        if way[0] != way[1]
    }
    order = sorted(kinds, key=lambda way: kinds[way].value[1])  # highlighted arcs on top
    arcs = [_arc(way, transitions[way], kinds[way], at, centre) for way in order]
    pills = "".join(_state_label(state, at[state], current=state == current) for state in states)
    marks = "".join(
        f'<marker id="sk-{kind.name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" '
        f'markerUnits="userSpaceOnUse" orient="auto">'
        f'<path d="M0 0 8 4 0 8z" fill="{kind.value[0]}"/></marker>'
        for kind in _TransitionStyle
    )
    paths, labels = ("".join(part) for part in zip(*arcs, strict=True)) if arcs else ("", "")
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {2 * centre[1]:.0f}" style="width:100%;display:block" '
        f'font-family="system-ui,sans-serif"><defs>{marks}</defs>{paths}{pills}{labels}</svg>'
    )


def short_state_name(state: str) -> str:
    """Short state name, without its stage."""
    return state.rpartition(".")[2]


def _arc(
    transition: tuple[str, str],
    events: Sequence[str],
    kind: _TransitionStyle,
    centres: Mapping[str, Point],
    centre: Point,
) -> _Arc:
    """Transition arc; highlighted ones are labelled with their first event."""
    (xa, ya), (xb, yb) = centres[transition[0]], centres[transition[1]]
    xm, ym = 0.5 * (xa + xb), 0.5 * (ya + yb)
    length = math.hypot(xb - xa, yb - ya) or 1.0
    xc = xm + _BEND * (centre[0] - xm) + _SEPARATION * (ya - yb) / length
    yc = ym + _BEND * (centre[1] - ym) + _SEPARATION * (xb - xa) / length
    start, end = (
        _outline_point((xa, ya), (xc, yc), transition[0]),
        _outline_point((xb, yb), (xc, yc), transition[1]),
    )
    colour, width = kind.value
    path = (
        f'<path d="M{start[0]:.1f} {start[1]:.1f}Q{xc:.1f} {yc:.1f} {end[0]:.1f} {end[1]:.1f}" fill="none" '
        f'stroke="{colour}" stroke-width="{width}" marker-end="url(#sk-{kind.name})"/>'
    )
    if kind is _TransitionStyle.INACTIVE or not events:
        return _Arc(path, "")
    text = html.escape(events[0] + (f" +{len(events) - 1}" if len(events) > 1 else ""))
    xt, yt = 0.25 * start[0] + 0.5 * xc + 0.25 * end[0], 0.25 * start[1] + 0.5 * yc + 0.25 * end[1]
    anchor, shift = ("start", 6.0) if xt < centre[0] else ("end", -6.0)  # inwards, where there is space
    return _Arc(
        path,
        f'<text x="{xt + shift:.1f}" y="{yt + 3:.1f}" text-anchor="{anchor}" font-size="10" '
        f'fill="{colour}" stroke="#fff" stroke-width="3.5" paint-order="stroke">{text}</text>',
    )


def _outline_point(centre: Point, towards: Point, state: str) -> Point:
    """Intersection of the line from a label's centre to `towards` with the label's outline."""
    half_w, half_h = _half_width(state) + 2.0, 0.5 * _LABEL_HEIGHT + 2.0
    dx, dy = towards[0] - centre[0], towards[1] - centre[1]
    share = min(half_w / abs(dx) if dx else math.inf, half_h / abs(dy) if dy else math.inf, 1.0)
    return centre[0] + share * dx, centre[1] + share * dy


def _half_width(state: str) -> float:
    return 0.5 * _CHARACTER_WIDTH * len(short_state_name(state)) + 9.0


def _state_label(state: str, at: Point, *, current: bool) -> str:
    half = _half_width(state)
    fill, ink, edge = (
        (CURRENT_STATE_COLOUR, "#fff", CURRENT_STATE_COLOUR) if current else ("#fff", TEXT_COLOUR, "#aebac5")
    )
    return (
        f'<rect x="{at[0] - half:.1f}" y="{at[1] - _LABEL_HEIGHT / 2:.1f}" width="{2 * half:.1f}" '
        f'height="{_LABEL_HEIGHT}" rx="11" fill="{fill}" stroke="{edge}" stroke-width="1.3"/>'
        f'<text x="{at[0]:.1f}" y="{at[1] + 4:.1f}" text-anchor="middle" font-size="11.5" fill="{ink}">'
        f"{html.escape(short_state_name(state))}<title>{html.escape(state)}</title></text>"
    )
