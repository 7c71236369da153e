"""Recording writer: messages by key, with schemas, metadata and attachments."""

import time
from collections import Counter
from pathlib import Path
from typing import IO

from skinnet import __version__
from skinnet.channels import Channel, Keys
from skinnet.deployment import Deployment, resolved_json
from skinnet.errors import RecorderError
from skinnet.recording.format import (
    ABOUT,
    DEPLOYMENT,
    ENCODING,
    FORMAT,
    MEMORY,
    PROFILE,
    SCHEMA_ENCODING,
    schema_name,
    schema_of,
)
from skinnet.recording.mcap_file import McapFile

__all__ = ["Writer"]

_CHUNK_BYTES = 1_000_000
_CHUNK_S = 0.5
"""Chunk size and age at which a chunk is flushed; a kill loses no more than that."""


class Writer:
    """Writer of one recording.

    Attributes:
        counts: Number of messages by channel name.
    """

    def __init__(self, path: Path, deployment: Deployment, base: Path) -> None:
        """Prepare the writer; `begin` creates the file.

        Args:
            path: Path of the file.
            deployment: Deployment of the run.
            base: Folder that relative paths in the deployment start from.
        """
        self.counts: Counter[str] = Counter()
        self._path, self._deployment, self._base = path, deployment, base
        self._keys = Keys(deployment.robot)
        self._numbers: dict[str, tuple[int, str]] = {}
        self._schemas: dict[str, int] = {}
        self._flushed_s = time.monotonic()
        self._file: IO[bytes]
        self._mcap: McapFile

    def begin(self) -> None:
        """Create the file, replacing one of an earlier run, with its metadata and attachments.

        Raises:
            RecorderError: the file cannot be written.
        """
        deployment, base = self._deployment, self._base
        try:
            self._file = self._path.open("wb")
            self._mcap = McapFile(self._file, PROFILE, f"skinnet {__version__}")
            self._mcap.describe(ABOUT, _about(deployment, base))
            self._mcap.attach(DEPLOYMENT, "application/json", resolved_json(deployment))
            if deployment.memory.read is not None:
                memory = base / deployment.memory.read
                self._mcap.attach(MEMORY + memory.name, "application/octet-stream", memory.read_bytes())
        except OSError as error:
            raise self._failed(error) from error

    @property
    def n_bytes(self) -> int:
        """File size so far [bytes]."""
        return self._mcap.n_bytes

    def add(self, key: str, t_ns: int, payload: bytes) -> None:
        """Add an encoded message of the run."""
        known = self._numbers.get(key)
        if known is None:
            known = self._numbers[key] = self._begin(key)
        number, name = known
        self.counts[name] += 1
        self._mcap.add(number, t_ns, payload)

    def topic(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        """Register a channel with its schema (name, encoding, data); return its id."""
        if schema[0] not in self._schemas:
            self._schemas[schema[0]] = self._mcap.add_schema(*schema)
        return self._mcap.add_channel(topic, encoding, self._schemas[schema[0]])

    def add_to(self, number: int, t_ns: int, payload: bytes) -> None:
        """Add a message to a registered channel."""
        self._mcap.add(number, t_ns, payload)

    def settle(self) -> None:
        """Flush the chunk in progress if it exceeds the chunk size or age.

        Raises:
            RecorderError: the file cannot be written.
        """
        now_s = time.monotonic()
        if self._mcap.waiting_bytes >= _CHUNK_BYTES or now_s - self._flushed_s >= _CHUNK_S:
            self._flushed_s = now_s
            try:
                self._mcap.flush()
            except OSError as error:
                raise self._failed(error) from error

    def finish(self) -> None:
        """Write the summary and close the file.

        Raises:
            RecorderError: the file cannot be written.
        """
        try:
            self._mcap.finish()
            self._file.close()
        except OSError as error:
            raise self._failed(error) from error

    def _begin(self, key: str) -> tuple[int, str]:
        row: Channel = self._keys.parse(key)[0]
        kind = row.message
        schema = schema_name(kind), SCHEMA_ENCODING, schema_of(kind)
        return self.topic(key, ENCODING, schema), row.name

    def _failed(self, error: OSError) -> RecorderError:
        return RecorderError(f"{error.filename or self._path}: the recording cannot go on: {error.strerror}")


def _about(deployment: Deployment, base: Path) -> dict[str, str]:
    return {
        "format": str(FORMAT),
        "skinnet": __version__,
        "robot": deployment.robot,
        "deployment": deployment.name,
        "seed": str(deployment.seed),
        "pace": deployment.run.pace,
        "base": str(base),
    }
