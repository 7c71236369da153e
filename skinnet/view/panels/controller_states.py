"""Controller panel: state diagram with the present state, and recent transitions."""

import html

from skinnet.view.panels import state_diagram as ring
from skinnet.view.panels.state_diagram import CURRENT_STATE_COLOUR, TEXT_COLOUR, short_state_name
from skinnet.view.state.controller_view import ControllerView

__all__ = ["render"]

_SHOWN_TRANSITIONS = 12


def render(controller: ControllerView, t_ns: int) -> str:
    """Controller panel as HTML; present state filled, outgoing transitions blue, last transition red."""
    if not controller.state:
        return '<p style="padding:10px;color:#495766">no controller state received yet</p>'
    ways: dict[tuple[str, str], list[str]] = {}
    for state, event, to in controller.transitions:
        ways.setdefault((state, to), []).append(event)
    last = None
    if controller.history and controller.history[-1].target == controller.state:
        move = controller.history[-1]
        last = move.source, move.target
        ways[last] = [move.reason] if move.reason else []
    drawing = ring.render(controller.states, ways, controller.state, last)
    return f"{_heading(controller, t_ns)}{drawing}{_table(controller)}"


def _heading(controller: ControllerView, t_ns: int) -> str:
    lasted_s = max(t_ns - controller.since_ns, 0) * 1e-9
    reason = f" · {html.escape(controller.reason)}" if controller.reason else ""
    done = 100 * min(max(controller.progress, 0.0), 1.0)
    return (
        f'<div style="padding:4px 10px"><b style="font-size:15px;color:{CURRENT_STATE_COLOUR}">'
        f"{html.escape(controller.state)}</b>"
        f'<span style="color:#495766"> for {lasted_s:.0f} s{reason}</span>'
        f'<div style="height:4px;background:#e6ebef;border-radius:2px;margin-top:3px">'
        f'<div style="height:4px;width:{done:.0f}%;background:{CURRENT_STATE_COLOUR};border-radius:2px">'
        "</div></div></div>"
    )


def _table(controller: ControllerView) -> str:
    rows = "".join(
        f"<tr><td style='text-align:right'>{move.t_ns * 1e-9:.2f} s</td>"
        f"<td>{html.escape(short_state_name(move.source))}</td>"
        f"<td>→ <b>{html.escape(short_state_name(move.target))}</b></td>"
        f"<td>{html.escape(move.reason)}</td></tr>"
        for move in reversed(list(controller.history)[-_SHOWN_TRANSITIONS:])
    )
    if not rows:
        return ""
    return (
        f"<style>.sk-moves td{{padding:1px 8px;font-size:11.5px;color:{TEXT_COLOUR}}}</style>"
        f'<table class="sk-moves" style="margin:2px 6px"><tbody>{rows}</tbody></table>'
    )
