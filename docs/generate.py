"""Fills the generated parts of the pages of docs/: `python docs/generate.py`.

A part stands between `<!-- generated: NAME -->` and `<!-- end -->`; the text around it is written by hand.
A test fails while a page is behind the code.
"""

import inspect
import math
import re
from collections.abc import Iterable
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import NODEFAULT
from msgspec import inspect as reflect

from controller.grasping.state_machine import State, mermaid_diagram
from controller.grasping.state_parameters import (
    Area,
    ReactionParameters,
    StateParameters,
    merge_state_parameters,
)
from skinnet.deployment.controller.teach_and_grasp import TeachAndGraspSpec
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.documentation import attribute_docs, tables, toml_value
from skinnet.migration import format_1
from skinnet.protocol.channels import ALIVE, CHANNELS, Keys, Role
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.protocol.messages import READING_NAMES, STIMULUS_NAMES, STREAM_ROW, EventKind, Modality
from skinnet.protocol.sheet_messages import PATTERN_ROW, REGION_ROW, SCAN_FRAME_ROW

__all__ = ["PAGES", "defaults", "fill", "marked", "toml_value"]

_HERE = Path(__file__).parent
PAGES = (
    _HERE / "deployment.md",
    _HERE / "grasping.md",
    _HERE / "wire.md",
    _HERE / "reference" / "formats.md",
)
_PART = re.compile(r"(<!-- generated: (?P<name>\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_COMMANDING = [
    state
    for state in State
    if any(any(own) for own in merge_state_parameters(TeachAndGraspSpec())[state].reactions.values())
]
_NAME_PATTERN = r"^[A-Za-z0-9_\-]+$"


def fill(page: str) -> str:
    """The text of a page with its generated parts made anew."""
    return _PART.sub(lambda part: f"{part[1]}\n{_MAKERS[part['name']]()}\n{part[3]}", page)


def defaults() -> dict[str, Any]:
    """Default of every key of a deployment by its dotted name; entries of lists and tables go by `[]`."""
    return {
        f"{path}.{field.name}".lstrip("."): field.default
        for path, struct in tables("", reflect.type_info(Deployment))
        for field in struct.fields
    }


def marked() -> set[str]:
    """Dotted names of the tables and keys whose own words say that they are assumed."""
    found = set()
    for path, struct in tables("", reflect.type_info(Deployment)):
        if "assumed" in (inspect.getdoc(struct.cls) or ""):
            found.add(path)
        found |= {f"{path}.{name}" for name, doc in attribute_docs(struct.cls).items() if "assumed" in doc}
    return found


def _schema() -> str:
    parts = []
    for path, struct in tables("", reflect.type_info(Deployment)):
        assert isinstance(struct, reflect.StructType)
        title = f"`[{path}]`" if path else "Top level"
        if struct.tag_field is not None:
            title += f" with `{struct.tag_field} = {toml_value(struct.tag)}`"
        docs = attribute_docs(struct.cls)
        rows = (
            (f"`{field.name}`", _kind(field.type), _default(field), docs.get(field.name, ""))
            for field in struct.fields
        )
        head = f"### {title}\n\n{inspect.getdoc(struct.cls)}\n"
        parts.append(f"{head}\n{_table(('key', 'type', 'default', 'meaning'), rows)}")
    return "\n".join(parts)


def _channels() -> str:
    prefix = "skinnet/<robot>/"
    rows = [
        (
            f"`{prefix}{row.pattern}`",
            f"[{row.message.__name__}](#{row.message.__name__.lower()})",
            row.sender_name,
            ", ".join(role.value for role in row.receivers),
            row.period,
            "yes" if row.public else "",
            "yes" if row.recorded else "",
        )
        for row in CHANNELS
    ]
    roles = ", ".join(role.value for role in Role if role is not Role.LAUNCHER)
    told = f"[{DeploymentInfo.__name__}](#{DeploymentInfo.__name__.lower()})"
    rows.append((f"`{Keys('<robot>').deployment}`", told, "launcher", "", "when asked", "yes", ""))
    rows.append((f"`{prefix}{ALIVE}/<role>/<name>`", "liveliness token", roles, "all", "on change", "", ""))
    return _table(("key", "message", "from", "to", "period", "observers", "recorded"), rows)


