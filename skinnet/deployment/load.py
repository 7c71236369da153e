"""Deployment loading from TOML with `--set` overrides; errors name file, key and value."""

import logging
import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

import msgspec

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.extends import Layer, chain_of, merge_layers, origin_of, read_layers
from skinnet.errors import DeploymentError, FormatError
from skinnet.migration.deployments import FORMAT, FORMAT_KEY, current_name, translate
from skinnet.suggestions import did_you_mean, known_names

__all__ = ["apply_override", "from_document", "load", "resolved_json"]

log = logging.getLogger(__name__)

_LEADING_KEY = re.compile(r"[\w.\[\]\-]+")
_ERROR_LOCATION = re.compile(r"^(?P<what>.*?)(?: - at (?P<in_key>`key` in )?`\$(?P<path>.*)`)?$", re.DOTALL)
_UNKNOWN_FIELD = re.compile(r"Object contains unknown field `(?P<field>[^`]*)`")
_PATH_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]|(\[\.\.\.\]|\[key\])")


def load(path: Path, overrides: tuple[str, ...] = (), seed: int | None = None) -> Deployment:
    """Load a deployment with all that it extends, and validate it against the schema.

    Args:
        path: TOML file.
        overrides: `key=value` with dotted keys; values are TOML, anything else is a string. An entry of a
            list is named by its index or by its name: `patches.torso.body="chest"`.
        seed: Replacement for the deployment's seed.

    Raises:
        DeploymentError: one line with the chain of files, key, value and what is allowed.
    """
    layers = read_layers(path)
    _log_old_formats(layers)
    raw = merge_layers(layers)
    for override in overrides:
        apply_override(raw, override)
    if seed is not None:
        raw["seed"] = seed
    return _convert(raw, lambda key: _source_of(layers, key))


def _log_old_formats(layers: tuple[Layer, ...]) -> None:
    for layer in layers:
        if layer.n_renamed:
            log.warning(
                "%s: %d names of an earlier format, read by their new names; skinnet migrate "
                "rewrites the file",
                layer.path,
                layer.n_renamed,
            )


def from_document(raw: dict[str, Any], source: str) -> Deployment:
    """Convert a decoded document of any known format to a deployment; `source` names it in errors.

    Raises:
        DeploymentError: one line with source, key, value and what is allowed.
    """
    try:
        document, _ = translate(raw, source)
    except FormatError as error:
        raise DeploymentError(str(error)) from None
    return _convert(document, lambda _key: source)


def _convert(document: dict[str, Any], source_of: Callable[[str], str]) -> Deployment:
    """Convert a document of the present format; `source_of` names the source of a key in errors."""
    try:
        _reject_non_finite(document)
        return msgspec.convert(document, Deployment)
    except DeploymentError as error:
        text = str(error)
    except msgspec.ValidationError as error:
        text = _describe_error(document, str(error))
    key = _LEADING_KEY.match(text)
    raise DeploymentError(f"{source_of(key[0] if key else '')}: {text}")


def _source_of(layers: tuple[Layer, ...], key: str) -> str:
    """Chain of the files and, if there are several, the one that sets `key`."""
    origin = origin_of(layers, key) if len(layers) > 1 else None
    return chain_of(layers) if origin is None else f"{chain_of(layers)}: in {origin}"


def resolved_json(deployment: Deployment) -> bytes:
    """Encode the deployment with every default, as JSON that `from_document` accepts."""
    document = {FORMAT_KEY: FORMAT, **msgspec.to_builtins(deployment)}
    return msgspec.json.format(msgspec.json.encode(document), indent=1)


def apply_override(raw: dict[str, Any], override: str) -> None:
    """Apply one `key=value` override to a decoded TOML document, in place.

    Raises:
        DeploymentError: no "=", or the key leads through a value that is no table.
    """
    key, separator, text = override.partition("=")
    steps = [step.strip() for step in key.split(".")]
    if not separator or not all(steps):
        raise DeploymentError(f"--set {override}: write it as key=value, for example run.max_s=20")
    renamed = current_name(".".join(steps))
    if renamed is not None:
        raise DeploymentError(f"--set {override}: {'.'.join(steps)} is called {renamed} now")
    node: Any = raw
    for step in steps[:-1]:
        node = _descend(node, step, override)
    if isinstance(node, list):
        node[_entry_index(node, steps[-1], override)] = _parse_value(text.strip())
    elif isinstance(node, dict):
        node[steps[-1]] = _parse_value(text.strip())
    else:
        raise DeploymentError(f"--set {override}: {steps[-2]} is a value, it has no {steps[-1]}")


def _descend(node: Any, step: str, override: str) -> Any:
    if isinstance(node, list):
        return node[_entry_index(node, step, override)]
    if isinstance(node, dict):
        return node.setdefault(step, {})
    raise DeploymentError(f"--set {override}: nothing lies below {step}")


