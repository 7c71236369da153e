"""Patch map panel: flattened skin with cells as hexagons and elements as squares, coloured by reading."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.protocol.messages import Modality
from skinnet.view.page.colours import COLOUR_SCALES, PRESSURE_SCALE, UNREACHABLE_INDEX, css_colour, palette
from skinnet.view.panels.skin_map import (
    COMMON_STYLE,
    captions,
    map_element,
    skin_map,
    style_rules,
    tooltip_rules,
)
from skinnet.view.state.run_state import RunState
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["render", "render_legend", "render_style", "render_tooltips"]

_COLOURS = [css_colour(rgb) for rgb in palette()]
_CSS_CLASS = "sk-patches"
_IDLE_COLOUR = _COLOURS[0]


def render(layout: SkinLayout) -> str:
    """Patch map as HTML, with every taxel idle."""
    paper = layout.flattening
    cell, element = 96.5 / paper.width, 92.0 / paper.width
    style = (
        f"{COMMON_STYLE}.{_CSS_CLASS} i{{width:{cell:.3f}%;aspect-ratio:{math.sqrt(3) / 2:.4f};"
        f"background:{_IDLE_COLOUR};"
        "clip-path:polygon(50% 0,100% 25%,100% 75%,50% 100%,0 75%,0 25%)}"
        f".{_CSS_CLASS} i.el{{width:{element:.3f}%;aspect-ratio:1;clip-path:none;border-radius:8%}}"
        f".{_CSS_CLASS} i:hover{{filter:brightness(1.35)}}"
    )
    places = zip(paper.position.tolist(), paper.angle_rad.tolist(), strict=True)
    spots = [
        map_element(paper, "i", f"c{n}" if n < layout.n_cells else f"c{n} el", (at[0], at[1]), turn)
        for n, (at, turn) in enumerate(places)
    ]
    names = list(layout.first_taxel)
    names_alone = tooltip_rules(_CSS_CLASS, "c", enumerate(layout.taxel_names))
    font_px = min(max(330.0 / paper.width, 6.5), 12.0)
    parts = [*spots, *captions(paper, names, font_px)]
    hint = "hover over a cell for its readings"
    return f"<style>{style}{names_alone}</style>{skin_map(_CSS_CLASS, paper, parts, hint)}"


def render_style(colour_index: NDArray[np.int64]) -> str:
    """Style sheet for the colour indices `colour_index` (spots,); idle taxels have no rule."""
    looks = (
        (n, f"background:{_COLOURS[s]}" + (";outline:1px solid #e03131" if s == UNREACHABLE_INDEX else ""))
        for n, s in enumerate(colour_index.tolist())
        if s
    )
    return f"<style>{style_rules('c', looks)}</style>"


def render_tooltips(layout: SkinLayout, run_state: RunState) -> str:
    """Style sheet with the tooltips of all taxels: their newest readings."""
    texts = [
        (n, f"{layout.taxel_names[n]} · {_reading_text(row)}")
        for n, row in enumerate(run_state.skin.reading.tolist())
        if any(value and value == value for value in row)
    ]
    dead = [
        (n, f"{layout.taxel_names[n]} · unreachable")
        for n in np.flatnonzero(run_state.network.unreachable).tolist()
    ]
    pressed = enumerate(run_state.skin.pressure_kpa().tolist(), layout.n_cells)
    elements = [(n, f"{layout.taxel_names[n]} · {value:.1f} kPa") for n, value in pressed if value > 0.0]
    return f"<style>{tooltip_rules(_CSS_CLASS, 'c', [*texts, *dead, *elements])}</style>"


def render_legend(modality: Modality, layout: SkinLayout) -> str:
    """Colour scale with its ticks."""
    if modality is Modality.FORCE and not layout.n_cells:
        scale, what = PRESSURE_SCALE, "pressure"
    else:
        scale, what = COLOUR_SCALES[modality], modality.name.lower()
    stops = ",".join(_COLOURS[:-2:7])
    marks = "".join(
        f'<span style="position:absolute;left:{100 * place:.1f}%;transform:translateX(-50%)">{tick:g}</span>'
        for tick, place in zip(scale.ticks, scale.normalise(np.array(scale.ticks)).tolist(), strict=True)
    )
    unit = f" [{scale.unit}]" if scale.unit else ""
    return (
        f'<div style="font-size:11px;color:#495766;padding:2px 10px"><div>{what}{unit}</div>'
        f'<div style="height:9px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="position:relative;height:15px">{marks}</div></div>'
    )


def _reading_text(row: list[float]) -> str:
    """Reading (8,) as text, without unknown modalities."""
    words = []
    for name, columns, form, unit in (
        ("force", row[0:3], "{:.2f}", ""),
        ("proximity", row[3:4], "{:.2f}", ""),
        ("", row[4:7], "{:+.2f}", " g"),
        ("", row[7:8], "{:.1f}", " °C"),
    ):
        if all(value == value for value in columns):
            values = " ".join(form.format(value) for value in columns)
            words.append(f"{name} {values}{unit}".strip())
    return " · ".join(words)
