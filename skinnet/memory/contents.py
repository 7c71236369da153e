"""Memory contents as plain data: structure, key poses with sensory-motor maps, touch areas, parameters.

S cells are numbered over all patches in the robot's order, D joints in the order of its joints. Zeros are
unsigned: SQLite does not keep the sign, and what is read equals what was written, bit for bit.
"""

import hashlib
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import FormatError, MemoryFileError
from skinnet.migration.memories import VERSION, translate_parameters

__all__ = ["KeyPose", "MemoryContents", "RobotIdentity", "StoredMemory", "check_joint_limits"]

_NAME_PATTERN = re.compile(r"[A-Za-z0-9_\-]{1,64}")
_PARAMETER_PATTERN = re.compile(r"[A-Za-z0-9_\-.]{1,128}")
_MAX_CELLS = 1_000_000
_LIMIT_TOLERANCE_RAD = 0.01
"""Tolerance [rad] of poses beyond a joint limit: limits are soft and postures no more accurate (assumed)."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RobotIdentity:
    """Robot identity of a memory: the joints and cells of its maps, poses and areas.

    Attributes:
        name: Name of the robot.
        joints: D joint names, in the order of commands and feedback.
        patches: Number of cells by patch, in the order in which cells are numbered.
    """

    name: str
    joints: tuple[str, ...]
    patches: dict[str, int]

    def __post_init__(self) -> None:
        """Validate joints, patches and names; raise `MemoryFileError` if invalid."""
        _require_name("robot.name", self.name)
        if not self.joints:
            raise MemoryFileError("robot.joints: empty; give at least one joint")
        for joint, count in Counter(self.joints).items():
            if not joint.isprintable() or not joint:
                raise MemoryFileError(
                    f"robot.joints: {joint!r} is not a valid name; use printable characters"
                )
            if count > 1:
                raise MemoryFileError(
                    f"robot.joints: {joint} stands {count} times; joint names must be unique"
                )
        if not self.patches:
            raise MemoryFileError("robot.patches: empty; a memory needs a robot with at least one patch")
        for patch, cells in self.patches.items():
            _require_name("robot.patches", patch)
            if not 1 <= cells <= _MAX_CELLS:
                raise MemoryFileError(f"robot.patches.{patch} = {cells}: 1 to {_MAX_CELLS} cells are allowed")

    @property
    def n_cells(self) -> int:
        """Number of cells S, over all patches."""
        return sum(self.patches.values())

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (S, D) of the activity matrix and of every map."""
        return self.n_cells, len(self.joints)

    def cells(self) -> list[tuple[str, int]]:
        """Return patch and cell number within it of every cell, in order."""
        return [(patch, cell) for patch, n in self.patches.items() for cell in range(n)]

    def require_match(self, robot: "RobotIdentity") -> None:
        """Require the same name, joints and patches as `robot`.

        Raises:
            MemoryFileError: they differ; names the first difference.
        """
        for what, mine, due in (
            ("name", [self.name], [robot.name]),
            ("joints", list(self.joints), list(robot.joints)),
            ("patches", _patch_descriptions(self.patches), _patch_descriptions(robot.patches)),
        ):
            place = next((i for i, (a, b) in enumerate(zip(mine, due, strict=False)) if a != b), None)
            if place is not None:
                raise MemoryFileError(
                    f"belongs to another robot: {what}[{place}] is {mine[place]}; {due[place]} is due"
                )
            if len(mine) != len(due):
                raise MemoryFileError(
                    f"belongs to another robot: it has {len(mine)} {what}; {len(due)} are due"
                )


@dataclass(frozen=True, eq=False)
class KeyPose:
    """Key pose that was taught, with the sensory-motor map explored at it.

    Attributes:
        position_rad: (D,) joint positions [rad].
        weights: (S, D) weights of the sensory-motor map, −1 to 1; None if not explored.
    """

    position_rad: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        """Store read-only copies of the arrays."""
        object.__setattr__(self, "position_rad", _read_only(self.position_rad))
        if self.weights is not None:
            object.__setattr__(self, "weights", _read_only(self.weights))