def _entry_index(node: list[Any], step: str, override: str) -> int:
    names = [item.get("name") if isinstance(item, dict) else None for item in node]
    if step in names:
        return names.index(step)
    if step.isdecimal() and int(step) < len(node):
        return int(step)
    known = [name for name in names if name] or [f"0 to {len(node) - 1}"]
    raise DeploymentError(f"--set {override}: no entry {step}; {known_names(step, known)}")


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text


def _reject_non_finite(value: Any, key: str = "") -> None:
    """Reject nan and inf, which TOML allows."""
    if isinstance(value, float) and not math.isfinite(value):
        raise DeploymentError(f"{key} = {value}: must be a finite number")
    if isinstance(value, dict):
        for name, item in value.items():
            _reject_non_finite(item, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _reject_non_finite(item, f"{key}[{index}]")


def _describe_error(raw: dict[str, Any], message: str) -> str:
    """Translate a msgspec message to "key = value: error, allowed values"."""
    match = _ERROR_LOCATION.match(message)
    assert match is not None
    what = match["what"]
    key, value, kind = _resolve_path(raw, (match["path"] or "") + ("[key]" if match["in_key"] else ""))
    unknown = _UNKNOWN_FIELD.search(what)
    if unknown is not None:
        return _describe_unknown_key(key, _select_table(kind, value), unknown["field"])
    if what.startswith(("Invalid enum value", "Invalid value")):
        allowed = _allowed_values(kind)
        what = f"{did_you_mean(repr(value), allowed)}allowed: {', '.join(allowed)}"
    tag = _tag_field(kind)
    if tag is not None and what == f"Object missing required field `{tag}`":
        what = f"{what}; allowed: {', '.join(_allowed_values(_tag_annotation(kind)))}"
    shown = "" if isinstance(value, dict | list) else f" = {value!r}"
    return f"{key or 'the file'}{shown}: {what[0].lower()}{what[1:]}"


def _resolve_path(raw: dict[str, Any], path: str) -> tuple[str, Any, Any]:
    """Resolve a msgspec path to key, value and annotation.

    msgspec writes [...] for any entry of a table: this resolves to the first invalid entry, and [key] to the
    first invalid name.
    """
    key, value, kind = "", cast(Any, raw), cast(Any, Deployment)
    for name, number, other in _PATH_STEP.findall(path):
        if name:
            tagged = name == _tag_field(kind)
            kind = (
                _tag_annotation(kind)
                if tagged
                else get_type_hints(_select_table(kind, value), include_extras=True)[name]
            )
            key, value = f"{key}.{name}".lstrip("."), value[name]
        elif number:
            key, value = f"{key}[{number}]", value[int(number)]
        else:
            kinds = _dict_annotations(kind)
            if other == "[key]":
                return key, next(name for name in value if not _is_valid(name, kinds[0])), kinds[0]
            name = next(name for name, item in value.items() if not _is_valid(item, kinds[1]))
            key, value, kind = f"{key}.{name}", value[name], kinds[1]
    return key, value, kind


def _is_valid(value: Any, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _describe_unknown_key(key: str, table: Any, field: str) -> str:
    tag = table.__struct_config__.tag_field
    known = [*([tag] if tag else []), *table.__struct_fields__]
    return (
        f"{key}.{field}".lstrip(".")
        + f": unknown key; {did_you_mean(field, known)}allowed: {', '.join(known)}"
    )


def _table_types(annotation: Any) -> list[Any]:
    """List the table types of an annotation: several for a tagged union."""
    if hasattr(annotation, "__struct_fields__"):
        return [annotation]
    return [table for part in get_args(annotation) for table in _table_types(part)]


def _select_table(annotation: Any, value: Any) -> Any:
    """Select the table type of `value` by its tag."""
    tables = _table_types(annotation)
    tag = value.get(_tag_field(annotation))
    return next((table for table in tables if table.__struct_config__.tag == tag), tables[0])


def _tag_field(annotation: Any) -> str | None:
    """Return the tag key of a tagged union of tables; None for other annotations."""
    return next((table.__struct_config__.tag_field for table in _table_types(annotation)), None)


def _tag_annotation(annotation: Any) -> Any:
    """Return the annotation of the tag key."""
    return Literal[tuple(table.__struct_config__.tag for table in _table_types(annotation))]


def _dict_annotations(annotation: Any) -> tuple[Any, ...]:
    """Return the name and value annotations of a dict annotation; empty for others."""
    if get_origin(annotation) is dict:
        return get_args(annotation)
    return next((kinds for part in get_args(annotation) if (kinds := _dict_annotations(part))), ())


def _allowed_values(annotation: Any) -> list[str]:
    """List the allowed values of an annotation."""
    if get_origin(annotation) is Literal:
        return [repr(choice) for choice in get_args(annotation)]
    if annotation is int:
        return ["a whole number"]
    if get_origin(annotation) is dict:
        return ["a table"]
    return [choice for part in get_args(annotation) for choice in _allowed_values(part)]