def _messages() -> str:
    parts = []
    for kind in dict.fromkeys([*(row.message for row in CHANNELS), DeploymentInfo]):
        struct = reflect.type_info(kind)
        assert isinstance(struct, reflect.StructType)
        rows = ((f"`{f.name}`", _kind(f.type), _default(f)) for f in struct.fields)
        tag = f"`{struct.tag_field}` is `{toml_value(struct.tag)}`."
        head = f"### {kind.__name__}\n\n{inspect.getdoc(kind)}\n\n{tag}\n"
        parts.append(f"{head}\n{_table(('field', 'type', 'default'), rows)}")
    return "\n".join(parts)


def _stream_row() -> str:
    return _record(STREAM_ROW)


def _sheet_rows() -> str:
    records = (("SCAN_FRAME_ROW", SCAN_FRAME_ROW), ("REGION_ROW", REGION_ROW), ("PATTERN_ROW", PATTERN_ROW))
    return "\n\n".join(f"`{name}`, {row.itemsize} bytes:\n\n{_record(row)}" for name, row in records)


def _record(row: np.dtype[Any]) -> str:
    fields = row.fields
    assert fields is not None
    rows = []
    for name in row.names or ():
        dtype, offset = fields[name][:2]
        count = int(np.prod(dtype.shape))
        rows.append((str(offset), f"`{name}`", dtype.base.str, str(count), str(dtype.itemsize)))
    return _table(("offset", "field", "type", "count", "bytes"), rows)


def _columns() -> str:
    rows = (
        (str(i), f"`{s}`", f"`{r}`")
        for i, (s, r) in enumerate(zip(STIMULUS_NAMES, READING_NAMES, strict=True))
    )
    return _table(("column", "stimulus", "reading"), rows)


def _numbers() -> str:
    kinds: tuple[tuple[str, type[IntEnum]], ...] = (("modality", Modality), ("kind", EventKind))
    rows = (
        (f"`{column}`", str(int(member)), member.name.lower(), attribute_docs(kind).get(member.name, ""))
        for column, kind in kinds
        for member in kind
    )
    return _table(("column", "number", "name", "meaning"), rows)


def _states() -> str:
    return f"```mermaid\n{mermaid_diagram()}```\n"


def _directives() -> str:
    """Table II as the code has it."""
    head = ("state", "force CA", "CHA", "NCA", "proximity CA", "CHA", "NCA", "pose", "rad/s", "times out [s]")
    return _table(
        head,
        (
            _directive(*row)
            for row in merge_state_parameters(TeachAndGraspSpec()).items()
            if row[0] in _COMMANDING
        ),
    )


def _directive(state: State, directive: StateParameters) -> tuple[str, ...]:
    gains = [
        directive.reactions.get(area, ReactionParameters()) for area in (Area.CONTACT, Area.CHEST, Area.OTHER)
    ]
    forces = [f"{own.force_threshold:g}, {own.force_gain:g}" if own.force_gain else "–" for own in gains]
    nears = [
        f"{own.proximity_threshold:g}, {own.proximity_gain:g}" if own.proximity_gain else "–" for own in gains
    ]
    pose = directive.pose or ("as asked" if state is State.GO else "–")
    speed = f"{directive.speed_rad_s:g}" if pose != "–" else "–"
    patience = f"{directive.timeout_s:g}" if directive.timeout_s < math.inf else "–"
    return (f"`{state.value}`", *forces, *nears, pose, speed, patience)


def _renamed(*tables: Iterable[tuple[str, str]]) -> str:
    rows = ((f"`{_escaped(old)}`", f"`{_escaped(new)}`") for table in tables for old, new in table)
    return _table(("format 1", "format 2"), rows)


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")


