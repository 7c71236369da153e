"""Deployment loading from TOML with `--set` overrides; errors name file, key and value."""

import copy
import re
import tomllib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.extends import (
    EXTENDS,
    Layer,
    chain_of,
    merge_layers,
    origin_of,
    read_layers,
    value_at,
)
from skinnet.deployment.number_ranges import reject_out_of_range
from skinnet.deployment.schema_errors import describe_error, reject_non_finite
from skinnet.errors import DeploymentError, FormatError
from skinnet.migration.deployments import FORMAT, FORMAT_KEY, current_name, translate
from skinnet.migration.renaming import remark_old_format
from skinnet.suggestions import known_names

__all__ = ["apply_override", "from_document", "load", "read_document", "resolved_json"]

_LEADING_KEY = re.compile(r"[\w.\[\]\-]+")


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
    merged = merge_layers(layers)
    document = copy.deepcopy(merged)
    for override in overrides:
        apply_override(document, override)
    if seed is not None:
        document["seed"] = seed
    return _convert(document, lambda key: _source_of(layers, merged, document, key))


def read_document(path: Path) -> dict[str, Any]:
    """Read a deployment with all that it extends into one document, neither validated nor converted.

    Raises:
        DeploymentError: a file of the chain cannot be read; one line with the chain.
    """
    return merge_layers(read_layers(path))


def _log_old_formats(layers: tuple[Layer, ...]) -> None:
    for layer in layers:
        if layer.n_renamed:
            remark_old_format(layer.path, "deployment")


def from_document(raw: dict[str, Any], source: str) -> Deployment:
    """Convert a decoded document of any known format to a deployment; `source` names it in errors.

    Raises:
        DeploymentError: one line with source, key, value and what is allowed.
    """
    if EXTENDS in raw:
        raise DeploymentError(
            f"{source}: {EXTENDS} = {raw[EXTENDS]!r}: only a file extends another, load it by its path"
        )
    try:
        document, _ = translate(raw, source)
    except FormatError as error:
        raise DeploymentError(str(error)) from None
    return _convert(document, lambda _key: source)


def _convert(document: dict[str, Any], source_of: Callable[[str], str]) -> Deployment:
    """Convert a document of the present format; `source_of` names the source of a key in errors."""
    try:
        reject_non_finite(document)
        _reject_out_of_range(document)
        return msgspec.convert(document, Deployment)
    except DeploymentError as error:
        text = str(error)
    except msgspec.ValidationError as error:
        text = describe_error(document, str(error))
    key = _LEADING_KEY.match(text)
    raise DeploymentError(f"{source_of(key[0] if key else '')}: {text}")


def _reject_out_of_range(document: dict[str, Any]) -> None:
    """Reject numbers that are out of range; what the schema says of the same document comes first.

    The schema knows the bounds of a key, the ranges only what its unit can represent.
    """
    try:
        reject_out_of_range(document)
    except DeploymentError:
        with suppress(ArithmeticError):  # of derived values: that is what the ranges are for
            msgspec.convert(document, Deployment)
        raise


def _source_of(layers: tuple[Layer, ...], merged: dict[str, Any], document: dict[str, Any], key: str) -> str:
    """Return the chain of the files and, if there are several, the one that sets `key`.

    Args:
        layers: Files of the chain.
        merged: Content of the chain.
        document: The same with all overrides, which no file has set.
        key: Key such as `patches[0].body`.
    """
    if len(layers) == 1:
        return chain_of(layers)
    of_files, given = value_at(merged, key), value_at(document, key)
    if repr(given) != repr(of_files) and not (isinstance(given, dict) and isinstance(of_files, dict)):
        return f"{chain_of(layers)}: on the command line"
    origin = origin_of(layers, key)
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
        raise DeploymentError(f"--set {override}: {steps[-2]} is a value, not a table")


def _descend(node: Any, step: str, override: str) -> Any:
    if isinstance(node, list):
        return node[_entry_index(node, step, override)]
    if isinstance(node, dict):
        return node.setdefault(step, {})
    raise DeploymentError(f"--set {override}: {step} cannot be resolved: its parent is not a table")


def _entry_index(node: list[Any], step: str, override: str) -> int:
    names = [item.get("name") if isinstance(item, dict) else None for item in node]
    if step in names:
        return names.index(step)
    if step.isdecimal() and int(step) < len(node):
        return int(step)
    known = [str(name) for name in names if name] or [f"0 to {len(node) - 1}"]
    raise DeploymentError(f"--set {override}: no entry {step}; {known_names(step, known)}")


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text
