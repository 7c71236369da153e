"""Errors of the schema in terms of the deployment: msgspec's messages as key, value and what is allowed."""

import math
import re
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

import msgspec

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.extends import EXTENDS
from skinnet.errors import DeploymentError
from skinnet.migration.deployments import FORMAT_KEY
from skinnet.schema_words import in_words
from skinnet.suggestions import did_you_mean

__all__ = ["describe_error", "reject_non_finite"]

_ERROR_LOCATION = re.compile(r"^(?P<what>.*?)(?: - at (?P<in_key>`key` in )?`\$(?P<path>.*)`)?$", re.DOTALL)
_UNKNOWN_FIELD = re.compile(r"Object contains unknown field `(?P<field>[^`]*)`")
_PATH_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]|(\[\.\.\.\]|\[key\])")


def reject_non_finite(value: Any, key: str = "") -> None:
    """Reject nan and inf, which TOML allows.

    Raises:
        DeploymentError: names key and value.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise DeploymentError(f"{key} = {value}: must be a finite number")
    if isinstance(value, dict):
        for name, item in value.items():
            reject_non_finite(item, f"{key}.{name}".lstrip("."))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            reject_non_finite(item, f"{key}[{index}]")


def describe_error(raw: dict[str, Any], message: str) -> str:
    """Translate a msgspec message to "key = value: error, allowed values".

    Args:
        raw: Document of the present format that msgspec rejected.
        message: Text of its ValidationError.
    """
    match = _ERROR_LOCATION.match(message)
    assert match is not None
    problem = in_words(match["what"])
    key, value, kind = _resolve_path(raw, (match["path"] or "") + ("[key]" if match["in_key"] else ""))
    unknown = _UNKNOWN_FIELD.search(problem)
    if unknown is not None:
        return _describe_unknown_key(key, _select_table(kind, value), unknown["field"])
    if problem.startswith(("Invalid enum value", "Invalid value")):
        allowed = _allowed_values(kind)
        near = did_you_mean(str(value), [text.strip("'") for text in allowed])  # quotes make all alike
        hint = did_you_mean(repr(value), allowed) if near else ""
        problem = f"{hint}allowed: {', '.join(allowed)}"
    tag = _tag_field(kind)
    if tag is not None and problem == f"The table lacks `{tag}`":
        problem = f"{problem}; allowed: {', '.join(_allowed_values(_tag_annotation(kind)))}"
    shown = "" if isinstance(value, dict | list) else f" = {value!r}"
    return f"{key or 'the file'}{shown}: {problem[0].lower()}{problem[1:]}"


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
    if table is Deployment:
        known += [EXTENDS, FORMAT_KEY]
    hint = did_you_mean(field, known)
    return f"{key}.{field}".lstrip(".") + f": unknown key; {hint}allowed: {', '.join(known)}"


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
