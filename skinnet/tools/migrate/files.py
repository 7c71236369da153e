"""Files of earlier formats recognised by their content, with what rewrites each."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from skinnet.deployment import Deployment
from skinnet.deployment.extends import EXTENDS
from skinnet.errors import FormatError, MemoryFileError, SkinnetError
from skinnet.files import write_bytes, write_json
from skinnet.memory.conversion import to_present_version
from skinnet.memory.json_export import FORMAT as MEMORY_JSON
from skinnet.memory.sqlite_store import MemoryStore, read_stored, write_memory
from skinnet.migration import deployments
from skinnet.migration.format_1 import DEPLOYMENT_KEYS
from skinnet.migration.summaries import translate_summary
from skinnet.tools.migrate.deployment_toml import migrated_toml

__all__ = ["Migration", "migration_of"]

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_SQLITE_MAGIC = b"SQLite format 3\x00"
_OLD_TABLES = frozenset(key for key in DEPLOYMENT_KEYS if "." not in key)
_DEPLOYMENT_TABLES = _OLD_TABLES | {*Deployment.__struct_fields__, deployments.FORMAT_KEY, EXTENDS}
"""Keys that a deployment of any format, or a file that one extends, may have at its top."""
_SUMMARY_KEYS = ("metrics", "figures", "runs")


class Migration(NamedTuple):
    """Migration of one file.

    Attributes:
        kind: Kind of the file, in words.
        n_renamed: Number of names that the file's format called otherwise.
        write: Writes the file in the present format to a path, atomically; None if it is of that format.
    """

    kind: str
    n_renamed: int
    write: Callable[[Path], None] | None


def migration_of(path: Path) -> Migration:
    """Recognise a file by its content, and find out what its migration changes. Nothing is written.

    Raises:
        SkinnetError: the file cannot be read, is of no kind or of a newer format, or is damaged; one line.
    """
    if path.is_dir():
        raise FormatError(f"{path}: is a folder; give the files in it")
    try:
        with path.open("rb") as file:
            head = file.read(len(_SQLITE_MAGIC))
        if head.startswith(_MCAP_MAGIC):
            return _of_recording(path)
        if head == _SQLITE_MAGIC:
            return _of_memory(path)
        content = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    try:
        text = content.decode()
    except UnicodeDecodeError:
        raise _unknown(path, "it is neither text nor a recording nor a memory") from None
    return _of_json(path, content) if text.lstrip().startswith("{") else _of_toml(path, text)


def _of_recording(path: Path) -> Migration:
    from skinnet.recording.reader import Recording  # needs the extra `record`
    from skinnet.tools.migrate.recording_file import count_renamed, rewrite_recording

    recording = Recording(path, remark=False)
    translator = recording.translator
    if translator is None:
        return Migration("recording", 0, None)
    return Migration(
        "recording",
        count_renamed(path, translator),
        lambda target: rewrite_recording(path, target, translator, complete=recording.complete),
    )


def _of_memory(path: Path) -> Migration:
    stored = read_stored(path)

    def write(target: Path) -> None:
        if target.exists() and target.samefile(path):
            MemoryStore.open(path, stored.contents.robot).close()  # in a transaction, under the file's lock
        else:
            write_memory(target, stored.contents)

    return Migration("memory", stored.n_renamed, write if stored.is_old else None)


def _of_json(path: Path, content: bytes) -> Migration:
    try:
        raw = msgspec.json.decode(content)
    except (msgspec.DecodeError, RecursionError) as error:
        raise _unknown(path, f"invalid JSON: {error}") from None
    if raw.get("format") == MEMORY_JSON:
        return _of_memory_json(path, content)
    if any(isinstance(raw.get(key), dict | list) for key in _SUMMARY_KEYS):
        summary, n_renamed = translate_summary(raw, str(path))
        write = None if n_renamed is None else lambda target: write_json(target, summary)
        return Migration("summary", n_renamed or 0, write)
    _require_deployment(path, raw)
    document, n_renamed = deployments.translate(raw, str(path))
    if deployments.require_known(raw, str(path)) == deployments.FORMAT:
        return Migration("deployment", 0, None)
    document = {deployments.FORMAT_KEY: deployments.FORMAT, **document}
    text = msgspec.json.format(msgspec.json.encode(document), indent=1)
    return Migration("deployment", n_renamed, lambda target: write_bytes(target, text))


def _of_memory_json(path: Path, content: bytes) -> Migration:
    try:
        text, stored = to_present_version(".json", content)
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {str(error).removeprefix('.json: ')}") from None
    return Migration(
        "memory", stored.n_renamed, (lambda target: write_bytes(target, text)) if stored.is_old else None
    )


def _of_toml(path: Path, text: str) -> Migration:
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _unknown(path, f"no valid TOML: {error}") from None
    _require_deployment(path, raw)
    if deployments.require_known(raw, str(path)) == deployments.FORMAT:
        return Migration("deployment", 0, None)
    document = {key: value for key, value in raw.items() if key != EXTENDS}
    n_renamed = deployments.translate(document, str(path))[1]
    migrated = migrated_toml(text, str(path))
    return Migration("deployment", n_renamed, lambda target: write_bytes(target, migrated.encode()))


def _require_deployment(path: Path, raw: dict[str, Any]) -> None:
    unknown = next((key for key in raw if key not in _DEPLOYMENT_TABLES), None)
    if unknown is not None or not raw:
        raise _unknown(path, "it is empty" if unknown is None else f"no deployment has the key {unknown}")


def _unknown(path: Path, reason: str) -> SkinnetError:
    return FormatError(
        f"{path}: no deployment, memory, recording or summary of skinnet: {' '.join(reason.split())}"
    )