def _format_1_values() -> str:
    rows = (
        (f"`{path}`", f"`{old}`", f"`{new}`")
        for path, values in format_1.DEPLOYMENT_VALUES.items()
        for old, new in values.items()
    )
    return _table(("key in format 1", "value", "value in format 2"), rows)


def _format_1_messages() -> str:
    tags = dict.fromkeys([*format_1.MESSAGE_TYPES, *format_1.MESSAGE_FIELDS])
    rows = (
        (
            f"`{tag}`",
            f"`{format_1.MESSAGE_TYPES.get(tag, tag)}`",
            ", ".join(f"`{old}` → `{new}`" for old, new in format_1.MESSAGE_FIELDS.get(tag, {}).items()),
        )
        for tag in tags
    )
    return _table(("`type` in format 1", "`type` in format 2", "fields"), rows)


def _format_1_metrics() -> str:
    return _renamed(
        format_1.SUMMARY_KEYS.items(),
        ((f"process_failures[].{old}", f"process_failures[].{new}") for old, new in _FAILURE_KEYS),
        format_1.METRICS,
        format_1.STRESS_METRICS,
        ((f"c<n>-{old}…", f"c<n>-{new}…") for old, new in format_1.ENCODINGS.items()),
        ((f"{old}.stimulated.…", f"{new}.stimulated.…") for old, new in format_1.ENCODINGS.items()),
    )


_FAILURE_KEYS = format_1.PROCESS_FAILURE_KEYS.items()
_MAKERS = {
    "schema": _schema,
    "channels": _channels,
    "messages": _messages,
    "stream_row": _stream_row,
    "sheet_rows": _sheet_rows,
    "columns": _columns,
    "numbers": _numbers,
    "states": _states,
    "directives": _directives,
    "format_1_keys": lambda: _renamed(format_1.DEPLOYMENT_KEYS.items()),
    "format_1_values": _format_1_values,
    "format_1_channels": lambda: _renamed(format_1.CHANNEL_KEYS),
    "format_1_messages": _format_1_messages,
    "format_1_counters": lambda: _renamed(
        format_1.COUNTERS.items(), ((f"….{old}", f"….{new}") for old, new in format_1.PARAMETERS.items())
    ),
    "format_1_metrics": _format_1_metrics,
}


def _kind(kind: Any) -> str:
    """A type in words."""
    match kind:
        case reflect.IntType():
            return f"whole number{_bounds(kind)}"
        case reflect.FloatType():
            return f"number{_bounds(kind)}"
        case reflect.StrType():
            return "name" if kind.pattern == _NAME_PATTERN else "text"
        case reflect.BoolType():
            return "true or false"
        case reflect.BytesType():
            return "bytes"
        case reflect.LiteralType():
            return " or ".join(f"`{toml_value(value)}`" for value in kind.values)
        case reflect.StructType():
            return "table"
        case reflect.DictType():
            return f"table of {_kind(kind.value_type)} by {_kind(kind.key_type)}"
        case reflect.TupleType():
            return f"list of {len(kind.item_types)} × {_kind(kind.item_types[0])}"
        case reflect.VarTupleType() | reflect.ListType():
            return f"list of {_kind(kind.item_type)}"
        case reflect.UnionType():
            parts = [_kind(part) for part in kind.types if not isinstance(part, reflect.NoneType)]
            return ", or ".join(dict.fromkeys(parts))
    raise TypeError(f"no words for {kind}")


def _bounds(kind: reflect.IntType | reflect.FloatType) -> str:
    bounds = ((">", kind.gt), ("≥", kind.ge), ("<", kind.lt), ("≤", kind.le))
    return "".join(f" {sign} {bound:g}" for sign, bound in bounds if bound is not None)


def _default(field: reflect.Field) -> str:
    if field.required:
        return "**required**"
    if field.default is None:
        return "none"
    if field.default is NODEFAULT:  # made by a factory: a table of its own, or an empty one
        return "" if isinstance(field.type, reflect.StructType) else "empty"
    return f"`{toml_value(field.default)}`"


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(' '.join(cell.split()) for cell in line)} |\n" for line in lines)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(fill(page.read_text(encoding="utf-8")), encoding="utf-8")
