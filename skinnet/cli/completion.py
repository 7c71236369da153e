"""Shell completion of deployment files and of the keys of `--set`."""

import contextlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from msgspec import inspect as reflect

__all__ = ["complete_deployment", "complete_setting"]


def complete_deployment(incomplete: str) -> list[str]:
    """Complete the path of a deployment: TOML files, and folders with TOML files in or right below them.

    A folder that is the only candidate is replaced by its content, since shells end a sole candidate with a
    space.
    """
    found = _paths(incomplete)
    while len(found) == 1 and found[0].endswith("/"):
        found = _paths(found[0])
    return found


def _paths(incomplete: str) -> list[str]:
    folder, slash, begin = incomplete.rpartition("/")
    found = []
    with contextlib.suppress(OSError):
        for path in sorted(Path(f"{folder}{slash}" or ".").expanduser().iterdir()):
            if not path.name.startswith(begin) or path.name.startswith("."):
                continue
            if path.is_dir() and (any(path.glob("*.toml")) or any(path.glob("*/*.toml"))):
                found.append(f"{folder}{slash}{path.name}/")
            elif path.suffix == ".toml":
                found.append(f"{folder}{slash}{path.name}")
    return found


def complete_setting(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the dotted key of `--set` from the schema, and "KEY=" with the values that are allowed.

    Entries of lists and tables by name are those of the deployment that the command line names before.
    """
    key, equals, begin = incomplete.partition("=")
    # the parser stops at an option without its value and leaves the file among the arguments
    file = ctx.params.get("file") or next((word for word in ctx.args if word.endswith(".toml")), None)
    values_by_key = dict(_keys(_document(file)))
    if equals:
        return [f"{key}={value}" for value in values_by_key.get(key, ()) if value.startswith(begin)]
    return [f"{name}=" for name in values_by_key if name.startswith(key)]


def _document(file: Path | str | None) -> dict[str, Any]:
    """Content of a deployment with all that it extends; empty if there is none."""
    from skinnet.deployment.extends import merge_layers, read_layers
    from skinnet.errors import SkinnetError

    with contextlib.suppress(OSError, SkinnetError, tomllib.TOMLDecodeError):
        return merge_layers(read_layers(Path(file))) if file is not None else {}
    return {}


def _keys(document: dict[str, Any]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Dotted keys of a deployment and, if they are few, the values that each allows."""
    from msgspec import inspect as reflect

    from skinnet.deployment import Deployment

    return _keys_below("", reflect.type_info(Deployment), document)


def _keys_below(path: str, kind: "reflect.Type", value: Any) -> Iterator[tuple[str, tuple[str, ...]]]:
    from msgspec import inspect as reflect

    tables = [part for part in _alternatives(kind, None) if isinstance(part, reflect.StructType)]
    for tag_field in dict.fromkeys(table.tag_field for table in tables if table.tag_field is not None):
        yield f"{path}.{tag_field}", tuple(str(table.tag) for table in tables)
    for part in _alternatives(kind, value):
        if isinstance(part, reflect.StructType):
            table = value if isinstance(value, dict) else {}
            for field in part.fields:
                name = f"{path}.{field.encode_name}".lstrip(".")
                yield from _keys_below(name, field.type, table.get(field.encode_name))
        elif isinstance(part, reflect.DictType) and isinstance(value, dict):
            for name, item in value.items():
                yield from _keys_below(f"{path}.{name}", part.value_type, item)
        elif isinstance(part, reflect.VarTupleType | reflect.ListType) and isinstance(value, list):
            for index, item in enumerate(value):
                entry = item.get("name", index) if isinstance(item, dict) else index
                yield from _keys_below(f"{path}.{entry}", part.item_type, item)
    if path and not tables:
        yield path, _values(kind)


def _alternatives(kind: "reflect.Type", value: Any) -> list["reflect.Type"]:
    """Types of a union; of a tagged union, the one with the tag of `value`."""
    from msgspec import inspect as reflect

    if isinstance(kind, reflect.Metadata):
        return _alternatives(kind.type, value)
    if not isinstance(kind, reflect.UnionType):
        return [kind]
    parts = [part for member in kind.types for part in _alternatives(member, value)]
    if isinstance(value, dict):
        tagged: list[reflect.Type] = [
            part
            for part in parts
            if isinstance(part, reflect.StructType)
            and part.tag_field is not None
            and value.get(part.tag_field) == part.tag
        ]
        return tagged or parts
    return parts


def _values(kind: "reflect.Type") -> tuple[str, ...]:
    """Values of a choice, as `--set` takes them."""
    from msgspec import inspect as reflect

    found: list[str] = []
    for part in _alternatives(kind, None):
        if isinstance(part, reflect.LiteralType):
            found += map(str, part.values)
        elif isinstance(part, reflect.BoolType):
            found += ["false", "true"]
    return tuple(found)
