"""Deletion of elements of a model together with all that refers to them, and a list of what was deleted.

`MjSpec.delete` leaves references behind, and the model no longer compiles.
"""

from collections.abc import Iterable
from typing import Any

import mujoco

__all__ = ["delete_actuators", "delete_geom", "delete_joint"]

_OBJECTS = {
    mujoco.mjtObj.mjOBJ_ACTUATOR: "actuator",
    mujoco.mjtObj.mjOBJ_GEOM: "geom",
    mujoco.mjtObj.mjOBJ_JOINT: "joint",
    mujoco.mjtObj.mjOBJ_TENDON: "tendon",
}
_EQUALITY_OBJECTS = {
    mujoco.mjtEq.mjEQ_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
    mujoco.mjtEq.mjEQ_TENDON: mujoco.mjtObj.mjOBJ_TENDON,
}
_WRAPS = {
    mujoco.mjtWrap.mjWRAP_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
    mujoco.mjtWrap.mjWRAP_SPHERE: mujoco.mjtObj.mjOBJ_GEOM,
    mujoco.mjtWrap.mjWRAP_CYLINDER: mujoco.mjtObj.mjOBJ_GEOM,
}
_MAX_LISTED = 8

Element = Any
"""A sensor, an equality, a tuple or a tendon of a specification; MuJoCo's types have no stubs."""


def delete_actuators(spec: mujoco.MjSpec) -> list[str]:
    """Delete all actuators and keyframes, sensors and tuples that refer to actuators; list them, one a line.

    Servos come from the deployment; keyframes hold the controls of the actuators.
    """
    left_out: list[str] = []
    actuators, keys = list(spec.actuators), list(spec.keys)
    if actuators:
        left_out.append(f"{_count('actuator', actuators)}: servos come from the deployment")
    if keys:
        left_out.append(f"{_count('keyframe', keys)}: the home posture comes from the deployment")
    for name in filter(None, [actuator.name for actuator in actuators]):
        left_out += _delete_referrers(spec, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
    for element in [*actuators, *keys]:
        spec.delete(element)
    return left_out


def delete_joint(spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> list[str]:
    """Delete a joint, and sensors, equalities, tendons and tuples that refer to it; list them, one a line."""
    left_out = _delete_referrers(spec, mujoco.mjtObj.mjOBJ_JOINT, joint.name)
    spec.delete(joint)
    return left_out


def delete_geom(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> list[str]:
    """Delete a geom, and sensors, contact pairs, tendons and tuples that refer to it; list them."""
    left_out = _delete_referrers(spec, mujoco.mjtObj.mjOBJ_GEOM, geom.name)
    spec.delete(geom)
    return left_out


def _delete_referrers(spec: mujoco.MjSpec, kind: mujoco.mjtObj, name: str) -> list[str]:
    """Delete what refers to the element `name`, and in turn what refers to that."""
    because = f'refers to {_OBJECTS[kind]} "{name}", which is left out'
    found: list[tuple[str, Element]] = []
    found += [("sensor", sensor) for sensor in spec.sensors if _sensor_refers(sensor, kind, name)]
    found += [
        ("equality", equality)
        for equality in spec.equalities
        if _EQUALITY_OBJECTS.get(equality.type) == kind and name in (equality.name1, equality.name2)
    ]
    if kind == mujoco.mjtObj.mjOBJ_GEOM:
        found += [("contact pair", pair) for pair in spec.pairs if name in (pair.geomname1, pair.geomname2)]
    found += [
        ("tuple", entry)
        for entry in spec.tuples
        if (int(kind), name) in zip(entry.objtype, entry.objname, strict=False)
    ]
    tendons = [tendon for tendon in spec.tendons if _wraps(tendon, kind, name)]
    left_out = [f"{label} {_identity(element)}: {because}" for label, element in found]
    for _, element in found:
        spec.delete(element)
    for tendon in tendons:
        left_out.append(f"tendon {_identity(tendon)}: {because}")
        if tendon.name:
            left_out += _delete_referrers(spec, mujoco.mjtObj.mjOBJ_TENDON, tendon.name)
        spec.delete(tendon)
    return left_out


def _sensor_refers(sensor: mujoco.MjsSensor, kind: mujoco.mjtObj, name: str) -> bool:
    return (kind, name) in ((sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname))


def _wraps(tendon: mujoco.MjsTendon, kind: mujoco.mjtObj, name: str) -> bool:
    return any(_WRAPS.get(wrap.type) == kind and wrap.target.name == name for wrap in tendon.path)


def _identity(element: Element) -> str:
    """Name of an element, or for one without the place in its file."""
    return f'"{element.name}"' if element.name else f"without a name ({element.info})"


def _count(noun: str, elements: Iterable[mujoco.MjsActuator | mujoco.MjsKey]) -> str:
    names = [element.name or "without a name" for element in elements]
    more = ", …" if len(names) > _MAX_LISTED else ""
    plural = "" if len(names) == 1 else "s"
    return f"{len(names)} {noun}{plural} ({', '.join(names[:_MAX_LISTED])}{more})"
