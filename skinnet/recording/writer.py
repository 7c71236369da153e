"""The file of a recording while it grows: messages by key, and what a file needs for some to make sense."""

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
"""No more than that, of either, is lost by a kill."""


class Writer:
    """Writes one recording.

    Attributes:
        counts: Messages by the name of their channel.
    """

    def __init__(self, path: Path, deployment: Deployment, base: Path) -> None:
        """Writes nothing yet.

        Args:
            path: Where to write.
            deployment: What is run.
            base: Folder that relative paths in it start from.
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
        """Begins the file, in the place of one of an earlier run.

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
        """Bytes in the file so far."""
        return self._mcap.n_bytes

    def add(self, key: str, t_ns: int, payload: bytes) -> None:
        """Adds a message of the wire as it came."""
        known = self._numbers.get(key)
        if known is None:
            known = self._numbers[key] = self._begin(key)
        number, name = known
        self.counts[name] += 1
        self._mcap.add(number, t_ns, payload)

    def topic(self, topic: str, encoding: str, schema: tuple[str, str, bytes]) -> int:
        """Number of a new channel of another kind, with its schema: name, encoding, data."""
        if schema[0] not in self._schemas:
            self._schemas[schema[0]] = self._mcap.add_schema(*schema)
        return self._mcap.add_channel(topic, encoding, self._schemas[schema[0]])

    def add_to(self, number: int, t_ns: int, payload: bytes) -> None:
        """Adds a message of another kind."""
        self._mcap.add(number, t_ns, payload)

    def settle(self) -> None:
        """Writes the chunk in progress if it is large enough or has waited long enough.

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
        """Ends the file.

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
