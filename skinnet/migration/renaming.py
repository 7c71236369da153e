"""Renaming of the keys of tables, which drops nothing, and the remark about a file of an earlier format."""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from skinnet.errors import FormatError

__all__ = ["remark_old_format", "rename_keys"]

log = logging.getLogger(__name__)

T = TypeVar("T")
_remarked: set[Path] = set()
"""Files that this process has remarked upon: several parts of a run may read the same one."""


def rename_keys(table: Mapping[str, T], current_name: Callable[[str], str], source: str) -> dict[str, T]:
    """Rename the keys of a table; order and values stay.

    Raises:
        FormatError: an old name stands beside its new one, so one value would be lost.
    """
    renamed: dict[str, T] = {}
    for old, value in table.items():
        new = current_name(old)
        if new in renamed or (new != old and new in table):
            raise FormatError(f"{source}: {old} is called {new} now; give only one of the two")
        renamed[new] = value
    return renamed


def remark_old_format(path: Path, content: str) -> None:
    """Log that a file is of an earlier format: one line for each file and process."""
    file = path.resolve()
    if file not in _remarked:
        _remarked.add(file)
        log.warning(
            "%s: %s of an earlier format, read by its present names; skinnet migrate rewrites it",
            path,
            content,
        )
