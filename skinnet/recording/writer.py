"""Recording writer: messages by key, with schemas, metadata and attachments."""

import time
from collections import Counter
from pathlib import Path
from typing import IO

from skinnet import __version__
from skinnet.deployment import Deployment, resolved_json
from skinnet.errors import RecorderError
from skinnet.protocol.channels import Channel, Keys
from skinnet.recording.format import (
    DEPLOYMENT_ATTACHMENT,
    FORMAT,
    MEMORY_PREFIX,
    MESSAGE_ENCODING,
    METADATA_NAME,
    PROFILE,
    SCHEMA_ENCODING,
    json_schema,
    schema_name,
)
from skinnet.recording.mcap_writer import McapWriter

__all__ = ["RecordingWriter"]

_CHUNK_BYTES = 1_000_000
_CHUNK_S = 0.5
"""Chunk size and age at which a chunk is flushed; a kill loses no more than that."""


class RecordingWriter:
    """Writer of one recording.

    Attributes:
        counts: Number of messages by channel name.
    """

    def __init__(self, path: Path, deployment: Deployment, base: Path) -> None:
        """Prepare the writer; `open` creates the file.

        Args:
            path: Path of the file.
            deployment: Deployment of the run.
            base: Folder that relative paths in the deployment start from.
        """
        self.counts: Counter[str] = Counter()
        self._path, self._deployment, self._base = path, deployment, base
        self._keys = Keys(deployment.robot)
        self._channel_of_key: dict[str, tuple[int, str]] = {}
        self._schemas: dict[str, int] = {}
        self._flushed_s = time.monotonic()
        self._file: IO[bytes]
        self._mcap: McapWriter

    def open(self) -> None:
        """Create the file, replacing one of an earlier run, with its metadata and attachments.

        Raises:
            RecorderError: the file cannot be written.
        """
        deployment, base = self._deployment, self._base
        try:
            self._file = self._path.open("wb")
            self._mcap = McapWriter(self._file, PROFILE, f"skinnet {__version__}")
            self._mcap.add_metadata(METADATA_NAME, _metadata(deployment, base))
            self._mcap.add_attachment(DEPLOYMENT_ATTACHMENT, "application/json", resolved_json(deployment))
            if deployment.memory.read is not None:
                memory = base / deployment.memory.read
                self._mcap.add_attachment(
                    MEMORY_PREFIX + memory.name, "application/octet-stream", memory.read_bytes()
                )
        except OSError as error:
            raise self._recorder_error(error) from error

    @property
    def n_bytes(self) -> int:
        """File size so far [bytes]."""
        return self._mcap.n_bytes

    def add(self, key: str, t_ns: int, payload: bytes) -> None:
        """Add an encoded message of the run."""
        known = self._channel_of_key.get(key)
        if known is None:
            known = self._channel_of_key[key] = self._declare_key(key)
        number, name = known
        self.counts[name] += 1
        self._mcap.add_message(number, t_ns, payload)

    def add_channel(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        """Register a channel with its schema (name, encoding, data); return its id."""
        if schema[0] not in self._schemas:
            self._schemas[schema[0]] = self._mcap.add_schema(*schema)
        return self._mcap.add_channel(topic, encoding, self._schemas[schema[0]])

    def add_to_channel(self, channel_id: int, t_ns: int, payload: bytes) -> None:
        """Add a message to a registered channel."""
        self._mcap.add_message(channel_id, t_ns, payload)

    def flush_if_due(self) -> None:
        """Flush the chunk in progress if it exceeds the chunk size or age.

        Raises:
            RecorderError: the file cannot be written.
        """
        now_s = time.monotonic()
        if self._mcap.pending_bytes >= _CHUNK_BYTES or now_s - self._flushed_s >= _CHUNK_S:
            self._flushed_s = now_s
            try:
                self._mcap.flush()
            except OSError as error:
                raise self._recorder_error(error) from error

    def close(self) -> None:
        """Write the summary and close the file.

        Raises:
            RecorderError: the file cannot be written.
        """
        try:
            self._mcap.finish()
            self._file.close()
        except OSError as error:
            raise self._recorder_error(error) from error

    def _declare_key(self, key: str) -> tuple[int, str]:
        row: Channel = self._keys.parse(key)[0]
        kind = row.message
        schema = schema_name(kind), SCHEMA_ENCODING, json_schema(kind)
        return self.add_channel(key, MESSAGE_ENCODING, schema), row.name

    def _recorder_error(self, error: OSError) -> RecorderError:
        return RecorderError(f"{error.filename or self._path}: cannot write the recording: {error.strerror}")


def _metadata(deployment: Deployment, base: Path) -> dict[str, str]:
    return {
        "format": str(FORMAT),
        "skinnet": __version__,
        "robot": deployment.robot,
        "deployment": deployment.name,
        "seed": str(deployment.seed),
        "pace": deployment.run.pace,
        "base": str(base),
    }
