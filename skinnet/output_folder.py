"""Output folder of a program: one owner at a time, a marker that names it, a list of the files it wrote.

A program locks a folder before its first write and holds the lock to its end; the operating system releases
it if the program dies. A folder that holds anything else than an earlier output of the same program is
refused as it stands, and of an earlier output only the listed files are removed.
"""

import contextlib
import fcntl
import hashlib
import os
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from skinnet.errors import RunFolderError
from skinnet.files import write_json

__all__ = [
    "MARKER",
    "OwnedFolder",
    "RunIdentity",
    "add_output_file",
    "check_output_folder",
    "identity_of",
    "new_folder",
    "own_folder",
    "sha256_of",
]

MARKER = "skinnet.json"
"""File that marks an output folder."""
_LOCK = ".skinnet.lock"
_OWN_PREFIX = ".skinnet"
"""Prefix of the lock, and of a marker whose writing a kill interrupted."""
_FORMAT = 1
_NO_FILE = FileNotFoundError, NotADirectoryError, IsADirectoryError
_MAX_NAMED = 3


@dataclass(frozen=True)
class RunIdentity:
    """Identity of a run: a random id, and the SHA-256 of its resolved deployment."""

    run_id: str
    deployment_sha256: str


class _Marker(msgspec.Struct, frozen=True, kw_only=True):
    """Content of the marker; `files` are names of files, below the folder, that the run writes."""

    program: str
    run_id: str
    deployment_sha256: str
    files: tuple[str, ...]
    format: int = _FORMAT

    @property
    def identity(self) -> RunIdentity:
        return RunIdentity(self.run_id, self.deployment_sha256)


@dataclass(frozen=True)
class OwnedFolder:
    """Output folder that this process owns.

    Attributes:
        path: The folder.
        identity: Identity of the run that writes it.
        lock: File descriptor of the lock; a child process that inherits it owns the folder, too.
    """

    path: Path
    identity: RunIdentity
    lock: int

    def require_ownership(self) -> None:
        """Require that the folder is still that of this run, which a deletion from outside may have ended.

        Raises:
            RunFolderError: it is not.
        """
        if identity_of(self.path) != self.identity:
            raise RunFolderError(
                f"folder {self.path}: deleted or replaced during the run; its results are lost: run it again"
            )


def sha256_of(deployment: bytes) -> str:
    """Return the SHA-256 of a resolved deployment, in hexadecimal digits."""
    return hashlib.sha256(deployment).hexdigest()


def check_output_folder(path: Path, program: str, files: Iterable[str] = ()) -> None:
    """Require that `program` may write `files` into the folder `path`; nothing is changed.

    Raises:
        RunFolderError: it is no folder, holds files that are not of an earlier run of `program`, or has one
            of `files` from elsewhere.
    """
    _earlier_marker(path, program, files)


@contextlib.contextmanager
def own_folder(path: Path, program: str, deployment: bytes, files: Iterable[str]) -> Iterator[OwnedFolder]:
    """Own the output folder `path` while the block runs; an earlier output of the same program is removed.

    Args:
        path: Folder; made if it does not exist.
        program: Program that writes it, as the user calls it.
        deployment: Resolved deployment, which the marker identifies.
        files: Names of all files that may be written, relative to the folder.

    Raises:
        RunFolderError: another process owns it; or as `check_output_folder`.
    """
    names = tuple(sorted(files))
    _earlier_marker(path, program, names)  # a foreign folder does not even get the lock's file
    path.mkdir(parents=True, exist_ok=True)
    with _locked(path) as lock:
        earlier = _earlier_marker(path, program, names)
        if earlier is not None:
            _remove(path, earlier.files)
        identity = RunIdentity(uuid.uuid4().hex, sha256_of(deployment))
        marker = _Marker(
            program=program,
            run_id=identity.run_id,
            deployment_sha256=identity.deployment_sha256,
            files=names,
        )
        _write_marker(path, marker)
        try:
            yield OwnedFolder(path, identity, lock)
        finally:
            if identity_of(path) == identity:
                with contextlib.suppress(OSError):  # then the list stays as it was planned
                    written = tuple(name for name in names if (path / name).exists())
                    _write_marker(path, msgspec.structs.replace(marker, files=written))


