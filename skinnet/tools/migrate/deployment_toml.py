"""Deployment files of earlier formats rewritten with their comments, order and layout."""

import tomllib
from typing import Any

from skinnet.deployment.extends import EXTENDS
from skinnet.errors import FormatError
from skinnet.migration.deployments import FORMAT, FORMAT_KEY, renames, require_known, translate
from skinnet.tools.migrate.toml_tokens import tokens_of

__all__ = ["migrated_toml"]


def migrated_toml(text: str, source: str) -> str:
    """The text of a deployment in the present format; comments, order and layout stay.

    Raises:
        FormatError: a newer format, no TOML, or an old key beside its new name.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"{source}: no valid TOML: {error}") from error
    if require_known(raw, source) == FORMAT:
        return text
    expected, _ = translate(raw, source)
    own = {key: value for key, value in raw.items() if key not in (FORMAT_KEY, EXTENDS)}
    changes = {path: (name, value) for path, name, value in renames(own)}
    parts: list[str] = []
    end = 0
    for token in tokens_of(text):
        name, value = changes.get(token.path, (None, None))
        new = name if token.is_key else _changed_string(text[token.start : token.end], value)
        if new is not None:
            parts += (text[end : token.start], new)
            end = token.end
    migrated = _with_format("".join((*parts, text[end:])), has_format=FORMAT_KEY in raw)
    assert translate(tomllib.loads(migrated), source)[0] == expected
    return migrated


def _changed_string(written: str, value: Any) -> str | None:
    """TOML text of a string that differs from the written one; None if it does not."""
    if not isinstance(value, str) or tomllib.loads(f"x = {written}")["x"] == value:
        return None
    return f'"{value}"'


def _with_format(text: str, *, has_format: bool) -> str:
    """State the format before the first key, after the comment at the head of the file."""
    lines = text.split("\n")
    if has_format:
        del lines[next(i for i, line in enumerate(lines) if line.partition("=")[0].strip() == FORMAT_KEY)]
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), 0)
    head = lines[:first]
    while head and not head[-1].strip():
        head.pop()
    return "\n".join([*head, *([""] if head else []), f"{FORMAT_KEY} = {FORMAT}", *lines[first:]])
