"""SQLite memory files: one writer at a time, atomic transactions, full validation on reading.

A file is an SQLite database with a rollback journal. A kill at any moment leaves the state before or after
the current transaction: the next process that opens the file, to write or to read, rolls it back.
"""

import contextlib
import dataclasses
import sqlite3
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from skinnet.errors import MemoryFileError
from skinnet.files import write_bytes
from skinnet.memory import sqlite_tables as tables
from skinnet.memory.contents import KeyPose, MemoryContents, RobotIdentity, StoredMemory
from skinnet.migration.memories import VERSION
from skinnet.migration.renaming import remark_old_format

__all__ = [
    "APPLICATION_ID",
    "VERSION",
    "MemoryStore",
    "read_memory",
    "read_stored",
    "stored_from_sqlite",
    "to_sqlite",
    "write_memory",
]

APPLICATION_ID = 0x736B696E
"""SQLite application id 'skin', which identifies memory files."""
_LOCK_TIMEOUT_S = 0.5
"""Lock timeout [s]: readers hold the file for some milliseconds, writers for a run."""
_JOURNAL_SUFFIXES = ("-journal", "-wal", "-shm")
_ERROR_MESSAGES = {
    "SQLITE_NOTADB": "is not an SQLite file; create a memory by a run or with `skinnet memory import`",
    "SQLITE_BUSY": "is locked by another process; wait until its run ends",
    "SQLITE_CANTOPEN": "cannot be opened; check the permissions of the file and its directory",
    "SQLITE_READONLY": "cannot be written; check its permissions",
}


class MemoryStore:
    """Memory store of a running robot, with an exclusive lock on its file.

    Each change is atomic, and durable when the method returns. A refused change leaves the file and
    its contents unchanged.
    """

    def __init__(self, path: Path, db: sqlite3.Connection, memory: MemoryContents) -> None:
        """Initialise; use `create` or `open` instead."""
        self._path = path
        self._db = db
        self._memory = memory

    @classmethod
    def create(cls, path: Path, robot: RobotIdentity, initial: MemoryContents | None = None) -> Self:
        """Create a memory file with the contents `initial`, replacing an existing file.

        Raises:
            MemoryFileError: another process uses the existing file.
        """
        write_memory(path, MemoryContents(robot) if initial is None else initial)
        return cls.open(path, robot)

    @classmethod
    def open(cls, path: Path, robot: RobotIdentity) -> Self:
        """Open an existing memory file for writing, and rewrite it if it is of an earlier version.

        Raises:
            MemoryFileError: the file is missing, not a memory, of another version or robot, damaged, or in
                use; the message is one line.
        """
        with contextlib.ExitStack() as undo:
            db = undo.enter_context(contextlib.closing(_connect(path)))
            with _translated_errors(path):
                db.execute("PRAGMA locking_mode = EXCLUSIVE")
                db.execute("PRAGMA foreign_keys = ON")
                db.execute("PRAGMA synchronous = EXTRA")
                db.execute("BEGIN EXCLUSIVE")
                stored = _read_contents(db)
                stored.contents.robot.require_match(robot)
                if stored.is_old:
                    _upgrade(db, stored.contents)
                db.execute("COMMIT")  # in this mode, it keeps the lock
            undo.pop_all()
        return cls(path, db, stored.contents)

    @property
    def contents(self) -> MemoryContents:
        """Memory contents of the file."""
        return self._memory

    def store_structure(
        self, activity: NDArray[np.bool_], unmeasured: NDArray[np.int64] | None = None
    ) -> None:
        """Store an activity matrix (S, D) and the cells (n,) that were not measured."""
        unmeasured = np.zeros(0, dtype=np.int64) if unmeasured is None else unmeasured
        memory = dataclasses.replace(self._memory, activity=activity, unmeasured=unmeasured)
        with self._transaction(memory):
            tables.put_activity(self._db, memory)

    def store_pose(self, name: str, pose: KeyPose) -> None:
        """Store a key pose, replacing one of that name."""
        memory = dataclasses.replace(self._memory, poses=self._memory.poses | {name: pose})
        with self._transaction(memory):
            tables.put_pose(self._db, memory.robot, name, memory.poses[name])

    def store_area(self, label: str, cells: NDArray[np.int64]) -> None:
        """Store a touch area of cells (n,), ascending, replacing one of that label."""
        memory = dataclasses.replace(self._memory, areas=self._memory.areas | {label: cells})
        with self._transaction(memory):
            tables.put_area(self._db, memory.robot, label, memory.areas[label])

    def store_parameters(self, parameters: Mapping[str, float]) -> None:
        """Store parameters, replacing those of the same names."""
        memory = dataclasses.replace(self._memory, parameters=self._memory.parameters | dict(parameters))
        with self._transaction(memory):
            tables.put_parameters(self._db, memory.parameters)

    def replace_contents(self, memory: MemoryContents) -> None:
        """Replace all contents by `memory`, which must be of the same robot."""
        memory.robot.require_match(self._memory.robot)
        with self._transaction(memory):
            tables.put_content(self._db, memory)

    def close(self) -> None:
        """Close the file and release its lock."""
        self._db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextlib.contextmanager
    def _transaction(self, memory: MemoryContents) -> Iterator[None]:
        """Commit the changes of the block with the digest of `memory`, or roll back on error."""
        with _translated_errors(self._path):
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield
                tables.store_digest(self._db, memory)
                self._db.execute("COMMIT")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")
                raise
        self._memory = memory


