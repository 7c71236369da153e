"""Documentation of the schema: descriptions, units and defaults of keys, read from the code itself."""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from functools import cache
from types import MappingProxyType
from typing import Any

from msgspec import Struct, to_builtins
from msgspec import inspect as reflect

__all__ = ["attribute_docs", "tables", "toml_value", "unit_of"]

_UNITS = (
    ("_nm_per_rad", "N·m/rad"),
    ("_nm_s_per_rad", "N·m·s/rad"),
    ("_pa_per_m", "Pa/m"),
    ("_pa_s_per_m", "Pa·s/m"),
    ("_rad_s2", "rad/s²"),
    ("_m_s2", "m/s²"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("bits_per_s", "bit/s"),
    ("_per_s", "1/s"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_nm", "N·m"),
    ("_hz", "Hz"),
    ("_kpa", "kPa"),
    ("_kg", "kg"),
    ("_mm", "mm"),
    ("_ma", "mA"),
    ("_ohm", "Ω"),
    ("_ms", "ms"),
    ("_us", "µs"),
    ("_bytes", "bytes"),
    ("_s", "s"),
    ("_m", "m"),
    ("_n", "N"),
    ("_g", "g"),
    ("_c", "°C"),
    ("_v", "V"),
)
"""Units by the end of a key, the longer ends before the shorter."""


def unit_of(key: str) -> str | None:
    """Return the unit that the name of a key ends with; None if it has none."""
    return next((unit for end, unit in _UNITS if key.endswith(end)), None)


@cache
def attribute_docs(kind: type) -> MappingProxyType[str, str]:
    """Collect the docstrings below the attributes of a class and its bases, which only the source has."""
    docs: dict[str, str] = {}
    for part in reversed(kind.__mro__):
        if part.__module__.partition(".")[0] == "skinnet":
            docs |= _own_attribute_docs(part)
    return MappingProxyType(docs)


def tables(path: str, kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield every table inside a type with its dotted name, outer ones first; `[]` stands for entries."""
    match kind:
        case reflect.StructType():
            yield path, kind
            for field in kind.fields:
                yield from tables(f"{path}.{field.name}".lstrip("."), field.type)
        case reflect.VarTupleType():
            yield from tables(f"{path}[]", kind.item_type)
        case reflect.DictType():
            yield from tables(f"{path}[]", kind.value_type)
        case reflect.UnionType():
            for part in kind.types:
                yield from tables(path, part)
        case _:
            pass


def toml_value(value: Any) -> str:
    """Format a default value as TOML."""
    match value:
        case bool():
            return str(value).lower()
        case float() | int():
            return str(value)
        case str():
            return f'"{value}"'
        case Struct():
            return toml_value(to_builtins(value))
        case dict():
            return "{ " + ", ".join(f"{key} = {toml_value(item)}" for key, item in value.items()) + " }"
        case _:
            return "[" + ", ".join(map(toml_value, value)) + "]"


def _own_attribute_docs(kind: type) -> dict[str, str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(tree, ast.ClassDef)
    docs = {}
    for field, below in zip(tree.body, tree.body[1:], strict=False):
        target: ast.expr | None = None
        if isinstance(field, ast.AnnAssign):
            target = field.target
        elif isinstance(field, ast.Assign):
            target = field.targets[0]
        text = below.value if isinstance(below, ast.Expr) else None
        if isinstance(target, ast.Name) and isinstance(text, ast.Constant) and isinstance(text.value, str):
            docs[target.id] = inspect.cleandoc(text.value)
    return docs
