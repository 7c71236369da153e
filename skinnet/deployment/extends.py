"""Inheritance of deployment files: `extends` names a base file.

Tables of a file are merged into those of its base; lists and values replace them.
"""

import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skinnet.errors import DeploymentError, FormatError
from skinnet.migration.deployments import translate

__all__ = ["EXTENDS", "Layer", "chain_of", "merge_layers", "origin_of", "read_layers", "value_at"]

EXTENDS = "extends"
_FILE_KEYS = (("body", "model"), ("memory", "read"))
"""Keys whose value may be a file, relative to the deployment that says so."""


@dataclass(frozen=True)
class Layer:
    """One file of a chain, in the present format.

    Attributes:
        path: The file.
        document: Its content without `extends`.
        n_renamed: Number of keys and values that an earlier format called otherwise.
    """

    path: Path
    document: dict[str, Any]
    n_renamed: int


def read_layers(path: Path) -> tuple[Layer, ...]:
    """Read a deployment and all files that it extends, the outermost base first.

    Raises:
        DeploymentError: a file is missing, unreadable, no TOML, of a newer format, or extends itself; the
            text has the chain of files, of which the last is the one at fault.
    """
    layers: list[Layer] = []
    seen: list[str] = []
    next_path: Path | None = path
    while next_path is not None:
        chain = _chain([*(layer.path for layer in layers), next_path])
        real = os.path.realpath(next_path)
        if real in seen:
            raise DeploymentError(f"{chain}: {EXTENDS} goes round: {next_path} extends itself")
        seen.append(real)
        raw = _read(next_path, chain)
        base = raw.pop(EXTENDS, None)
        if base is not None and (not isinstance(base, str) or not base or "\0" in base):
            raise DeploymentError(f"{chain}: {EXTENDS} = {base!r}: give the name of one file")
        try:
            layers.append(Layer(next_path, *translate(raw, chain)))
        except FormatError as error:
            raise DeploymentError(str(error)) from None
        next_path = None if base is None else next_path.parent / base
    return tuple(reversed(layers))


def chain_of(layers: Iterable[Layer]) -> str:
    """Return the chain of files as text, the deployment first: "a.toml extends b.toml"."""
    return _chain([layer.path for layer in layers][::-1])


def merge_layers(layers: tuple[Layer, ...]) -> dict[str, Any]:
    """Merge a chain into one document: tables are merged, everything else is replaced.

    Files that a base names relative to itself are named relative to the deployment.
    """
    folder = layers[-1].path.parent
    merged: dict[str, Any] = {}
    for layer in layers:
        merged = _merge(merged, _relocate(layer, folder))
    return merged


def origin_of(layers: Iterable[Layer], key: str) -> Path | None:
    """Return the last file of a chain that sets a key such as `patches[0].body`; None if no file does."""
    files = [layer.path for layer in layers if value_at(layer.document, key) is not None]
    return files[-1] if files else None


def value_at(document: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key such as `patches[0].body`; None if the document does not set it."""
    node: Any = document
    for step in key.replace("[", ".[").split("."):
        if isinstance(node, list) and step.startswith("["):
            index = int(step[1:-1])
            node = node[index] if index < len(node) else None
        else:
            node = node.get(step) if isinstance(node, dict) else None
    return node


def _chain(paths: list[Path]) -> str:
    return f" {EXTENDS} ".join(map(str, paths))


def _read(path: Path, chain: str) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DeploymentError(f"{chain}: there is no such file") from None
    except OSError as error:
        raise DeploymentError(f"{chain}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DeploymentError(f"{chain}: no valid TOML: {error}") from error


def _merge(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in own.items():
        old = merged.get(key)
        merged[key] = _merge(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


def _relocate(layer: Layer, folder: Path) -> dict[str, Any]:
    """Copy the document of a layer, with its files named relative to `folder`."""
    own = layer.path.parent
    if own.resolve() == folder.resolve():
        return layer.document
    document = dict(layer.document)
    for table, key in _FILE_KEYS:
        values = document.get(table)
        named = values.get(key) if isinstance(values, dict) else None
        if isinstance(values, dict) and isinstance(named, str) and _is_file_name(own, table, named):
            document[table] = values | {key: os.path.relpath(own / named, folder)}
    body = document.get("body")
    if isinstance(body, dict) and isinstance(body.get("package_paths"), list):
        document["body"] = body | {
            "package_paths": [_moved(path, own, folder) for path in body["package_paths"]]
        }
    return document


def _moved(path: Any, own: Path, folder: Path) -> Any:
    """Path relative to `folder` of one that is relative to `own`; what is no path stays for the schema."""
    return os.path.relpath(own / path, folder) if isinstance(path, str) else path


def _is_file_name(folder: Path, table: str, named: str) -> bool:
    """Check if a value names a file: that of `body.model` may be the name of a shipped model instead."""
    if not named or "\0" in named:
        return False
    return table != "body" or bool(Path(named).suffix) or (folder / named).is_file()
