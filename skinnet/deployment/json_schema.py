"""JSON Schema (2020-12) of deployment files, with which editors complete and check them.

One file of a chain is not a whole deployment: its tables are merged with those of its base. So keys are
required in entries of lists, which are never merged, and in a file with a name that extends nothing. What
fits together across keys and files is for `skinnet check`.
"""

import inspect
from typing import Any

import msgspec
from msgspec import inspect as reflect

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.documentation import attribute_docs, tables, unit_of
from skinnet.deployment.extends import EXTENDS
from skinnet.migration.deployments import FORMAT, FORMAT_KEY

__all__ = ["deployment_schema"]

Schema = dict[str, Any]


def deployment_schema() -> Schema:
    """Build the JSON Schema of one deployment file, whole or part of a chain."""
    schema = msgspec.json.schema(Deployment)
    defs: dict[str, Schema] = {name: _for_toml(table) for name, table in schema["$defs"].items()}
    whole_tables = _required_in_whole_tables(reflect.type_info(Deployment))
    entries = set()
    for path, struct in tables("", reflect.type_info(Deployment)):
        name = struct.cls.__name__
        defs[name]["description"] = _sentences(inspect.getdoc(struct.cls))
        for field in struct.fields:
            _describe(defs[name]["properties"], field.encode_name, attribute_docs(struct.cls).get(field.name))
        if "[]" in path:
            entries.add(name)
    for name, table in defs.items():
        if name not in entries:
            table.pop("required", None)
    top = defs.pop(Deployment.__name__)
    top["properties"] = _chain_keys() | top["properties"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Deployment of skinnet",
        **{key: value for key, value in top.items() if key != "title"},
        "if": {"required": ["name"], "not": {"required": [EXTENDS]}},
        "then": whole_tables,
        "$defs": defs,
    }


def _chain_keys() -> Schema:
    """Return the schemas of the keys that belong to a file, not to the deployment."""
    return {
        EXTENDS: {
            "type": "string",
            "minLength": 1,
            "description": "Base file, relative to this one: tables are merged, lists and values replaced.",
        },
        FORMAT_KEY: {"const": FORMAT, "description": "Format of this file."},
    }


def _for_toml(schema: Any) -> Any:
    """Strip what TOML has not (null) and what JSON Schema has not (discriminators)."""
    if isinstance(schema, list):
        return [_for_toml(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {key: _for_toml(value) for key, value in schema.items() if key != "discriminator"}
    if "default" in schema and schema["default"] is None:
        del plain["default"]
    if "anyOf" in plain:
        parts = [part for part in plain.pop("anyOf") if part != {"type": "null"}]
        plain |= parts[0] if len(parts) == 1 else {"anyOf": parts}
    return plain


def _describe(properties: Schema, key: str, doc: str | None) -> None:
    """Put description and unit to the schema of a key."""
    unit = unit_of(key)
    text = " ".join(filter(None, (_sentences(doc), f"[{unit}]" if unit else "")))
    if text:
        properties[key]["description"] = text


def _sentences(doc: str | None) -> str:
    """Join the lines of each paragraph of a docstring."""
    return "\n\n".join(" ".join(part.split()) for part in (doc or "").split("\n\n"))


def _required_in_whole_tables(kind: Any) -> Schema:
    """Build the schema of the keys that a whole deployment needs, also in tables that it may leave out."""
    schema: Schema = {}
    match kind:
        case reflect.StructType():
            required = [field.encode_name for field in kind.fields if field.required]
            below = {field.encode_name: _required_in_whole_tables(field.type) for field in kind.fields}
            properties = {key: value for key, value in below.items() if value}
            schema = {"required": required} if required else {}
            schema |= {"properties": properties} if properties else {}
        case reflect.DictType():
            value = _required_in_whole_tables(kind.value_type)
            schema = {"additionalProperties": value} if value else {}
        case reflect.UnionType():
            parts = [part for part in kind.types if isinstance(part, reflect.StructType)]
            schema = _required_in_whole_tables(parts[0]) if len(parts) == 1 else {}
    return schema
