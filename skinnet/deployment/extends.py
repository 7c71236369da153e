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

__all__ = ["EXTENDS", "Layer", "chain_of", "merge_layers", "origin_of", "read_layers"]

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
            text has the chain of files.
    """
    layers: list[Layer] = []
    seen: list[Path] = []
    next_path: Path | None = path
    while next_path is not None:
        chain = _chain([*(layer.path for layer in layers), next_path])
        if next_path.resolve() in seen:
            raise DeploymentError(f"{chain}: {EXTENDS} goes round: {next_path} extends itself")
        seen.append(next_path.resolve())
        raw = _read(next_path, chain)
        base = raw.pop(EXTENDS, None)
        if base is not None and (not isinstance(base, str) or not base):
            raise DeploymentError(f"{chain}: {EXTENDS} = {base!r}: give the name of one file")
        try:
            layers.append(Layer(next_path, *translate(raw, str(next_path))))
        except FormatError as error:
            raise DeploymentError(str(error)) from None
        next_path = None if base is None else next_path.parent / base
    return tuple(reversed(layers))


def chain_of(layers: Iterable[Layer]) -> str:
    """The chain of files in words, the deployment first."""
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
    """The last file of a chain that sets a dotted key, or the longest part of it that any file sets."""
    steps = key.replace("[", ".[").split(".")
    best: tuple[int, Path] | None = None
    for layer in layers:
        depth = _depth(layer.document, steps)
        if depth and (best is None or depth >= best[0]):
            best = depth, layer.path
    return None if best is None else best[1]


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
    """Document of a layer in which files are named relative to `folder`."""
    own = layer.path.parent
    if own.resolve() == folder.resolve():
        return layer.document
    document = _merge({}, layer.document)
    for table, key in _FILE_KEYS:
        named = document.get(table, {}).get(key) if isinstance(document.get(table), dict) else None
        if isinstance(named, str) and (own / named).is_file():
            document[table] = document[table] | {key: os.path.relpath(own / named, folder)}
    return document


def _depth(document: Any, steps: list[str]) -> int:
    """How many steps of a key a document has."""
    node = document
    for depth, step in enumerate(steps):
        if step.startswith("[") and step.endswith("]"):
            index = int(step[1:-1]) if step[1:-1].isdecimal() else -1
            if not isinstance(node, list) or not 0 <= index < len(node):
                return depth
            node = node[index]
        elif isinstance(node, dict) and step in node:
            node = node[step]
        else:
            return depth
    return len(steps)
