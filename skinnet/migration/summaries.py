"""Summaries of runs and sweeps by earlier versions, translated to the present format."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from skinnet.errors import FormatError
from skinnet.migration import deployments
from skinnet.migration.format_1 import (
    COUNTERS,
    ENCODING_METRIC,
    ENCODINGS,
    METRICS,
    POINT,
    PROCESS_FAILURE_KEYS,
    STRESS_METRICS,
    SUMMARY_KEYS,
)
from skinnet.migration.renaming import rename_keys

__all__ = ["FORMAT", "current_metric", "current_point", "translate_summary"]

FORMAT = 2
"""Format of summaries, of runs and of sweeps; format 1 has no key that says so."""
_FORMAT_KEY = "format"
_STRESS = "stress"
_PATTERNS = tuple((re.compile(old), new) for old, new in (*METRICS, *STRESS_METRICS))
_POINT = re.compile(POINT)
_ENCODING_METRIC = re.compile(ENCODING_METRIC)
_POINT_METRIC = re.compile(rf"{POINT}(\.[a-z].*)")


@cache
def current_metric(name: str) -> str:
    """Present name of a metric of format 1."""
    for pattern, new in _PATTERNS:
        if pattern.fullmatch(name):
            name = pattern.sub(new, name)
    if match := _POINT_METRIC.fullmatch(name):
        return f"{match[1]}{ENCODINGS[match[2]]}{match[3]}{match[4]}"
    if match := _ENCODING_METRIC.fullmatch(name):
        return f"{ENCODINGS[match[1]]}{match[2]}"
    return name


def current_point(name: str) -> str:
    """Present name of a point of a sweep of format 1, such as `c260-send_on_delta-s0.1`."""
    match = _POINT.fullmatch(name)
    return f"{match[1]}{ENCODINGS[match[2]]}{match[3]}" if match else name


def translate_summary(raw: Mapping[str, Any], source: str) -> tuple[dict[str, Any], int | None]:
    """Translate a summary of any known format; return it and the number of new names, None if it is new.

    Args:
        raw: Content of `summary.json`, of one run or of several seeds, or of `stress.json`.
        source: Name of the file in errors.

    Raises:
        FormatError: a newer format, or an old name stands beside its new one.
    """
    if _require_known(raw, source) == FORMAT:
        return dict(raw), None
    translation = _Translation(source)
    return translation.of_file(raw), translation.n_renamed


def _require_known(raw: Mapping[str, Any], source: str) -> int:
    version = raw.get(_FORMAT_KEY, 1)
    if isinstance(version, bool) or version not in (1, FORMAT):
        raise FormatError(
            f"{source}: {_FORMAT_KEY} = {version!r}: this program reads up to {FORMAT}; "
            "update it to read this file"
        )
    return int(version)


class _Translation:
    """Translation of one file, with the count of its new names."""

    def __init__(self, source: str) -> None:
        self._source = source
        self.n_renamed = 0

    def of_file(self, raw: Mapping[str, Any]) -> dict[str, Any]:
        """Translate a summary that may be of the present format, as each of several seeds says itself."""
        if _require_known(raw, self._source) == FORMAT:
            return dict(raw)
        rest = {key: value for key, value in raw.items() if key != _FORMAT_KEY}
        return {_FORMAT_KEY: FORMAT} | self._of_summary(rest)

    def _of_summary(self, raw: Mapping[str, Any]) -> dict[str, Any]:
        summary = self._renamed(raw, SUMMARY_KEYS)
        match summary:
            case {"metrics": dict() as metrics}:
                summary["metrics"] = self._renamed(metrics, {name: current_metric(name) for name in metrics})
        match summary:
            case {"counters": dict() as counters}:
                summary["counters"] = {
                    process: self._renamed(counts, COUNTERS) for process, counts in counters.items()
                }
        match summary:
            case {"process_failures": list() as failures}:
                summary["process_failures"] = [
                    self._renamed(failure, PROCESS_FAILURE_KEYS) for failure in failures
                ]
        match summary:
            case {"runs": list() as runs}:
                summary["runs"] = [self.of_file(run) if isinstance(run, dict) else run for run in runs]
        match summary:
            case {"settings": list() as settings}:
                summary["settings"] = [self._setting(setting) for setting in settings]
        return self._of_sweep(summary) if _STRESS in summary else summary

    def _of_sweep(self, summary: dict[str, Any]) -> dict[str, Any]:
        document, changes = deployments.translate({_STRESS: summary[_STRESS]}, self._source)
        self.n_renamed += changes
        points = [self._named(name, current_point(name)) for name in summary.get("points", ())]
        failed = rename_keys(summary.get("failed", {}), current_point, self._source)
        return summary | document | {"points": points, "failed": failed}

    def _setting(self, setting: str) -> str:
        key, equals, value = setting.partition("=")
        new = deployments.current_name(key.strip())
        return self._named(setting, f"{new}{equals}{value}" if new else setting)

    def _named(self, old: str, new: str) -> str:
        self.n_renamed += new != old
        return new

    def _renamed(self, table: Any, names: Mapping[str, str]) -> Any:
        if not isinstance(table, Mapping):
            return table
        self.n_renamed += sum(names.get(key, key) != key for key in table)
        return rename_keys(table, lambda key: names.get(key, key), self._source)
