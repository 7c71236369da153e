"""Process table panel: cores, memory and real-time factor of each process, and statistics of the page."""

import html
from collections.abc import Mapping

from skinnet.view.state.process_stats import ProcessStats, ProcessUsage

__all__ = ["render"]

_STYLE = (
    "<style>.sk-proc{border-collapse:collapse;width:calc(100% - 16px);margin:6px 8px}"
    ".sk-proc td,.sk-proc th{padding:3px 8px;font-size:12.5px;text-align:right;"
    "border-bottom:1px solid #e6ebef;color:#1f2d3d;font-variant-numeric:tabular-nums}"
    ".sk-proc th{color:#5b6b7a;font-weight:500}"
    ".sk-proc td:first-child,.sk-proc th:first-child{text-align:left}"
    ".sk-bar{display:inline-block;height:8px;border-radius:2px;background:#4b8fd6;vertical-align:middle;"
    "margin-right:6px}</style>"
)
_BAR_PX = 70


def render(processes: ProcessStats, page_statistics: Mapping[str, str]) -> str:
    """Process table as HTML, followed by the page's own statistics `page_statistics`, by name."""
    rows = "".join(_row(process) for process in processes.processes.values())
    if not rows:
        rows = '<tr><td colspan="5">no process statistics received yet</td></tr>'
    facts = "".join(
        f"<tr><td>{html.escape(name)}</td><td>{html.escape(value)}</td></tr>"
        for name, value in page_statistics.items()
    )
    return (
        f'{_STYLE}<table class="sk-proc"><thead><tr><th>process</th><th>pid</th><th>cores</th><th>memory</th>'
        f"<th>× real time</th></tr></thead><tbody>{rows}</tbody></table>"
        f'<table class="sk-proc"><thead><tr><th>this page</th><th></th></tr></thead>'
        f"<tbody>{facts}</tbody></table>"
    )


def _row(process: ProcessUsage) -> str:
    cores = "" if process.cores is None else f"{process.cores:.2f}"
    width = _BAR_PX * min(process.cores or 0.0, 1.0)
    memory = (
        "" if process.memory_mb is None else f"{process.memory_mb:.0f} MB" if process.memory_mb else "gone"
    )
    rate = "" if process.real_time_factor is None else f"{process.real_time_factor:.2f}"
    return (
        f"<tr><td>{html.escape(process.name)}</td><td>{process.pid or ''}</td>"
        f'<td><span class="sk-bar" style="width:{width:.0f}px"></span>{cores}</td>'
        f"<td>{memory}</td><td>{rate}</td></tr>"
    )
