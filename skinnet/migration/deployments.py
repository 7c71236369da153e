"""Deployments of earlier formats, translated key by key to the present one."""

import copy
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from skinnet.errors import FormatError
from skinnet.migration.format_1 import DEPLOYMENT_KEYS, DEPLOYMENT_VALUES

__all__ = [
    "FORMAT",
    "FORMAT_KEY",
    "Renamed",
    "current_name",
    "current_process",
    "forget_names",
    "has_default_processes",
    "renames",
    "require_known",
    "translate",
]

FORMAT = 2
"""Format of deployments; format 1 has no key that says so."""
FORMAT_KEY = "format"
_ENTRY = "[]"
_NAMED_PROCESSES = "hosts"
_PROCESS_NAME = re.compile(r"host([0-9]+)")
_PROCESS_LISTS = ("run.may_be_lost[]", "faults[].target")

Path = tuple[str | int, ...]
"""Steps to a value: keys of tables, indices of lists."""
Renamed = tuple[Path, str | None, Any]
"""Old path, the key's new name (None: it stays), and the new value (the old one: it stays)."""


def require_known(raw: Mapping[str, Any], source: str) -> int:
    """Format of a deployment document.

    Raises:
        FormatError: a newer format, or something that is no format.
    """
    version = raw.get(FORMAT_KEY, 1)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise FormatError(f"{source}: {FORMAT_KEY} = {version!r}: give {FORMAT}")
    if version > FORMAT:
        raise FormatError(
            f"{source}: {FORMAT_KEY} = {version}: this program reads up to {FORMAT}; "
            "update it to read this file"
        )
    return version


def translate(raw: Mapping[str, Any], source: str) -> tuple[dict[str, Any], int]:
    """Translate a document of any known format to the present one; return it and the number of changes.

    The key that names the format is taken out.

    Raises:
        FormatError: as `require_known`; or an old key stands beside its new name.
    """
    version = require_known(raw, source)
    document = copy.deepcopy({key: value for key, value in raw.items() if key != FORMAT_KEY})
    if version == FORMAT:
        return document, 0
    changes = list(renames(document))
    for path, name, value in reversed(changes):  # the deepest first: paths are those of the old document
        table = _table_at(document, path[:-1])
        table[path[-1]] = value
        if name is not None:
            if name in table:
                raise FormatError(f"{source}: {_dotted(path)} is called {name} now; give only one of the two")
            _rename(table, str(path[-1]), name)
    return document, len(changes)


def renames(document: Mapping[str, Any]) -> Iterator[Renamed]:
    """All that a document of format 1 says otherwise, in its own order, tables before what is in them."""
    default_names = has_default_processes(document)
    for path, value in _walk(document, ()):
        new_name = _new_name(_pattern(path))
        new_value = value
        if isinstance(value, str):
            new_value = _new_value(_pattern(path), value)
            if default_names and _matches(_pattern(path), _PROCESS_LISTS):
                new_value = current_process(value)
        if new_name is not None or new_value != value:
            yield path, new_name, new_value


def has_default_processes(document: Mapping[str, Any]) -> bool:
    """Test whether a document of format 1 leaves the names of its cell processes to the program."""
    return not isinstance(document.get(_NAMED_PROCESSES), dict)


def current_process(name: str) -> str:
    """Present name of a cell process that the program named."""
    return _PROCESS_NAME.sub(r"cells\1", name) if _PROCESS_NAME.fullmatch(name) else name


def current_name(path: str) -> str | None:
    """Present path of a dotted key of format 1 (entries of lists by number or name); None if it stays."""
    steps = tuple(step if not step.isdecimal() else _ENTRY for step in path.split("."))
    named: list[str] = []
    changed = False
    for depth in range(1, len(steps) + 1):
        new = _new_name(_joined(steps[:depth])) or _new_name(_joined(_as_entries(steps[:depth])))
        named.append(new or path.split(".")[depth - 1])
        changed |= new is not None
    return ".".join(named) if changed else None


def _as_entries(steps: tuple[str, ...]) -> tuple[str, ...]:
    """Steps in which the name of a list's entry, as in `patches.torso.body`, stands for its number."""
    lists = {key.split(_ENTRY)[0] for key in DEPLOYMENT_KEYS if _ENTRY in key}
    return tuple(
        _ENTRY if depth and ".".join(steps[:depth]) in lists else step for depth, step in enumerate(steps)
    )


def _walk(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    items = value.items() if isinstance(value, Mapping) else enumerate(value)
    for step, item in items:
        yield (*path, step), item
        if isinstance(item, Mapping | list):
            yield from _walk(item, (*path, step))


def _pattern(path: Path) -> str:
    return _joined(tuple(_ENTRY if isinstance(step, int) else step for step in path))


def _joined(steps: tuple[str, ...]) -> str:
    return ".".join(steps).replace(f".{_ENTRY}", _ENTRY)


def _dotted(path: Path) -> str:
    return ".".join(map(str, path))


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile(re.escape(pattern).replace(r"\*", r"[^.\[]+"))


def _matches(path: str, patterns: tuple[str, ...]) -> bool:
    return any(_compiled(pattern).fullmatch(path) for pattern in patterns)


@cache
def _new_name(path: str) -> str | None:
    return next((new for old, new in DEPLOYMENT_KEYS.items() if _compiled(old).fullmatch(path)), None)


def forget_names() -> None:
    """Forget the names found so far, for a vocabulary that has changed."""
    _new_name.cache_clear()


def _new_value(path: str, value: str) -> str:
    for old, values in DEPLOYMENT_VALUES.items():
        if _compiled(old).fullmatch(path):
            return values.get(value, value)
    return value


def _table_at(document: dict[str, Any], path: Path) -> Any:
    node: Any = document
    for step in path:
        node = node[step]
    return node


def _rename(table: dict[str, Any], old: str, new: str) -> None:
    """Rename a key in place, without changing the order of keys."""
    items = [(new if key == old else key, value) for key, value in table.items()]
    table.clear()
    table.update(items)
