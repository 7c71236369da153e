"""Rewriting of files of earlier formats: deployments with their comments, memories, recordings, summaries."""

import tomllib
from typing import Any

import tomlkit
from tomlkit.container import Container
from tomlkit.items import AbstractTable, AoT, Array, InlineTable, Item, SingleKey, String

from skinnet.deployment.extends import EXTENDS
from skinnet.errors import FormatError
from skinnet.migration.deployments import FORMAT, FORMAT_KEY, renames, require_known, translate
from skinnet.migration.deployments import Path as KeyPath

__all__ = ["migrated_toml"]


def migrated_toml(text: str, source: str) -> str:
    """The text of a deployment in the present format; comments, order and layout stay.

    Raises:
        FormatError: a newer format, or no TOML.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"{source}: no valid TOML: {error}") from error
    if require_known(raw, source) == FORMAT:
        return text
    plain = {key: value for key, value in raw.items() if key not in (FORMAT_KEY, EXTENDS)}
    document = tomlkit.parse(text)
    _rename_in(document, (), {path: (name, value) for path, name, value in renames(plain)})
    migrated = _with_format(tomlkit.dumps(document))
    expected, _ = translate(raw, source)
    found, _ = translate(tomllib.loads(migrated), source)
    if found != expected:
        raise FormatError(f"{source}: cannot be rewritten without losing its layout; rename the keys by hand")
    return migrated


def _with_format(text: str) -> str:
    """Add the format before the first key, after the comment at the head of the file."""
    lines = text.split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), 0)
    head = lines[:first]
    while head and not head[-1].strip():
        head.pop()
    return "\n".join([*head, *([""] if head else []), f"{FORMAT_KEY} = {FORMAT}", *lines[first:]])


def _rename_in(container: Any, path: KeyPath, changes: dict[KeyPath, tuple[str | None, Any]]) -> None:
    body = container.body if isinstance(container, Container) else container.value.body
    owner = container if isinstance(container, Container) else container.value
    for index, (key, item) in enumerate(body):
        if key is None:
            continue
        own = (*path, key.key)
        _rename_below(item, own, changes)
        name, value = changes.get(own, (None, None))
        if isinstance(item, String) and isinstance(value, str) and value != str(item):
            item = _replaced(item, value)
            body[index] = (key, item)
        if name is not None:
            written = key.as_string()
            original = name + written[len(written.rstrip()) :]
            new = SingleKey(
                name, t=key.t if isinstance(key, SingleKey) else None, sep=key.sep, original=original
            )
            new._dotted = key._dotted
            body[index] = (new, item)
            positions = owner._map.pop(key)
            owner._map[new] = positions


def _rename_below(item: Any, path: KeyPath, changes: dict[KeyPath, tuple[str | None, Any]]) -> None:
    if isinstance(item, AoT):
        for index, table in enumerate(item.body):
            _rename_in(table, (*path, index), changes)
            table.display_name = None
    elif isinstance(item, Array):
        for index, value in enumerate(item):
            own = (*path, index)
            if isinstance(value, InlineTable):
                _rename_in(value, own, changes)
            elif own in changes and isinstance(value, String):
                item[index] = changes[own][1]
    elif isinstance(item, AbstractTable):
        _rename_in(item, path, changes)
        if hasattr(item, "display_name"):
            item.display_name = None


def _replaced(item: String, value: str) -> Item:
    new = tomlkit.item(value)
    new.trivia.indent, new.trivia.comment_ws = item.trivia.indent, item.trivia.comment_ws
    new.trivia.comment, new.trivia.trail = item.trivia.comment, item.trivia.trail
    return new
