"""Time-series charts of the last minute: latencies, delivered packets and lost packets."""

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from skinnet.view.state.event_history import TrafficSeries

__all__ = ["Charts"]

_PERIOD_S = 0.5
_HEIGHT_PX = 190
_AXIS_PX = 64
_NO_TICKS = uplot.Axis_Ticks(show=False)
_SERIES = {
    "latency from sample to delivery [ms]": (
        ("median", "#2563a8", "median_ms"),
        ("95 %", "#f2a33c", "p95_ms"),
        ("most", "#c92a2a", "max_ms"),
    ),
    "packets delivered [1/s]": (("delivered", "#0b6e4f", "delivered"),),
    "lost [1/s]": (("by links", "#c92a2a", "dropped"), ("on the way to this page", "#6a3d9a", "missed")),
}
"""Chart title; then label, colour and `TrafficSeries` field of each line."""


class Charts:
    """Chart panel."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._due_s = 0.0
        nothing = np.array([0.0, 1.0])
        self._charts = {
            title: gui.add_uplot(
                (nothing, *(np.zeros(2) for _ in lines)),
                (
                    uplot.Series(label="t [s]"),
                    *(_line(name, colour) for name, colour, _ in lines),
                ),
                title=title,
                scales={"x": {"time": False}},
                axes=(uplot.Axis(ticks=_NO_TICKS), uplot.Axis(ticks=_NO_TICKS, size=_AXIS_PX)),
                height=_HEIGHT_PX,
            )
            for title, lines in _SERIES.items()
        }

    def check_due(self, now_s: float) -> bool:
        """Return whether the charts are due; schedule the next update."""
        if now_s < self._due_s:
            return False
        self._due_s = now_s + _PERIOD_S
        return True

    def update(self, series: TrafficSeries) -> None:
        """Update the chart data."""
        if len(series.t_s) < 2:
            return
        for title, lines in _SERIES.items():
            columns: list[NDArray[np.float64]] = [getattr(series, name) for _, _, name in lines]
            known = np.isfinite(columns[0])
            if known.any():
                self._charts[title].data = (series.t_s[known], *(column[known] for column in columns))


def _line(name: str, colour: str) -> uplot.Series:
    return uplot.Series(label=name, stroke=colour, width=1.5)
