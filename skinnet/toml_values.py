"""TOML text of values, keys and comments: the way back of `tomllib`, which only reads."""

import re
from typing import Any

__all__ = ["plain_line", "toml_comment", "toml_key", "toml_value"]

_MAX_COLUMNS = 110

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_value(value: Any) -> str:
    """Write a value as TOML, tables inline.

    Raises:
        TypeError: TOML has no such value.
    """
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            return _toml_string(value)
        case dict() if not value:
            return "{}"
        case dict():
            return (
                "{ "
                + ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items())
                + " }"
            )
        case list() | tuple():
            return "[" + ", ".join(map(toml_value, value)) + "]"
    raise TypeError(f"no TOML for {value!r}")


def toml_key(name: str) -> str:
    """Write a key, quoted where TOML asks for it."""
    return name if _BARE.fullmatch(name) else _toml_string(name)


def toml_comment(text: str) -> list[str]:
    """Write a text as comment lines, wrapped at 110 columns."""
    lines, current = [], "#"
    for word in plain_line(text).split(" "):
        if len(current) + 1 + len(word) > _MAX_COLUMNS and current != "#":
            lines.append(current)
            current = "#"
        current += f" {word}"
    return [*lines, current]


def plain_line(text: str) -> str:
    """Text on one line, as a comment and a terminal ask for: ? stands for each control character."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _toml_string(value: str) -> str:
    """TOML basic string; characters that TOML forbids are escaped by code point."""
    escapes = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    written = (escapes.get(c, c if c.isprintable() or c == " " else f"\\U{ord(c):08x}") for c in value)
    return f'"{"".join(written)}"'
