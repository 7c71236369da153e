"""HTML map of the flattened skin: elements positioned in percent, and a tooltip line.

An element's class is `prefix` and number. Tags: `i` for taxels, `b` for wires, `u` for gateways.
"""

import html
import math
from collections import defaultdict
from collections.abc import Iterable

from skinnet.skin.flattening import FlattenedSkin

__all__ = ["COMMON_STYLE", "captions", "map_element", "map_line", "skin_map", "style_rules", "tooltip_rules"]

COMMON_STYLE = (
    ".sk-paper{position:relative;width:100%;margin-bottom:30px}"
    ".sk-paper i,.sk-paper b,.sk-paper u{position:absolute;display:block;text-decoration:none;"
    "transform:translate(-50%,-50%)}"
    ".sk-paper .cap{position:absolute;text-align:center;white-space:nowrap;overflow:hidden;"
    "text-overflow:ellipsis;color:#495766;line-height:1.15}"
    ".sk-tip{position:absolute;left:10px;right:0;top:calc(100% + 4px);margin:0;min-height:20px;"
    "white-space:pre;font:12px ui-monospace,monospace;color:#1f2d3d}"
    ".sk-tip::after{font:12px ui-monospace,monospace}"
)
"""Style sheet common to all maps."""


def skin_map(css_class: str, flattening: FlattenedSkin, elements: Iterable[str], hint: str) -> str:
    """Skin map of class `css_class` with `elements`; `hint` is the tooltip line's initial text."""
    return (
        f'<div class="sk-paper {css_class}" '
        f'style="aspect-ratio:{flattening.width:.2f}/{flattening.height:.2f}">'
        f"{''.join(elements)}"
        f'<p class="sk-tip">{html.escape(hint)}</p></div>'
    )


def map_element(
    flattening: FlattenedSkin,
    tag: str,
    css_class: str,
    position: tuple[float, float],
    rotation_rad: float = 0.0,
) -> str:
    """Map element centred at `position` [pitches], rotated counterclockwise."""
    turned = math.degrees(-rotation_rad) % 60.0
    turn = f";transform:translate(-50%,-50%) rotate({turned:.1f}deg)" if 0.1 < turned < 59.9 else ""
    return f'<{tag} class="{css_class}" style="{_css_position(flattening, position)}{turn}"></{tag}>'


def map_line(
    flattening: FlattenedSkin, tag: str, css_class: str, a: tuple[float, float], b: tuple[float, float]
) -> str:
    """Line element from `a` to `b` [pitches]; its thickness comes from the style sheet."""
    middle = (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
    length = 100 * math.dist(a, b) / flattening.width
    turn = math.degrees(math.atan2(a[1] - b[1], b[0] - a[0]))
    return (
        f'<{tag} class="{css_class}" style="{_css_position(flattening, middle)};width:{length:.2f}%;'
        f'transform:translate(-50%,-50%) rotate({turn:.1f}deg)"></{tag}>'
    )


def captions(flattening: FlattenedSkin, lines: Iterable[str], font_px: float) -> list[str]:
    """Caption elements below each piece, of classes `cap` and `cap<number>`."""
    return [
        f'<div class="cap cap{i}" style="left:{100 * box.x / flattening.width:.2f}%;'
        f"width:{100 * box.width / flattening.width:.2f}%;"
        f'top:{100 * (-box.y - 2.0) / flattening.height:.2f}%;font-size:{font_px:.1f}px">'
        f"{html.escape(line)}</div>"
        for i, (box, line) in enumerate(zip(flattening.boxes, lines, strict=True))
    ]


def style_rules(prefix: str, styles: Iterable[tuple[int, str]]) -> str:
    """Style rules by element number; elements of equal style share one rule."""
    by_look: dict[str, list[str]] = defaultdict(list)
    for number, look in styles:
        by_look[look].append(f".{prefix}{number}")
    # two classes: higher specificity than the map's own rules
    return "".join(f".sk-paper :is({','.join(names)}){{{look}}}" for look, names in by_look.items())


def tooltip_rules(map_class: str, prefix: str, texts: Iterable[tuple[int, str]]) -> str:
    """Tooltip rules: the tooltip line shows an element's text while the pointer is on it."""
    found = []
    for number, text in texts:
        over = f".{prefix}{number}:hover~.sk-tip"
        quoted = text.replace("\\", "\\\\").replace('"', '\\"').replace("<", "‹")
        found.append(f'{over}::after{{content:"{quoted}"}}')
    return f".{map_class}>:is(i,b,u):hover~.sk-tip{{font-size:0}}{''.join(found)}"


def _css_position(flattening: FlattenedSkin, position: tuple[float, float]) -> str:
    return (
        f"left:{100 * position[0] / flattening.width:.2f}%;top:{-100 * position[1] / flattening.height:.2f}%"
    )
