"""The controller's states as a ring, what leads from one to another, and how it came to be where it is."""

import html
import math

from skinnet.view.mind import Mind

__all__ = ["draw"]

_WIDTH = 540.0
_RX, _RY = 205.0, 165.0
_PILL_H = 22.0
_INK, _PALE, _NOW, _LAST, _OPEN = "#1f2d3d", "#cfd8e0", "#0b6e4f", "#c92a2a", "#2563a8"
_SHOWN_MOVES = 12
_CHARACTER = 6.3


def draw(mind: Mind, t_ns: int) -> str:
    """The ring of states, and the last moves; the present state is filled, its ways out are blue.

    The way by which it came is red.
    """
    states = mind.states
    if not states:
        return '<p style="padding:10px;color:#495766">nothing was heard of the controller yet</p>'
    return f"{_heading(mind, t_ns)}{_ring(mind, states)}{_table(mind)}"


def _heading(mind: Mind, t_ns: int) -> str:
    lasted_s = max(t_ns - mind.since_ns, 0) * 1e-9
    text = f" · {html.escape(mind.text)}" if mind.text else ""
    done = 100 * min(max(mind.progress, 0.0), 1.0)
    return (
        f'<div style="padding:4px 10px"><b style="font-size:15px;color:{_NOW}">{html.escape(mind.state)}</b>'
        f'<span style="color:#495766"> for {lasted_s:.0f} s{text}</span>'
        f'<div style="height:4px;background:#e6ebef;border-radius:2px;margin-top:3px">'
        f'<div style="height:4px;width:{done:.0f}%;background:{_NOW};border-radius:2px"></div></div></div>'
    )


def _ring(mind: Mind, states: tuple[str, ...]) -> str:
    few = min(0.25 + 0.1 * len(states), 1.0)
    middle = few * (_RY + 50.0)
    at = {
        state: (
            _WIDTH / 2 + few * _RX * math.sin(2 * math.pi * i / len(states)),
            middle - few * _RY * math.cos(2 * math.pi * i / len(states)),
        )
        for i, state in enumerate(states)
    }
    last = mind.moves[-1] if mind.moves else None
    ways: dict[tuple[str, str], list[str]] = {}
    for state, event, to in mind.arrows:
        ways.setdefault((state, to), []).append(event)
    if last is not None:
        ways.setdefault((last.state, last.to), [])
    order = sorted(ways, key=lambda way: (way[0] == mind.state, _was(last, way)))  # the important ones on top
    arrows = "".join(
        _arrow(at, middle, way, ways[way], _colour(mind, way, last)) for way in order if way[0] != way[1]
    )
    pills = "".join(_pill(state, *at[state], now=state == mind.state) for state in states)
    marks = "".join(
        f'<marker id="sk-{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        f'orient="auto"><path d="M0 0 8 4 0 8z" fill="{colour}"/></marker>'
        for name, colour in (("pale", _PALE), ("open", _OPEN), ("last", _LAST))
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {2 * middle:.0f}" style="width:100%;display:block" '
        f'font-family="system-ui,sans-serif"><defs>{marks}</defs>{arrows}{pills}</svg>'
    )


def _was(last: object, way: tuple[str, str]) -> bool:
    return last is not None and (getattr(last, "state", None), getattr(last, "to", None)) == way


def _colour(mind: Mind, way: tuple[str, str], last: object) -> str:
    if _was(last, way):
        return "last"
    return "open" if way[0] == mind.state else "pale"


def _arrow(
    at: dict[str, tuple[float, float]], centre_y: float, way: tuple[str, str], events: list[str], kind: str
) -> str:
    """An arc between two states, bent towards the middle; one that matters has its events written on it."""
    (xa, ya), (xb, yb) = at[way[0]], at[way[1]]
    xm, ym = 0.5 * (xa + xb), 0.5 * (ya + yb)
    across = (ya - yb, xb - xa)  # to the right of the way, so that there and back are two arcs
    length = math.hypot(*across) or 1.0
    xc = xm + 0.28 * (_WIDTH / 2 - xm) + 14.0 * across[0] / length
    yc = ym + 0.28 * (centre_y - ym) + 14.0 * across[1] / length
    start, end = _rim((xa, ya), (xc, yc), way[0]), _rim((xb, yb), (xc, yc), way[1])
    colour = {"pale": _PALE, "open": _OPEN, "last": _LAST}[kind]
    width = {"pale": 1.0, "open": 1.6, "last": 2.6}[kind]
    path = (
        f'<path d="M{start[0]:.1f} {start[1]:.1f}Q{xc:.1f} {yc:.1f} {end[0]:.1f} {end[1]:.1f}" fill="none" '
        f'stroke="{colour}" stroke-width="{width}" marker-end="url(#sk-{kind})"/>'
    )
    if kind == "pale" or not events:
        return path
    text = html.escape(events[0] + (f" +{len(events) - 1}" if len(events) > 1 else ""))
    xt, yt = 0.25 * start[0] + 0.5 * xc + 0.25 * end[0], 0.25 * start[1] + 0.5 * yc + 0.25 * end[1]
    return (
        f'{path}<text x="{xt:.1f}" y="{yt - 2:.1f}" text-anchor="middle" font-size="9.5" fill="{colour}" '
        f'stroke="#fff" stroke-width="3" paint-order="stroke">{text}</text>'
    )


def _rim(middle: tuple[float, float], towards: tuple[float, float], state: str) -> tuple[float, float]:
    """Where the way from a pill's middle leaves it."""
    half_w, half_h = _half_width(state) + 2.0, 0.5 * _PILL_H + 2.0
    dx, dy = towards[0] - middle[0], towards[1] - middle[1]
    share = min(half_w / abs(dx) if dx else math.inf, half_h / abs(dy) if dy else math.inf, 1.0)
    return middle[0] + share * dx, middle[1] + share * dy


def _half_width(state: str) -> float:
    return 0.5 * _CHARACTER * len(_short(state)) + 9.0


def _short(state: str) -> str:
    """The name on a pill: that of the stage is left out if there is more."""
    return state.rpartition(".")[2]


def _pill(state: str, x: float, y: float, *, now: bool) -> str:
    half = _half_width(state)
    fill, ink, edge = (_NOW, "#fff", _NOW) if now else ("#fff", _INK, "#aebac5")
    return (
        f'<rect x="{x - half:.1f}" y="{y - _PILL_H / 2:.1f}" width="{2 * half:.1f}" '
        f'height="{_PILL_H}" rx="11" fill="{fill}" stroke="{edge}" stroke-width="1.3"/>'
        f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" font-size="11.5" fill="{ink}">'
        f"{html.escape(_short(state))}<title>{html.escape(state)}</title></text>"
    )


def _table(mind: Mind) -> str:
    rows = "".join(
        f"<tr><td style='text-align:right'>{move.t_ns * 1e-9:.2f} s</td>"
        f"<td>{html.escape(_short(move.state))}</td>"
        f"<td>→ <b>{html.escape(_short(move.to))}</b></td><td>{html.escape(move.why)}</td></tr>"
        for move in reversed(list(mind.moves)[-_SHOWN_MOVES:])
    )
    if not rows:
        return ""
    return (
        "<style>.sk-moves td{padding:1px 8px;font-size:11.5px;color:#1f2d3d}</style>"
        f'<table class="sk-moves" style="margin:2px 6px"><tbody>{rows}</tbody></table>'
    )