def add_output_file(path: Path, name: str) -> None:
    """List `name`, about to be written into the folder of an ended run, among its files.

    A folder without a marker, of an earlier version of this program, has no list and stays as it is.

    Raises:
        RunFolderError: another process owns the folder, or the file is there and was written by others.
    """
    marker = _read_marker(path)
    if marker is None or name in marker.files:
        return
    with _locked(path):
        if (path / name).exists():
            raise RunFolderError(
                f"{path / name}: not written by {marker.program}; move it away, or choose another file"
            )
        _write_marker(path, msgspec.structs.replace(marker, files=tuple(sorted((*marker.files, name)))))


def identity_of(path: Path) -> RunIdentity | None:
    """Return the identity of the run that wrote the folder; None without a marker."""
    marker = _read_marker(path)
    return None if marker is None else marker.identity


def new_folder(path: Path) -> Path:
    """Make a new folder `path`, or with -2, -3, … at its end if others have made it at the same time."""
    number, folder = 1, path
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
            folder = path.with_name(f"{path.name}-{number}")
        else:
            return folder


def _earlier_marker(path: Path, program: str, files: Iterable[str]) -> _Marker | None:
    """Return the marker of an earlier output; None for a new or an empty folder; refuse any other."""
    if not path.exists():
        return None
    if not path.is_dir():
        raise RunFolderError(f"folder {path}: is a file; choose another folder")
    marker = _read_marker(path)
    if marker is None:
        others = sorted(entry.name for entry in path.iterdir() if not entry.name.startswith(_OWN_PREFIX))
        if others:
            more = ", …" if len(others) > _MAX_NAMED else ""
            raise RunFolderError(
                f"folder {path}: not empty, and not written by {program} "
                f"(it has {', '.join(others[:_MAX_NAMED])}{more}); choose a new or an empty folder"
            )
        return None
    if marker.program != program:
        raise RunFolderError(
            f"folder {path}: written by {marker.program}; {program} needs another folder, new or empty"
        )
    for name in files:
        if name not in marker.files and (foreign := _foreign_entry(path, name)) is not None:
            raise RunFolderError(
                f"folder {path}: {foreign} there was not written by {program}, which needs that name; "
                f"move it away, or choose another folder"
            )
    return marker


def _foreign_entry(path: Path, name: str) -> str | None:
    """Return the entry that is in the way of the file `name`: of that name, or a file where its folder is."""
    if os.path.lexists(path / name):
        return name
    folder = (path / name).parent
    return str(folder.relative_to(path)) if os.path.lexists(folder) and not folder.is_dir() else None


def _remove(path: Path, names: Iterable[str]) -> None:
    """Remove the files `names` of an earlier output, and their folders if these are empty then."""
    root = path.resolve()
    folders = set()
    for name in names:
        file = path / name
        if not file.parent.resolve().is_relative_to(root):
            continue  # through a link of the user's
        with contextlib.suppress(*_NO_FILE):
            file.unlink()
        folders.add(file.parent)
    for folder in sorted(folders - {path}, reverse=True):
        with contextlib.suppress(OSError):  # not empty
            folder.rmdir()


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[int]:
    """Lock the folder while the block runs; yield the lock's file descriptor."""
    lock = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(lock, 32, 0).decode(errors="replace").strip()
            raise RunFolderError(
                f"folder {path}: another run is writing there{f' (process {owner})' if owner else ''}; "
                f"wait for its end, or choose another folder"
            ) from None
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
        yield lock
    finally:
        os.close(lock)


def _write_marker(path: Path, marker: _Marker) -> None:
    write_json(path / MARKER, msgspec.to_builtins(marker))


def _read_marker(path: Path) -> _Marker | None:
    """Read the marker; None if there is none, or another program's file has its name."""
    try:
        return msgspec.json.decode((path / MARKER).read_bytes(), type=_Marker)
    except (*_NO_FILE, msgspec.DecodeError, UnicodeDecodeError):
        return None