@dataclass(frozen=True, eq=False)
class MemoryContents:
    """Memory contents of a robot.

    Attributes:
        robot: Identity of the robot.
        activity: (S, D) activity matrix of the structural exploration: DoF d moves cell s; None before.
        poses: Key poses by name, the oldest first.
        areas: Touch areas by label: (n,) cell numbers, ascending.
        parameters: Tuned parameters by name.
        unmeasured: (n,) numbers of cells without data from the exploration, ascending.
    """

    robot: RobotIdentity
    activity: NDArray[np.bool_] | None = None
    poses: dict[str, KeyPose] = field(default_factory=dict)
    areas: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    unmeasured: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        """Store read-only copies and validate them.

        Raises:
            MemoryFileError: an entry does not match the robot, is not finite, or is empty; names it.
        """
        activity = None if self.activity is None else _read_only(self.activity, np.bool_)
        areas = {label: _read_only(cells, np.int64) for label, cells in self.areas.items()}
        own = {
            "activity": activity,
            "poses": dict(self.poses),
            "areas": areas,
            "parameters": {name: float(value) + 0.0 for name, value in self.parameters.items()},
            "unmeasured": _read_only(self.unmeasured, np.int64),
        }
        for name, value in own.items():
            object.__setattr__(self, name, value)
        self._check_activity()
        for name, pose in self.poses.items():
            _require_name("poses", name)
            self._check_pose(f"poses.{name}", pose)
        for label, cells in self.areas.items():
            _require_name("areas", label)
            if not len(cells):
                raise MemoryFileError(f"areas.{label}: has no cells; a touch area needs at least one cell")
            self._check_cells(f"areas.{label}", cells)
        for name, number in self.parameters.items():
            if _PARAMETER_PATTERN.fullmatch(name) is None:
                raise MemoryFileError(
                    f"parameters: {name!r} is not a valid name; use 1 to 128 letters, digits, _, - and ."
                )
            _require_finite(f"parameters.{name}", np.array(number))

    def digest(self) -> str:
        """Return the SHA-256 of all contents, independent of platform."""
        activity = None if self.activity is None else self.activity.tobytes()
        content: list[Any] = [
            [self.robot.name, self.robot.joints, list(self.robot.patches.items())],
            [activity, _bytes(self.unmeasured)],
            [[name, _bytes(p.position_rad), _bytes(p.weights)] for name, p in self.poses.items()],
            [[label, _bytes(cells)] for label, cells in sorted(self.areas.items())],
            [[name, float(value)] for name, value in sorted(self.parameters.items())],
        ]
        return hashlib.sha256(msgspec.msgpack.encode(content)).hexdigest()

    def _check_activity(self) -> None:
        if self.activity is None:
            if len(self.unmeasured):
                raise MemoryFileError("unmeasured: given without an activity matrix")
            return
        _require_shape("activity", self.activity, self.robot.shape)
        self._check_cells("unmeasured", self.unmeasured)
        moved = np.flatnonzero(self.activity[self.unmeasured].any(axis=1))
        if len(moved):
            raise MemoryFileError(
                f"activity: cell {self.unmeasured[moved[0]]} is marked both active and unmeasured"
            )

    def _check_pose(self, key: str, pose: KeyPose) -> None:
        _require_shape(f"{key}.position_rad", pose.position_rad, (len(self.robot.joints),))
        _require_finite(f"{key}.position_rad", pose.position_rad)
        if pose.weights is not None:
            _require_shape(f"{key}.weights", pose.weights, self.robot.shape)
            _require_finite(f"{key}.weights", pose.weights)

    def _check_cells(self, key: str, cells: NDArray[np.int64]) -> None:
        if cells.ndim != 1 or not (np.diff(cells) > 0).all():
            raise MemoryFileError(f"{key}: cell numbers must be ascending and unique")
        outside = cells[(cells < 0) | (cells >= self.robot.n_cells)]
        if len(outside):
            raise MemoryFileError(f"{key}: unknown cell {outside[0]}; {self.robot.n_cells} are there")


class StoredMemory(NamedTuple):
    """Stored memory as read: its contents under present names, and the version of the file.

    Attributes:
        contents: Contents under present names.
        version: Version of the file.
        n_renamed: Number of names that its version called otherwise.
    """

    contents: MemoryContents
    version: int
    n_renamed: int

    @property
    def is_old(self) -> bool:
        """Test whether the file is of an earlier version."""
        return self.version < VERSION

    @classmethod
    def of_version(cls, contents: MemoryContents, version: int) -> "StoredMemory":
        """Translate contents that were read from a file of `version`.

        Raises:
            MemoryFileError: an old name stands beside its new one.
        """
        if version == VERSION:
            return cls(contents, version, 0)
        try:
            parameters, n_renamed = translate_parameters(contents.parameters)
        except FormatError as error:
            raise MemoryFileError(str(error)) from None
        return cls(replace(contents, parameters=parameters), version, n_renamed)


def check_joint_limits(memory: MemoryContents, range_rad: Floats) -> None:
    """Check all key poses against the joint limits.

    Args:
        memory: Memory contents.
        range_rad: (D, 2) least and greatest position of every joint [rad].

    Raises:
        MemoryFileError: a pose is outside; names pose, joint, position and limits.
    """
    for name, pose in memory.poses.items():
        for joint, position, (lower, upper) in zip(
            memory.robot.joints, pose.position_rad, range_rad, strict=True
        ):
            if not lower - _LIMIT_TOLERANCE_RAD <= position <= upper + _LIMIT_TOLERANCE_RAD:
                raise MemoryFileError(
                    f"poses.{name}: {joint} = {position:g}: the joint goes from {lower:g} to {upper:g} "
                    "(rad; m if it slides)"
                )


def _patch_descriptions(patches: dict[str, int]) -> list[str]:
    return [f"{patch} of {cells} cells" for patch, cells in patches.items()]


def _read_only(array: NDArray[Any], dtype: Any = np.float64) -> NDArray[Any]:
    """Return a read-only copy; zeros lose their sign."""
    copy = np.array(array, dtype=dtype, order="C")
    if copy.dtype == np.float64:
        copy += 0.0
    copy.setflags(write=False)
    return copy


def _bytes(array: NDArray[Any] | None) -> bytes | None:
    return None if array is None else array.astype(array.dtype.newbyteorder("<")).tobytes()


def _require_name(key: str, name: str) -> None:
    if _NAME_PATTERN.fullmatch(name) is None:
        raise MemoryFileError(f"{key}: {name!r} is not a valid name; use 1 to 64 letters, digits, _ and -")


def _require_shape(key: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise MemoryFileError(f"{key}: has the shape {array.shape}; {shape} is due for this robot")


def _require_finite(key: str, array: Floats) -> None:
    if not np.isfinite(array).all():
        raise MemoryFileError(f"{key}: contains a value that is not finite")
