"""Conversion of memory files of earlier versions, in SQLite or JSON, to the present one."""

from skinnet.errors import MemoryFileError
from skinnet.memory.contents import StoredMemory
from skinnet.memory.json_export import stored_from_json, to_json
from skinnet.memory.sqlite_store import stored_from_sqlite, to_sqlite

__all__ = ["to_present_version"]

_JSON_SUFFIX = ".json"


def to_present_version(name: str, content: bytes) -> tuple[bytes, StoredMemory]:
    """Convert the bytes of a memory file; those of the present version stay as they are.

    Args:
        name: Name of the file, by whose suffix JSON and SQLite differ; errors begin with it.
        content: Its bytes.

    Raises:
        MemoryFileError: they are no memory, damaged, or of a newer version.
    """
    if not name.endswith(_JSON_SUFFIX):
        stored = stored_from_sqlite(content, name)
        return (to_sqlite(stored.contents) if stored.is_old else content), stored
    try:
        stored = stored_from_json(content)
    except MemoryFileError as error:
        raise MemoryFileError(f"{name}: {error}") from None
    return (to_json(stored.contents) if stored.is_old else content), stored