def read_memory(path: Path) -> MemoryContents:
    """Read the memory contents of a file; an earlier version is remarked upon once.

    Raises:
        MemoryFileError: as for `MemoryStore.open`.
    """
    stored = read_stored(path)
    if stored.is_old:
        remark_old_format(path, "memory")
    return stored.contents


def read_stored(path: Path) -> StoredMemory:
    """Read the memory contents of a file with its version.

    Raises:
        MemoryFileError: as for `MemoryStore.open`.
    """
    with contextlib.closing(_connect(path)) as db, _translated_errors(path):
        db.execute("BEGIN")
        return _read_contents(db)


def write_memory(path: Path, memory: MemoryContents) -> None:
    """Write a memory file atomically: a kill leaves either the previous file or the new one.

    Raises:
        MemoryFileError: the previous file is in use.
    """
    content = to_sqlite(memory)
    file = path.resolve()
    with _locked_for_replacement(file):
        write_bytes(file, content)


def to_sqlite(memory: MemoryContents) -> bytes:
    """Encode a memory as the bytes of an SQLite file."""
    with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as db:
        db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        db.execute(f"PRAGMA user_version = {VERSION}")
        db.executescript(tables.SCHEMA)
        tables.put_all(db, memory)
        return db.serialize()


def stored_from_sqlite(content: bytes, source: str) -> StoredMemory:
    """Decode a memory from the bytes of an SQLite file; `source` names it in errors.

    Raises:
        MemoryFileError: as for `MemoryStore.open`.
    """
    with (
        contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as db,
        _translated_errors(Path(source)),
    ):
        db.deserialize(content)
        return _read_contents(db)


@contextlib.contextmanager
def _locked_for_replacement(path: Path) -> Iterator[None]:
    """Lock an existing database file while another replaces it.

    Its journal files are deleted, so that SQLite does not roll the new file back to the old state.
    """
    if not path.exists():
        yield
        return
    with contextlib.closing(_connect(path)) as db:
        try:
            db.execute("BEGIN EXCLUSIVE")
        except (sqlite3.Error, UnicodeDecodeError) as error:  # not a database, so not open as one
            if _error_code(error) == "SQLITE_BUSY":
                raise MemoryFileError(f"{path}: {_ERROR_MESSAGES['SQLITE_BUSY']}") from None
        for suffix in _JOURNAL_SUFFIXES:
            path.with_name(path.name + suffix).unlink(missing_ok=True)
        yield


def _connect(path: Path) -> sqlite3.Connection:
    if not path.is_file():
        raise MemoryFileError(f"{path}: {'is not a file' if path.exists() else 'there is no such file'}")
    uri = f"{path.resolve().as_uri()}?mode=rw"
    with _translated_errors(path):
        return sqlite3.connect(uri, uri=True, isolation_level=None, timeout=_LOCK_TIMEOUT_S)


def _upgrade(db: sqlite3.Connection, memory: MemoryContents) -> None:
    """Rewrite a database of an earlier version, within the transaction of the caller."""
    tables.put_content(db, memory)
    tables.store_digest(db, memory)
    db.execute(f"PRAGMA user_version = {VERSION}")


def _read_contents(db: sqlite3.Connection) -> StoredMemory:
    """Read the memory contents of a database after all checks, that of the digest included."""
    db.execute("PRAGMA trusted_schema = OFF")
    (application,) = db.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        raise MemoryFileError("is an SQLite database, but not a skinnet memory")
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if not 1 <= version <= VERSION:
        what = "newer; update skinnet" if version > VERSION else "of no skinnet that was ever published"
        raise MemoryFileError(
            f"has version {version} of the schema, and this skinnet reads 1 to {VERSION}: it is {what}"
        )
    try:
        problems = db.execute("PRAGMA integrity_check (1)").fetchone()
        if problems != ("ok",):
            raise MemoryFileError(str(problems[0]))
        if tables.schema_statements(db) != _expected_schema():
            raise MemoryFileError("its tables do not match the schema of this version")
        return StoredMemory.of_version(tables.read_tables(db), version)
    except (MemoryFileError, ValueError, TypeError, OverflowError) as error:
        # rows that no version of this program would write
        raise MemoryFileError(f"is damaged: {_one_line(error)}") from None


def _expected_schema() -> list[str]:
    with contextlib.closing(sqlite3.connect(":memory:")) as db:
        db.executescript(tables.SCHEMA)
        return tables.schema_statements(db)


@contextlib.contextmanager
def _translated_errors(path: Path) -> Iterator[None]:
    """Convert SQLite errors to `MemoryFileError` with path and cause."""
    try:
        yield
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None
    except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite's message may quote invalid text
        reason = _ERROR_MESSAGES.get(_error_code(error), f"is damaged or cannot be used: {_one_line(error)}")
        raise MemoryFileError(f"{path}: {reason}") from None


def _one_line(error: Exception) -> str:
    """Return an error message as one line of at most 200 characters; SQLite may quote whole tables."""
    return textwrap.shorten(str(error), 200, placeholder=" …")


def _error_code(error: Exception) -> str:
    """Return the primary SQLite error code name, without its extension."""
    return "_".join(getattr(error, "sqlite_errorname", "").split("_")[:2])
