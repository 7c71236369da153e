"""From a TOML file and `--set` overrides to a frozen deployment; errors name file, key and value."""

import difflib
import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import msgspec

from skinnet.deployment.schema import Deployment
from skinnet.errors import DeploymentError

__all__ = ["apply_override", "build", "load", "resolved_json"]

_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$(?P<path>.*)`)?$", re.DOTALL)
_UNKNOWN = re.compile(r"Object contains unknown field `(?P<field>[^`]*)`")
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]|\[(\.\.\.)\]")


def load(path: Path, overrides: tuple[str, ...] = (), seed: int | None = None) -> Deployment:
    """Reads and checks the schema of a deployment.

    Args:
        path: TOML file.
        overrides: `key=value` with dotted keys; values are TOML, anything else is a string. An entry of a
            list goes by its number or by its name: `patches.torso.body="chest"`.
        seed: Replaces the deployment's seed.

    Raises:
        DeploymentError: one line with file, key, value, what is allowed.
    """
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DeploymentError(f"{path}: there is no such file") from None
    except OSError as error:
        raise DeploymentError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DeploymentError(f"{path}: no valid TOML: {error}") from error
    for override in overrides:
        apply_override(raw, override)
    if seed is not None:
        raw["seed"] = seed
    return build(raw, str(path))


def build(raw: dict[str, Any], source: str) -> Deployment:
    """Deployment of a decoded TOML document; `source` names it in errors."""
    try:
        return msgspec.convert(raw, Deployment)
    except msgspec.ValidationError as error:
        raise DeploymentError(f"{source}: {_explain(raw, str(error))}") from None


def resolved_json(deployment: Deployment) -> bytes:
    """The whole deployment with every default, as JSON that `build` reads back."""
    return msgspec.json.format(msgspec.json.encode(deployment), indent=1)


def apply_override(raw: dict[str, Any], override: str) -> None:
    """Sets one `key=value` in a decoded TOML document.

    Raises:
        DeploymentError: no "=", or the key leads through something that is no table.
    """
    key, separator, text = override.partition("=")
    steps = [step.strip() for step in key.split(".")]
    if not separator or not all(steps):
        raise DeploymentError(f"--set {override}: write it as key=value, for example run.max_s=20")
    node: Any = raw
    for step in steps[:-1]:
        node = _descend(node, step, override)
    if isinstance(node, list):
        node[_index(node, steps[-1], override)] = _value(text.strip())
    elif isinstance(node, dict):
        node[steps[-1]] = _value(text.strip())
    else:
        raise DeploymentError(f"--set {override}: {steps[-2]} is a value, it has no {steps[-1]}")


def _descend(node: Any, step: str, override: str) -> Any:
    if isinstance(node, list):
        return node[_index(node, step, override)]
    if isinstance(node, dict):
        return node.setdefault(step, {})
    raise DeploymentError(f"--set {override}: nothing lies below {step}")


def _index(node: list[Any], step: str, override: str) -> int:
    names = [item.get("name") if isinstance(item, dict) else None for item in node]
    if step in names:
        return names.index(step)
    if step.isdecimal() and int(step) < len(node):
        return int(step)
    known = ", ".join(str(name) for name in names if name) or f"0 to {len(node) - 1}"
    raise DeploymentError(f"--set {override}: no entry {step}; there are {known}")


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text


def _explain(raw: dict[str, Any], message: str) -> str:
    """The message of msgspec as key = value: what is wrong, what is allowed."""
    match = _AT.match(message)
    assert match is not None
    what, path = match["what"], match["path"] or ""
    unknown = _UNKNOWN.search(what)
    if unknown is not None:
        return _explain_unknown(path, unknown["field"])
    value: Any = raw
    for name, number, _ in _STEP.findall(path):
        try:
            value = value[int(number)] if number else value[name]
        except (KeyError, IndexError, TypeError):
            break
    key = path.lstrip(".").replace("[...]", "") or "the file"
    shown = "" if isinstance(value, dict | list) else f" = {value!r}"
    return f"{key}{shown}: {what[0].lower()}{what[1:]}"


def _explain_unknown(path: str, field: str) -> str:
    kind: Any = Deployment
    for name, _, _ in _STEP.findall(path):
        if name and hasattr(kind, "__struct_fields__"):
            kind = _table(kind.__annotations__.get(name))
    known = list(getattr(kind, "__struct_fields__", ()))
    near = difflib.get_close_matches(field, known, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    key = f"{path.lstrip('.')}.{field}".lstrip(".")
    return f"{key}: unknown key; {hint}allowed: {', '.join(known)}"


def _table(annotation: Any) -> Any:
    """The struct inside an annotation such as tuple[PatchSpec, ...] or Annotated[...]."""
    if hasattr(annotation, "__struct_fields__"):
        return annotation
    for inner in get_args(annotation):
        found = _table(inner)
        if found is not None:
            return found
    return None
