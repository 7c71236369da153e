"""Controller panel: state diagram with the present state, and recent transitions."""

import html

from skinnet.view.mind import Mind
from skinnet.view.panels import ring
from skinnet.view.panels.ring import INK, NOW, short

__all__ = ["draw"]

_SHOWN_MOVES = 12


def draw(mind: Mind, t_ns: int) -> str:
    """Controller panel as HTML; present state filled, outgoing transitions blue, last transition red."""
    if not mind.state:
        return '<p style="padding:10px;color:#495766">nothing was heard of the controller yet</p>'
    ways: dict[tuple[str, str], list[str]] = {}
    for state, event, to in mind.arrows:
        ways.setdefault((state, to), []).append(event)
    last = None
    if mind.moves and mind.moves[-1].to == mind.state:
        move = mind.moves[-1]
        last = move.state, move.to
        ways[last] = [move.why] if move.why else []
    return f"{_heading(mind, t_ns)}{ring.draw(mind.states, ways, mind.state, last)}{_table(mind)}"


def _heading(mind: Mind, t_ns: int) -> str:
    lasted_s = max(t_ns - mind.since_ns, 0) * 1e-9
    text = f" · {html.escape(mind.text)}" if mind.text else ""
    done = 100 * min(max(mind.progress, 0.0), 1.0)
    return (
        f'<div style="padding:4px 10px"><b style="font-size:15px;color:{NOW}">{html.escape(mind.state)}</b>'
        f'<span style="color:#495766"> for {lasted_s:.0f} s{text}</span>'
        f'<div style="height:4px;background:#e6ebef;border-radius:2px;margin-top:3px">'
        f'<div style="height:4px;width:{done:.0f}%;background:{NOW};border-radius:2px"></div></div></div>'
    )


def _table(mind: Mind) -> str:
    rows = "".join(
        f"<tr><td style='text-align:right'>{move.t_ns * 1e-9:.2f} s</td>"
        f"<td>{html.escape(short(move.state))}</td>"
        f"<td>→ <b>{html.escape(short(move.to))}</b></td><td>{html.escape(move.why)}</td></tr>"
        for move in reversed(list(mind.moves)[-_SHOWN_MOVES:])
    )
    if not rows:
        return ""
    return (
        f"<style>.sk-moves td{{padding:1px 8px;font-size:11.5px;color:{INK}}}</style>"
        f'<table class="sk-moves" style="margin:2px 6px"><tbody>{rows}</tbody></table>'
    )
