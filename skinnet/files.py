"""Atomic file replacement: after a kill, the old file or the new one, never a partial one."""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import msgspec

__all__ = ["atomic_replacement", "write_bytes", "write_json"]

_UMASK = os.umask(0)
os.umask(_UMASK)


@contextmanager
def atomic_replacement(path: Path) -> Iterator[IO[bytes]]:
    """Open a temporary binary file that atomically replaces `path` if the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            os.fchmod(handle, 0o666 & ~_UMASK)  # `mkstemp` makes files that only their owner may read
            yield file
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to `path` atomically."""
    with atomic_replacement(path) as file:
        file.write(content)


def write_json(path: Path, value: Any, enc_hook: Callable[[Any], Any] | None = None) -> None:
    """Write `value` to `path` as indented JSON, atomically."""
    text = msgspec.json.format(msgspec.json.encode(value, enc_hook=enc_hook), indent=2)
    write_bytes(path, text + b"\n")
