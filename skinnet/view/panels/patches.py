"""Patch map panel: flattened skin with cells as hexagons and elements as squares, coloured by reading."""

import math

import numpy as np
from numpy.typing import NDArray

from skinnet.messages import Modality
from skinnet.view.atlas import Atlas
from skinnet.view.colours import DEAD, PRESSURE, SCALES, css, palette
from skinnet.view.panels.sheet import STYLE, captions, rules, sheet, spot, tips
from skinnet.view.state import Scene

__all__ = ["draw", "legend", "paint", "tell"]

_COLOURS = [css(rgb) for rgb in palette()]
_NAME = "sk-patches"
_IDLE = _COLOURS[0]


def draw(atlas: Atlas) -> str:
    """Patch map as HTML, with every taxel idle."""
    paper = atlas.paper
    cell, element = 96.5 / paper.width, 92.0 / paper.width
    style = (
        f"{STYLE}.{_NAME} i{{width:{cell:.3f}%;aspect-ratio:{math.sqrt(3) / 2:.4f};background:{_IDLE};"
        "clip-path:polygon(50% 0,100% 25%,100% 75%,50% 100%,0 75%,0 25%)}"
        f".{_NAME} i.el{{width:{element:.3f}%;aspect-ratio:1;clip-path:none;border-radius:8%}}"
        f".{_NAME} i:hover{{filter:brightness(1.35)}}"
    )
    places = zip(paper.at.tolist(), paper.turn.tolist(), strict=True)
    spots = [
        spot(paper, "i", f"c{n}" if n < atlas.n_cells else f"c{n} el", (at[0], at[1]), turn)
        for n, (at, turn) in enumerate(places)
    ]
    names = list(atlas.first)
    names_alone = tips(_NAME, "c", enumerate(atlas.names))
    font_px = min(max(330.0 / paper.width, 6.5), 12.0)
    parts = [*spots, *captions(paper, names, font_px)]
    hint = "point at a cell to see what it feels"
    return f"<style>{style}{names_alone}</style>{sheet(_NAME, paper, parts, hint)}"


def paint(shade: NDArray[np.int64]) -> str:
    """Style sheet for the colour indices `shade` (spots,); idle taxels have no rule."""
    looks = (
        (n, f"background:{_COLOURS[s]}" + (";outline:1px solid #e03131" if s == DEAD else ""))
        for n, s in enumerate(shade.tolist())
        if s
    )
    return f"<style>{rules('c', looks)}</style>"


def tell(atlas: Atlas, scene: Scene) -> str:
    """Style sheet with the tooltips of all taxels: their newest readings."""
    texts = [
        (n, f"{atlas.names[n]} · {_reading(row)}")
        for n, row in enumerate(scene.skin.reading.tolist())
        if any(value and value == value for value in row)
    ]
    dead = [
        (n, f"{atlas.names[n]} · not in the network") for n in np.flatnonzero(scene.network.dead).tolist()
    ]
    pressed = enumerate(scene.skin.pressure_kpa().tolist(), atlas.n_cells)
    elements = [(n, f"{atlas.names[n]} · {value:.1f} kPa") for n, value in pressed if value > 0.0]
    return f"<style>{tips(_NAME, 'c', [*texts, *dead, *elements])}</style>"


def legend(modality: Modality, atlas: Atlas) -> str:
    """Colour scale with its ticks."""
    if modality is Modality.FORCE and not atlas.n_cells:
        scale, what = PRESSURE, "pressure"
    else:
        scale, what = SCALES[modality], modality.name.lower()
    stops = ",".join(_COLOURS[:-2:7])
    marks = "".join(
        f'<span style="position:absolute;left:{100 * place:.1f}%;transform:translateX(-50%)">{tick:g}</span>'
        for tick, place in zip(scale.ticks, scale.place(np.array(scale.ticks)).tolist(), strict=True)
    )
    unit = f" [{scale.unit}]" if scale.unit else ""
    return (
        f'<div style="font-size:11px;color:#495766;padding:2px 10px"><div>{what}{unit}</div>'
        f'<div style="height:9px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="position:relative;height:15px">{marks}</div></div>'
    )


def _reading(row: list[float]) -> str:
    """Reading (8,) as text, without unknown modalities."""
    words = []
    for name, columns, form, unit in (
        ("force", row[0:3], "{:.2f}", ""),
        ("near", row[3:4], "{:.2f}", ""),
        ("", row[4:7], "{:+.2f}", " g"),
        ("", row[7:8], "{:.1f}", " °C"),
    ):
        if all(value == value for value in columns):
            values = " ".join(form.format(value) for value in columns)
            words.append(f"{name} {values}{unit}".strip())
    return " · ".join(words)
