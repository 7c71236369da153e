"""SQLite tables of a memory file: conversion of memory contents to rows and back.

Rows hold the names of patches and joints, so that they are readable in any SQLite tool.
"""

import sqlite3
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import MemoryFileError
from skinnet.memory.contents import Floats, KeyPose, MemoryContents, RobotIdentity

__all__ = [
    "SCHEMA",
    "put_activity",
    "put_all",
    "put_area",
    "put_content",
    "put_parameters",
    "put_pose",
    "read_tables",
    "schema_statements",
    "store_digest",
]

SCHEMA = """
CREATE TABLE robot (name TEXT NOT NULL);
CREATE TABLE joint (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE patch (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, cells INTEGER NOT NULL);
CREATE TABLE activity (
  patch TEXT NOT NULL REFERENCES patch (name),
  cell INTEGER NOT NULL,
  joint TEXT NOT NULL REFERENCES joint (name),
  active INTEGER CHECK (active IN (0, 1)), -- NULL: not measured
  PRIMARY KEY (patch, cell, joint)
) WITHOUT ROWID;
CREATE TABLE pose (number INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE pose_joint (
  pose TEXT NOT NULL REFERENCES pose (name),
  joint TEXT NOT NULL REFERENCES joint (name),
  position_rad REAL NOT NULL CHECK (typeof (position_rad) = 'real'),
  PRIMARY KEY (pose, joint)
) WITHOUT ROWID;
CREATE TABLE map (
  pose TEXT NOT NULL REFERENCES pose (name),
  patch TEXT NOT NULL REFERENCES patch (name),
  cell INTEGER NOT NULL,
  joint TEXT NOT NULL REFERENCES joint (name),
  weight REAL NOT NULL CHECK (typeof (weight) = 'real'),
  PRIMARY KEY (pose, patch, cell, joint)
) WITHOUT ROWID;
CREATE TABLE area_cell (
  area TEXT NOT NULL,
  patch TEXT NOT NULL REFERENCES patch (name),
  cell INTEGER NOT NULL,
  PRIMARY KEY (area, patch, cell)
) WITHOUT ROWID;
CREATE TABLE parameter (
  name TEXT PRIMARY KEY,
  value REAL NOT NULL CHECK (typeof (value) = 'real')
) WITHOUT ROWID;
CREATE TABLE seal (sha256 TEXT NOT NULL); -- of the whole content, see Memory.digest
"""
_CONTENT_TABLES = ("activity", "map", "pose_joint", "pose", "area_cell", "parameter")
"""Content tables, referencing tables before referenced ones."""
_UNMEASURED = -1
"""Unmeasured entry of the activity matrix; NULL in the file."""


def schema_statements(db: sqlite3.Connection) -> list[str]:
    """Return the SQL statements of the schema stored in the file."""
    rows = db.execute("SELECT sql FROM sqlite_schema WHERE sql IS NOT NULL ORDER BY rowid")
    return [str(sql) for (sql,) in rows]


def put_all(db: sqlite3.Connection, memory: MemoryContents) -> None:
    """Insert a memory into empty tables, with its digest."""
    robot = memory.robot
    db.execute("INSERT INTO robot VALUES (?)", (robot.name,))
    db.executemany("INSERT INTO joint VALUES (?, ?)", enumerate(robot.joints))
    sizes = ((number, *item) for number, item in enumerate(robot.patches.items()))
    db.executemany("INSERT INTO patch VALUES (?, ?, ?)", sizes)
    put_content(db, memory)
    store_digest(db, memory)


def put_content(db: sqlite3.Connection, memory: MemoryContents) -> None:
    """Replace all contents except the robot."""
    for table in _CONTENT_TABLES:
        db.execute(f"DELETE FROM {table}")
    put_activity(db, memory)
    for name, pose in memory.poses.items():
        put_pose(db, memory.robot, name, pose)
    for label, cells in memory.areas.items():
        put_area(db, memory.robot, label, cells)
    put_parameters(db, memory.parameters)


def put_activity(db: sqlite3.Connection, memory: MemoryContents) -> None:
    """Replace the activity matrix."""
    db.execute("DELETE FROM activity")
    if memory.activity is not None:
        active = memory.activity.astype(np.int64)
        active[memory.unmeasured] = _UNMEASURED
        values = f"(?, ?, ?, NULLIF (?, {_UNMEASURED}))"
        db.executemany(f"INSERT INTO activity VALUES {values}", _entries(memory.robot, active))


def put_pose(db: sqlite3.Connection, robot: RobotIdentity, name: str, pose: KeyPose) -> None:
    """Insert a key pose, replacing one of that name."""
    db.execute("INSERT INTO pose (name) VALUES (?) ON CONFLICT DO NOTHING", (name,))
    db.execute("DELETE FROM pose_joint WHERE pose = ?", (name,))
    db.execute("DELETE FROM map WHERE pose = ?", (name,))
    positions = zip(robot.joints, pose.position_rad.tolist(), strict=True)
    db.executemany("INSERT INTO pose_joint VALUES (?, ?, ?)", ((name, *row) for row in positions))
    if pose.weights is not None:
        rows = ((name, *row) for row in _entries(robot, pose.weights))
        db.executemany("INSERT INTO map VALUES (?, ?, ?, ?, ?)", rows)


