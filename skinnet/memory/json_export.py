"""JSON export and import of a memory: complete and exact, with cells as "patch/cell", joints by name.

Every cell is listed; joints that do not move a cell, or whose weight is zero, are omitted.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import MemoryFileError
from skinnet.memory.contents import Floats, KeyPose, MemoryContents, RobotIdentity, StoredMemory
from skinnet.migration.memories import VERSION
from skinnet.schema_words import in_words

__all__ = ["FORMAT", "from_json", "stored_from_json", "to_json"]

FORMAT = "skinnet memory"
_KEYS = ("format", "version", "robot", "activity", "poses", "areas", "parameters")

T = TypeVar("T")


def to_json(memory: MemoryContents) -> bytes:
    """Encode a memory as indented JSON."""
    robot = memory.robot
    names = [f"{patch}/{cell}" for patch, cell in robot.cells()]
    unmeasured = set(memory.unmeasured.tolist())
    activity = None
    if memory.activity is not None:
        moved = [[j for j, on in zip(robot.joints, row, strict=True) if on] for row in memory.activity]
        activity = {
            name: None if number in unmeasured else moved[number] for number, name in enumerate(names)
        }
    document = {
        "format": FORMAT,
        "version": VERSION,
        "robot": {
            "name": robot.name,
            "joints": robot.joints,
            "patches": [{"name": patch, "cells": cells} for patch, cells in robot.patches.items()],
        },
        "activity": activity,
        "poses": {name: _pose_object(robot, names, pose) for name, pose in memory.poses.items()},
        "areas": {label: [names[cell] for cell in cells] for label, cells in sorted(memory.areas.items())},
        "parameters": dict(sorted(memory.parameters.items())),
    }
    return msgspec.json.format(msgspec.json.encode(document), indent=2) + b"\n"


def from_json(text: bytes) -> MemoryContents:
    """Decode a memory from JSON, as `stored_from_json`, without the version of the text."""
    return stored_from_json(text).contents


def stored_from_json(text: bytes) -> StoredMemory:
    """Decode a memory from JSON in the format of `to_json`, of any version up to the present one.

    Raises:
        MemoryFileError: invalid JSON, or a newer version; names the key, the error and what is allowed.
    """
    try:
        raw = msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise MemoryFileError(f"invalid JSON: {error}") from None
    fields = _object(raw, "the file", _KEYS)
    version = _read_version(fields)
    robot = _read_robot(fields["robot"])
    number = {f"{patch}/{cell}": i for i, (patch, cell) in enumerate(robot.cells())}
    activity, unmeasured = None, np.zeros(0, dtype=np.int64)
    if fields["activity"] is not None:
        activity, unmeasured = _read_activity(fields["activity"], robot, number)
    poses = _convert(fields["poses"], dict[str, Any], "poses")
    areas = _convert(fields["areas"], dict[str, Any], "areas")
    parameters = _convert(fields["parameters"], dict[str, Any], "parameters")
    contents = MemoryContents(
        robot=robot,
        activity=activity,
        poses={name: _read_pose(pose, robot, number, f"poses.{name}") for name, pose in poses.items()},
        areas={label: _read_area(cells, number, f"areas.{label}") for label, cells in areas.items()},
        parameters={name: _convert(value, float, f"parameters.{name}") for name, value in parameters.items()},
        unmeasured=unmeasured,
    )
    return StoredMemory.of_version(contents, version)


def _read_version(fields: dict[str, Any]) -> int:
    version = fields["version"]
    known = isinstance(version, int) and not isinstance(version, bool) and 1 <= version <= VERSION
    if fields["format"] != FORMAT or not known:
        raise MemoryFileError(
            f"format = {fields['format']!r}, version = {version!r}: "
            f"{FORMAT!r}, version 1 to {VERSION} is the supported format"
        )
    return int(version)


def _pose_object(robot: RobotIdentity, names: list[str], pose: KeyPose) -> dict[str, Any]:
    weights = None
    if pose.weights is not None:
        weights = {
            name: {joint: weight for joint, weight in zip(robot.joints, row, strict=True) if weight}
            for name, row in zip(names, pose.weights.tolist(), strict=True)
        }
    position_rad = dict(zip(robot.joints, pose.position_rad.tolist(), strict=True))
    return {"position_rad": position_rad, "weights": weights}


def _read_robot(raw: Any) -> RobotIdentity:
    fields = _object(raw, "robot", ("name", "joints", "patches"))
    patches: dict[str, int] = {}
    for i, item in enumerate(_convert(fields["patches"], list[Any], "robot.patches")):
        patch = _object(item, f"robot.patches[{i}]", ("name", "cells"))
        name = _convert(patch["name"], str, f"robot.patches[{i}].name")
        if name in patches:
            raise MemoryFileError(f"robot.patches[{i}].name = {name!r}: duplicate")
        patches[name] = _convert(patch["cells"], int, f"robot.patches[{i}].cells")
    joints = _convert(fields["joints"], tuple[str, ...], "robot.joints")
    return RobotIdentity(_convert(fields["name"], str, "robot.name"), joints, patches)


def _read_activity(
    raw: Any, robot: RobotIdentity, cell_index: dict[str, int]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    rows = _object(raw, "activity", cell_index)
    activity = np.zeros(robot.shape, dtype=np.bool_)
    unmeasured = np.zeros(robot.n_cells, dtype=np.bool_)
    for name, cell in cell_index.items():
        key = f"activity.{name}"
        joints = _convert(rows[name], list[str] | None, key)
        unmeasured[cell] = joints is None
        columns = [_index_of(joint, robot.joints.index, key, "joint") for joint in joints or ()]
        activity[cell, columns] = True
    return activity, np.flatnonzero(unmeasured)


def _read_pose(raw: Any, robot: RobotIdentity, cell_index: dict[str, int], key: str) -> KeyPose:
    fields = _object(raw, key, ("position_rad", "weights"))
    positions = _object(fields["position_rad"], f"{key}.position_rad", robot.joints)
    position_rad = [
        _convert(positions[joint], float, f"{key}.position_rad.{joint}") for joint in robot.joints
    ]
    weights: Floats | None = None
    if fields["weights"] is not None:
        rows = _object(fields["weights"], f"{key}.weights", cell_index)
        weights = np.zeros(robot.shape)
        for name, cell in cell_index.items():
            place = f"{key}.weights.{name}"
            for joint, weight in _convert(rows[name], dict[str, Any], place).items():
                column = _index_of(joint, robot.joints.index, place, "joint")
                weights[cell, column] = _convert(weight, float, f"{place}.{joint}")
    return KeyPose(np.array(position_rad), weights)


def _read_area(raw: Any, cell_index: dict[str, int], key: str) -> NDArray[np.int64]:
    names = _convert(raw, list[str], key)
    cells = [_index_of(name, cell_index.__getitem__, key, "cell") for name in names]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise MemoryFileError(f"{key}[{i}] = {name!r}: duplicate")
    return np.array(sorted(cells), dtype=np.int64)


def _convert(value: Any, kind: type[T] | Any, key: str) -> Any:
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        problem = in_words(str(error))
        raise MemoryFileError(f"{key}: {problem[0].lower()}{problem[1:]}") from None


def _object(raw: Any, key: str, names: Any) -> dict[str, Any]:
    """Convert to an object with exactly these keys."""
    table: dict[str, Any] = _convert(raw, dict[str, Any], key)
    for name in names:
        if name not in table:
            raise MemoryFileError(f"{key}: {name} is missing")
    for name in table:
        if name not in names:
            raise MemoryFileError(f"{key}.{name}: unknown key")
    return table


def _index_of(name: str, index: Callable[[str], int], key: str, kind: str) -> int:
    try:
        return index(name)
    except (LookupError, ValueError):
        raise MemoryFileError(f"{key}: the robot has no {kind} {name!r}") from None
