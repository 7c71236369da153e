"""Event raster panel: one row for each cell, time to the right, a dot for each event."""

import html

import numpy as np

from skinnet.view.panels.palette_png import png_data_url
from skinnet.view.state.event_history import FULL_READING_KIND
from skinnet.view.state.run_state import RASTER_NS, RunState
from skinnet.view.state.skin_layout import SkinLayout

__all__ = ["render", "render_style"]

_COLUMNS = 500
_HEIGHT_PX = 560
_LABELS_PX = 118
_MIN_LABEL_PITCH_PX = 8.0
_FULL_READING_COLOUR = "#cfd3e6"
_MODALITIES = (
    ("force", ("#f6c8a8", "#f2a33c", "#e2662c", "#c92a2a", "#7a0c1e", "#e2662c")),
    ("proximity", ("#c8dcf4", "#91c0ee", "#4b8fd6", "#2563a8", "#12386b", "#4b8fd6")),
    ("acceleration", ("#b9a3d9",) * 6),
    ("temperature", ("#7bbf8a",) * 6),
)
"""Event colours of levels 0 (contact ended) to 4, and of events without a level."""
_BACKGROUND_COLOUR, _LINE_COLOUR = "#f4f6f8", "#9aa7b3"


def _make_palette() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Palette (n, 3): background, full readings, then six colours for each modality."""
    texts = [
        _BACKGROUND_COLOUR,
        _FULL_READING_COLOUR,
        *(colour for _, colours in _MODALITIES for colour in colours),
    ]
    return np.array([[int(text[i : i + 2], 16) for i in (1, 3, 5)] for text in texts], dtype=np.uint8)


_PALETTE = _make_palette()


def render(layout: SkinLayout) -> str:
    """Event raster as HTML: frame, patch names and legend."""
    height = _HEIGHT_PX
    rows, starts, names = _raster_rows(layout)
    labels, last = [], -_MIN_LABEL_PITCH_PX
    for name, start in zip(names, starts, strict=True):
        top = height * start / rows
        labels.append(f'<hr style="top:{top:.1f}px">')
        if top - last >= _MIN_LABEL_PITCH_PX:
            labels.append(
                f'<span style="position:absolute;right:6px;top:{top:.1f}px;line-height:1">'
                f"{html.escape(name)}</span>"
            )
            last = top
    key = " ".join(
        f'<span style="white-space:nowrap"><span style="display:inline-block;width:9px;height:9px;'
        f'background:{colours[3]}"></span> {name}</span>'
        for name, colours in (*_MODALITIES, ("full reading", (_FULL_READING_COLOUR,) * 6))
    )
    seconds = RASTER_NS // 10**9
    style = (
        f".sk-raster{{position:relative;height:{height}px;margin:4px 0 0 {_LABELS_PX}px;"
        "background-size:100% 100%;image-rendering:pixelated;border:1px solid #d9dfe6}"
        f".sk-rnames{{position:absolute;left:-{_LABELS_PX}px;width:{_LABELS_PX}px;top:0;bottom:0;font-size:8.5px;"
        "color:#495766}"
        f".sk-raster hr{{position:absolute;left:{_LABELS_PX - 5}px;width:5px;margin:0;border:0;"
        f"border-top:1px solid {_LINE_COLOUR}}}"
    )
    return (
        f'<style>{style}</style><div style="font-size:11px;color:#495766;padding:2px 10px">{key} '
        "· darker: a higher level</div>"
        f'<div class="sk-raster"><div class="sk-rnames">{"".join(labels)}</div></div>'
        f'<div style="margin-left:{_LABELS_PX}px;font-size:10px;color:#495766">{seconds} s ago'
        '<span style="float:right">now</span></div>'
    )


def render_style(layout: SkinLayout, run_state: RunState) -> str:
    """Style sheet with the raster image of the last seconds."""
    rows, _, _ = _raster_rows(layout)
    begin_ns = run_state.t_ns - RASTER_NS
    t_ns, row, kind = run_state.events.since(begin_ns)
    column = np.minimum((t_ns - begin_ns) * _COLUMNS // RASTER_NS, _COLUMNS - 1)
    modality, level = np.divmod(kind, 8)
    colour = np.where(kind == FULL_READING_KIND, 1, 2 + 6 * modality + np.minimum(level, 5))
    order = np.argsort(colour != 1, kind="stable")  # events over full readings
    row, column, colour = row[order], column[order], colour[order]
    pixels = np.zeros((rows, _COLUMNS), dtype=np.uint8)
    valid = row < rows
    pixels[row[valid], column[valid]] = colour[valid].astype(np.uint8)
    return f"<style>.sk-raster{{background-image:url({png_data_url(pixels, _PALETTE)})}}</style>"


def _raster_rows(layout: SkinLayout) -> tuple[int, list[int], list[str]]:
    """Raster rows: their number, the first row of each patch or board, and its name."""
    starts = [layout.first_taxel[patch.name] for patch in layout.patches]
    starts += [layout.n_cells + board for board in range(len(layout.sheets))]
    names = list(layout.first_taxel)
    return layout.n_cells + len(layout.sheets), starts, names
