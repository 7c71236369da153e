"""TOML listing of a deployment as it was run, with the default beside each key that differs.

Tables have every key. Entries of lists and of tables by name (patches, stages, faults) have only keys that
differ from the defaults of their kind, as one would write them. All lines together are a deployment.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from msgspec import NODEFAULT, UNSET, Struct, to_builtins
from msgspec.structs import FieldInfo, fields

from skinnet.deployment import Deployment
from skinnet.toml_values import toml_key, toml_value

__all__ = ["Line", "Section", "sections", "toml_tables"]

_MAX_COLUMNS = 96
_REQUIRED = object()


@dataclass(frozen=True)
class Line:
    """One line of TOML.

    Attributes:
        text: Text of the line.
        differs: True if the value is not the default.
        default: Default value as TOML, if there is one and the value differs from it.
    """

    text: str
    differs: bool = False
    default: str = ""


@dataclass(frozen=True)
class Section:
    """Section of a TOML listing: title, note on how many keys were set, and lines."""

    title: str
    note: str
    lines: tuple[Line, ...]


def sections(deployment: Deployment) -> list[Section]:
    """List the deployment in sections: plain keys, then lists of tables, then tables, in their order."""
    head, lists, tables = [], [], []
    for field in fields(deployment):
        value, default = getattr(deployment, field.name), _default(field)
        if isinstance(value, Struct):
            tables.append(_section(f"[{field.name}]", _table_lines(field.name, value, default)))
        elif isinstance(value, tuple) and value and isinstance(value[0], Struct):
            lists.append(
                Section(field.name, f"{len(value)} set", tuple(_key_lines(field.name, value, default)))
            )
        else:
            head += _key_lines(field.name, value, default)
    return [_section("general", head), *lists, *tables]


def toml_tables(name: str, entries: Sequence[Struct]) -> list[str]:
    """Lines of a list of tables `name` with the keys that differ from the defaults of their kind."""
    return [line.text for line in _key_lines(name, tuple(entries), _REQUIRED)]


def _section(title: str, lines: Iterable[Line]) -> Section:
    kept = tuple(lines)
    differing = sum(line.differs and line.text[0] not in " []" for line in kept if line.text)
    return Section(title, f"{differing} set" if differing else "defaults", kept)


def _default(field: FieldInfo) -> Any:
    if field.default is not NODEFAULT and field.default is not UNSET:
        return field.default
    return field.default_factory() if field.default_factory is not NODEFAULT else _REQUIRED


def _table_lines(path: str, table: Struct, default: Any) -> Iterator[Line]:
    """Lines of a table with all its keys, nested tables last."""
    yield Line(f"[{path}]", not isinstance(default, Struct))
    within = []
    for field in fields(table):
        value, usual = getattr(table, field.name), _default(field)
        if isinstance(default, Struct):  # the enclosing table's default overrides that of this kind
            usual = getattr(default, field.name)
        if isinstance(value, Struct) or (isinstance(value, dict) and value):
            within.append((field.name, value, usual))
        else:
            yield from _key_lines(field.name, value, usual)
    for name, value, usual in within:
        yield Line("")
        if isinstance(value, Struct):
            yield from _table_lines(f"{path}.{name}", value, usual)
        else:
            yield Line(f"[{path}.{name}]", value != usual)
            for key, item in value.items():
                yield from _key_lines(key, item, _REQUIRED)


def _key_lines(name: str, value: Any, default: Any) -> list[Line]:
    """Lines of a key and its value; a list too long for one line spans several."""
    differs = default is _REQUIRED or value != default
    if value is None:
        return [Line(f"# {toml_key(name)}: none", differs)]
    written = _to_builtins(value)
    text = f"{toml_key(name)} = {toml_value(written)}"
    if isinstance(written, list) and len(text) > _MAX_COLUMNS:
        rows = [f"  {row}," for row in _rows(written)]
        return [Line(row, differs) for row in (f"{toml_key(name)} = [", *rows, "]")]
    told = differs and default is not _REQUIRED and default not in (None, (), {}, "")
    return [Line(text, differs, toml_value(to_builtins(default)) if told else "")]


def _rows(values: list[Any]) -> list[str]:
    """Rows of a long list: tables one a line, other entries as many as fit."""
    texts = [toml_value(value) for value in values]
    rows = [texts[0]]
    for value, text in zip(values[1:], texts[1:], strict=True):
        joined = f"{rows[-1]}, {text}"
        if isinstance(value, dict) or len(joined) > _MAX_COLUMNS:
            rows.append(text)
        else:
            rows[-1] = joined
    return rows


def _to_builtins(value: Any) -> Any:
    """Builtin form of a value; tables have only keys that differ from their defaults."""
    match value:
        case Struct():
            tag = value.__struct_config__.tag
            own = {value.__struct_config__.tag_field: tag} if tag is not None else {}
            for field in fields(value):
                item = getattr(value, field.name)
                if item is not None and item != _default(field):
                    own[field.encode_name] = _to_builtins(item)
            return own
        case tuple() | list():
            return [_to_builtins(item) for item in value]
        case dict():
            return {key: _to_builtins(item) for key, item in value.items()}
        case _:
            return to_builtins(value)
