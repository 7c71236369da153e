"""What a robot keeps for good, as plain data: structure, key poses with their maps, touch areas, parameters.

S cells are numbered through all patches in the order of the robot, D joints in the order of its joints. Zeros
have no sign: SQLite keeps none, and what is read is what was written, to the bit.
"""

import hashlib
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import MemoryFileError

__all__ = ["KeyPose", "Memory", "Robot", "check_limits"]

_NAME = re.compile(r"[A-Za-z0-9_\-]{1,64}")
_PARAMETER = re.compile(r"[A-Za-z0-9_\-.]{1,128}")
_MOST_CELLS = 1_000_000
_GIVE_RAD = 0.01
"""So far beyond a limit a pose may lie: limits give a little, and postures are no more accurate (assumed)."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Robot:
    """Whose memory it is: what maps, poses and areas are about.

    Attributes:
        name: Of the robot.
        joints: D names, in the order of commands and feedback.
        patches: Number of cells of each patch, in the order in which cells are numbered.
    """

    name: str
    joints: tuple[str, ...]
    patches: dict[str, int]

    def __post_init__(self) -> None:
        """Refuses a robot without joints or skin, and names that cannot be told apart."""
        _require_name("robot.name", self.name)
        if not self.joints:
            raise MemoryFileError("robot.joints: there are none; a robot has at least one")
        for joint, count in Counter(self.joints).items():
            if not joint.isprintable() or not joint:
                raise MemoryFileError(f"robot.joints: {joint!r} is no name; give visible characters")
            if count > 1:
                raise MemoryFileError(
                    f"robot.joints: {joint} stands {count} times; every joint needs its own"
                )
        if not self.patches:
            raise MemoryFileError("robot.patches: there are none; a memory is one of a robot with skin")
        for patch, cells in self.patches.items():
            _require_name("robot.patches", patch)
            if not 1 <= cells <= _MOST_CELLS:
                raise MemoryFileError(
                    f"robot.patches.{patch} = {cells}: 1 to {_MOST_CELLS} cells are allowed"
                )

    @property
    def n_cells(self) -> int:
        """S, over all patches."""
        return sum(self.patches.values())

    @property
    def shape(self) -> tuple[int, int]:
        """(S, D) of the activity matrix and of every map."""
        return self.n_cells, len(self.joints)

    def cells(self) -> list[tuple[str, int]]:
        """Patch and number within it of every cell, in their order."""
        return [(patch, cell) for patch, n in self.patches.items() for cell in range(n)]

    def require_same(self, robot: "Robot") -> None:
        """Refuses to be another robot than `robot`.

        Raises:
            MemoryFileError: says in what they differ.
        """
        for what, mine, due in (
            ("name", [self.name], [robot.name]),
            ("joints", list(self.joints), list(robot.joints)),
            ("patches", _sizes(self.patches), _sizes(robot.patches)),
        ):
            place = next((i for i, (a, b) in enumerate(zip(mine, due, strict=False)) if a != b), None)
            if place is not None:
                raise MemoryFileError(
                    f"is of another robot: {what}[{place}] is {mine[place]}; {due[place]} is due"
                )
            if len(mine) != len(due):
                raise MemoryFileError(f"is of another robot: it has {len(mine)} {what}; {len(due)} are due")


@dataclass(frozen=True, eq=False)
class KeyPose:
    """A pose that was taught, and the sensory-motor map that holds around it.

    Attributes:
        position_rad: (D,) positions of the joints [rad].
        weights: (S, D) map explored there, in weights −1 to 1; None if none was.
    """

    position_rad: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        """Takes copies that nobody changes."""
        object.__setattr__(self, "position_rad", _frozen(self.position_rad))
        if self.weights is not None:
            object.__setattr__(self, "weights", _frozen(self.weights))


@dataclass(frozen=True, eq=False)
class Memory:
    """All that a robot remembers.

    Attributes:
        robot: Whose memory it is.
        activity: (S, D) DoF d moves cell s, from the structural exploration; None before.
        poses: Key poses by name, the oldest first.
        areas: Touch areas by label: (n,) numbers of their cells, ascending.
        parameters: Tuned numbers by name.
        unmeasured: (n,) numbers of the cells of which the exploration says nothing, ascending.
    """

    robot: Robot
    activity: NDArray[np.bool_] | None = None
    poses: dict[str, KeyPose] = field(default_factory=dict)
    areas: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    unmeasured: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        """Takes copies that nobody changes.

        Raises:
            MemoryFileError: a part does not fit the robot, is not finite, or is empty; names it.
        """
        activity = None if self.activity is None else _frozen(self.activity, np.bool_)
        areas = {label: _frozen(cells, np.int64) for label, cells in self.areas.items()}
        own = {
            "activity": activity,
            "poses": dict(self.poses),
            "areas": areas,
            "parameters": {name: float(value) + 0.0 for name, value in self.parameters.items()},
            "unmeasured": _frozen(self.unmeasured, np.int64),
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
                raise MemoryFileError(f"areas.{label}: has no cells; brush over at least one")
            self._check_cells(f"areas.{label}", cells)
        for name, number in self.parameters.items():
            if _PARAMETER.fullmatch(name) is None:
                raise MemoryFileError(
                    f"parameters: {name!r} is no name; letters, digits, _, - and . are allowed"
                )
            _require_finite(f"parameters.{name}", np.array(number))

    def digest(self) -> str:
        """SHA-256 of all of it, the same wherever it is computed."""
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
            raise MemoryFileError(f"activity: cell {self.unmeasured[moved[0]]} is active, and not measured")

    def _check_pose(self, key: str, pose: KeyPose) -> None:
        _require_shape(f"{key}.position_rad", pose.position_rad, (len(self.robot.joints),))
        _require_finite(f"{key}.position_rad", pose.position_rad)
        if pose.weights is not None:
            _require_shape(f"{key}.weights", pose.weights, self.robot.shape)
            _require_finite(f"{key}.weights", pose.weights)

    def _check_cells(self, key: str, cells: NDArray[np.int64]) -> None:
        if cells.ndim != 1 or not (np.diff(cells) > 0).all():
            raise MemoryFileError(f"{key}: cells must ascend, each once")
        outside = cells[(cells < 0) | (cells >= self.robot.n_cells)]
        if len(outside):
            raise MemoryFileError(f"{key}: there is no cell {outside[0]}; {self.robot.n_cells} are there")


def check_limits(memory: Memory, range_rad: Floats) -> None:
    """Compares all key poses with what the joints can do.

    Args:
        memory: What is remembered.
        range_rad: (D, 2) least and largest position of every joint [rad].

    Raises:
        MemoryFileError: names pose, joint, position and limits.
    """
    for name, pose in memory.poses.items():
        for joint, position, (lower, upper) in zip(
            memory.robot.joints, pose.position_rad, range_rad, strict=True
        ):
            if not lower - _GIVE_RAD <= position <= upper + _GIVE_RAD:
                raise MemoryFileError(
                    f"poses.{name}: {joint} = {position:g}: the joint turns from {lower:g} to {upper:g} rad"
                )


def _sizes(patches: dict[str, int]) -> list[str]:
    return [f"{patch} of {cells} cells" for patch, cells in patches.items()]


def _frozen(array: NDArray[Any], dtype: Any = np.float64) -> NDArray[Any]:
    """A copy that cannot be written; zeros lose their sign."""
    copy = np.array(array, dtype=dtype, order="C")
    if copy.dtype == np.float64:
        copy += 0.0
    copy.setflags(write=False)
    return copy


def _bytes(array: NDArray[Any] | None) -> bytes | None:
    return None if array is None else array.astype(array.dtype.newbyteorder("<")).tobytes()


def _require_name(key: str, name: str) -> None:
    if _NAME.fullmatch(name) is None:
        raise MemoryFileError(f"{key}: {name!r} is no name; 1 to 64 letters, digits, _ and - are allowed")


def _require_shape(key: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise MemoryFileError(f"{key}: has the shape {array.shape}; {shape} is due for this robot")


def _require_finite(key: str, array: Floats) -> None:
    if not np.isfinite(array).all():
        raise MemoryFileError(f"{key}: holds a value that is not finite")