def put_area(db: sqlite3.Connection, robot: RobotIdentity, label: str, cells: NDArray[np.int64]) -> None:
    """Insert a touch area of cells (n,), replacing one of that label."""
    db.execute("DELETE FROM area_cell WHERE area = ?", (label,))
    place = robot.cells()
    rows = ((label, *place[cell]) for cell in cells.tolist())
    db.executemany("INSERT INTO area_cell VALUES (?, ?, ?)", rows)


def put_parameters(db: sqlite3.Connection, parameters: Mapping[str, float]) -> None:
    """Insert parameters, replacing those of the same names."""
    db.executemany("INSERT OR REPLACE INTO parameter VALUES (?, ?)", parameters.items())


def store_digest(db: sqlite3.Connection, memory: MemoryContents) -> None:
    """Store the digest of the tables' contents; SQLite alone does not detect a changed number."""
    db.execute("DELETE FROM seal")
    db.execute("INSERT INTO seal VALUES (?)", (memory.digest(),))


def read_tables(db: sqlite3.Connection) -> MemoryContents:
    """Read the memory contents of the tables.

    Raises:
        MemoryFileError: the contents are inconsistent, or differ from the stored digest.
    """
    (name,) = _fetch_one(db, "SELECT name FROM robot")
    joints = tuple(str(joint) for (joint,) in db.execute("SELECT name FROM joint ORDER BY number"))
    sizes = db.execute("SELECT name, cells FROM patch ORDER BY number")
    robot = RobotIdentity(str(name), joints, {str(patch): int(cells) for patch, cells in sizes})
    active = _matrix(db, robot, f"IFNULL (active, {_UNMEASURED})", "activity")
    measured = (
        np.ones(robot.n_cells, dtype=np.bool_) if active is None else (active != _UNMEASURED).any(axis=1)
    )
    names = [str(pose) for (pose,) in db.execute("SELECT name FROM pose ORDER BY number")]
    memory = MemoryContents(
        robot=robot,
        activity=None if active is None else (active == 1.0),
        poses={pose: _pose(db, robot, pose) for pose in names},
        areas=_areas(db, robot),
        parameters=dict(db.execute("SELECT name, value FROM parameter ORDER BY name")),
        unmeasured=np.flatnonzero(~measured),
    )
    (sealed,) = _fetch_one(db, "SELECT sha256 FROM seal")
    if sealed != memory.digest():
        raise MemoryFileError(
            "the contents do not match the stored SHA-256; they were changed outside skinnet"
        )
    return memory


def _entries(robot: RobotIdentity, matrix: NDArray[Any]) -> list[tuple[str, int, str, Any]]:
    """Return patch, cell, joint and value of every entry of an (S, D) matrix."""
    return [
        (patch, cell, joint, value)
        for (patch, cell), row in zip(robot.cells(), matrix.tolist(), strict=True)
        for joint, value in zip(robot.joints, row, strict=True)
    ]


def _pose(db: sqlite3.Connection, robot: RobotIdentity, name: str) -> KeyPose:
    rows = db.execute(
        "SELECT position_rad FROM pose_joint JOIN joint ON name = joint WHERE pose = ? ORDER BY number",
        (name,),
    )
    position_rad = np.array([value for (value,) in rows], dtype=np.float64)
    return KeyPose(position_rad, _matrix(db, robot, "weight", "map", "WHERE pose = ?", name))


def _matrix(
    db: sqlite3.Connection, robot: RobotIdentity, column: str, table: str, where: str = "", *args: str
) -> Floats | None:
    """Read the matrix (S, D) of a column with one entry per cell and joint; None without entries."""
    rows = db.execute(
        f"SELECT {column} FROM {table} JOIN patch ON patch.name = patch JOIN joint ON joint.name = joint "
        f"{where} ORDER BY patch.number, cell, joint.number",
        args,
    )
    values = [value for (value,) in rows]
    if values and len(values) != robot.n_cells * len(robot.joints):
        raise MemoryFileError(f"{len(values)} entries of {table}, for {robot.shape} cells and joints")
    return np.array(values, dtype=np.float64).reshape(robot.shape) if values else None


def _areas(db: sqlite3.Connection, robot: RobotIdentity) -> dict[str, NDArray[np.int64]]:
    number = {place: index for index, place in enumerate(robot.cells())}
    cells: dict[str, list[int]] = {}
    for area, patch, cell in db.execute("SELECT area, patch, cell FROM area_cell ORDER BY area"):
        if (patch, cell) not in number:
            raise MemoryFileError(f"areas.{area}: unknown cell {patch}/{cell}")
        cells.setdefault(area, []).append(number[patch, cell])
    return {area: np.array(sorted(of), dtype=np.int64) for area, of in cells.items()}


def _fetch_one(db: sqlite3.Connection, query: str) -> Any:
    row = db.execute(query).fetchone()
    if row is None:
        raise MemoryFileError(f"no row for query {query}")
    return row
