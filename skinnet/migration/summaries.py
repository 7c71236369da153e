"""Summaries of runs by earlier versions, translated to the present format."""

import re
from functools import cache
from typing import Any

from skinnet.errors import FormatError
from skinnet.migration.format_1 import COUNTERS, METRICS, PROCESS_FAILURE_KEYS, SUMMARY_KEYS

__all__ = ["FORMAT", "current_metric", "translate_summary"]

FORMAT = 2
"""Format of summaries; format 1 has no key that says so."""
_PATTERNS = tuple((re.compile(old), new) for old, new in METRICS)


@cache
def current_metric(name: str) -> str:
    """Present name of a metric of format 1."""
    for pattern, new in _PATTERNS:
        if pattern.fullmatch(name):
            name = pattern.sub(new, name).lstrip(".")
    return name


def translate_summary(raw: dict[str, Any], source: str) -> tuple[dict[str, Any], bool]:
    """Translate a summary of any known format; return it and whether it was an old one.

    Raises:
        FormatError: a newer format.
    """
    version = raw.get("format", 1)
    if version == FORMAT:
        return raw, False
    if version != 1:
        raise FormatError(
            f"{source}: format = {version!r}: this program reads up to {FORMAT}; update it to read this file"
        )
    return {"format": FORMAT} | _translated(raw), True


def _translated(raw: dict[str, Any]) -> dict[str, Any]:
    summary = {SUMMARY_KEYS.get(key, key): value for key, value in raw.items()}
    if isinstance(metrics := summary.get("metrics"), dict):
        summary["metrics"] = {current_metric(name): value for name, value in metrics.items()}
    if isinstance(failures := summary.get("process_failures"), list):
        summary["process_failures"] = [
            {PROCESS_FAILURE_KEYS.get(key, key): value for key, value in failure.items()}
            for failure in failures
            if isinstance(failure, dict)
        ]
    if isinstance(counters := summary.get("counters"), dict):
        summary["counters"] = {
            process: {COUNTERS.get(name, name): count for name, count in counts.items()}
            for process, counts in counters.items()
        }
    if isinstance(runs := summary.get("runs"), list):
        summary["runs"] = [_translated(run) for run in runs if isinstance(run, dict)]
    return summary
