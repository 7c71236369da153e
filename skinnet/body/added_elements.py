"""Elements that are added to a user's model: unused names, and MuJoCo's built-in defaults for every field.

MuJoCo starts a new element with the values of the model's main default class, which the file sets as it
likes: a servo may inherit a range of targets, a geom a margin, a joint damping.
"""

from collections.abc import Container

import mujoco

__all__ = ["FINGER", "added_id", "builtin_defaults", "unused_name"]

FINGER = "teacher_finger"
"""Name of the body of the teacher's finger, the first that is added to a model."""
_DEFAULTS_CLASS = "skinnet"
_KINDS = ("actuator", "geom", "joint", "pair")
"""Kinds of elements that are added with defaults of their own."""
_NOT_FIELDS = frozenset(
    ("alt", "classname", "compiler", "frame", "id", "info", "name", "parent", "plugin", "signature")
)
"""Attributes of elements that are no settings."""
_BUILTIN = mujoco.MjSpec()
"""Empty model with MuJoCo's defaults; a module constant, as defaults do not keep their model alive."""


def builtin_defaults(spec: mujoco.MjSpec) -> mujoco.MjsDefault:
    """Default class of `spec` with MuJoCo's built-in values, whatever the main class of the file says."""
    plain = spec.find_default(_DEFAULTS_CLASS)
    if plain is None:
        plain = spec.add_default(_DEFAULTS_CLASS, spec.default)
    for kind in _KINDS:
        _copy_fields(getattr(_BUILTIN.default, kind), getattr(plain, kind))
    plain.geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    return plain


def unused_name(base: str, used: Container[str]) -> str:
    """Name `base`, or if it is used `base_2`, `base_3` and so on."""
    name, number = base, 1
    while name in used:
        number += 1
        name = f"{base}_{number}"
    return name


def added_id(mj: mujoco.MjModel, kind: mujoco.mjtObj, base: str) -> int:
    """Find the added body, joint or geom that was named by `unused_name` from `base`: its id, or −1.

    Bodies are added to the world after those of the file, the finger first. So an added body is the last of
    its series of names, and not before the finger; this holds for its joints and geoms as well.
    """
    found = _last_of_series(mj, kind, base)
    finger = _last_of_series(mj, mujoco.mjtObj.mjOBJ_BODY, FINGER)
    if found < 0:
        return -1
    owner = found
    if kind == mujoco.mjtObj.mjOBJ_JOINT:
        owner = int(mj.jnt_bodyid[found])
    elif kind == mujoco.mjtObj.mjOBJ_GEOM:
        owner = int(mj.geom_bodyid[found])
    return found if owner >= finger else -1


def _last_of_series(mj: mujoco.MjModel, kind: mujoco.mjtObj, base: str) -> int:
    found, number = int(mujoco.mj_name2id(mj, kind, base)), 2
    while (following := int(mujoco.mj_name2id(mj, kind, f"{base}_{number}"))) >= 0:
        found = max(found, following)
        number += 1
    return found


def _copy_fields(source: object, target: object) -> None:
    for field in dir(source):
        if field.startswith("_") or field in _NOT_FIELDS:
            continue
        value = getattr(source, field)
        if callable(value):
            continue
        setattr(target, field, [] if field == "userdata" else value)
