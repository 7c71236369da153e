"""Recording reader; reads files without a summary up to their last whole chunk."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata

from skinnet.channels import Keys
from skinnet.deployment import Deployment
from skinnet.deployment.load import build
from skinnet.errors import ProtocolError, RecordingError
from skinnet.recording.format import ABOUT, DEPLOYMENT, FORMAT, MEMORY
from skinnet.recording.mcap_file import MAGIC, MESSAGE_HEAD

__all__ = ["Recorded", "Recording"]

_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQ")
"""Chunk header: first and last time [ns], uncompressed size [bytes]."""
_TOP = (Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END, Opcode.FOOTER)
_UNREADABLE = (struct.error, zstandard.ZstdError, ValueError, EOFError)


class Recorded(NamedTuple):
    """Recorded message.

    Attributes:
        t_ns: Simulated time [ns].
        key: Key of the message.
        channel: Name of its channel in the channel table.
        fields: Values of the key's fields.
        payload: Encoded message as it was sent.
    """

    t_ns: int
    key: str
    channel: str
    fields: tuple[str, ...]
    payload: bytes


class _Place(NamedTuple):
    """Chunk location in the file [bytes], and its first and last time [ns]."""

    offset: int
    length: int
    first_ns: int
    last_ns: int


class Recording:
    """Recording on disk.

    Attributes:
        path: Path of the file.
        about: Format, version of skinnet, robot, deployment, seed, pace and base folder.
        complete: Whether the file has its footer; if not, it ends with its last whole chunk.
        raw: Resolved deployment of the run, with every default.
        end_ns: Time of the last message [ns]; 0 if there is none.
    """

    def __init__(self, path: Path) -> None:
        """Open a recording.

        Raises:
            RecordingError: there is no such file, or this program cannot read it.
        """
        self.path = path
        self.about: dict[str, str] = {}
        self.complete = False
        self.raw: dict[str, Any] = {}
        self._chunks: list[_Place] = []
        self._topics: dict[int, str] = {}
        self._memory: tuple[str, bytes] | None = None
        try:
            self._survey()
        except OSError as error:
            raise RecordingError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        except _UNREADABLE as error:
            raise RecordingError(f"{path}: damaged: {error}") from error
        self._require_known()
        self.end_ns = max((place.last_ns for place in self._chunks), default=0)

    @property
    def robot(self) -> str:
        """Robot's name."""
        return self.about["robot"]

    @property
    def base(self) -> Path:
        """Base folder of relative paths in the deployment, on the computer that recorded."""
        return Path(self.about["base"])

    @property
    def memory(self) -> tuple[str, bytes] | None:
        """Long-term memory (name, content) that the controller started with; None if it had none."""
        return self._memory

    def deployment(self) -> Deployment:
        """Deployment of the run.

        Raises:
            DeploymentError: this program has other deployment keys than the one that recorded.
        """
        return build(self.raw, str(self.path))

    def messages(self, from_ns: int = 0, until_ns: int | None = None) -> Iterator[Recorded]:
        """Recorded messages with `from_ns` ≤ t ≤ `until_ns`, in the order of the file.

        Raises:
            RecordingError: a chunk is damaged.
        """
        keys = Keys(self.robot)
        for t_ns, topic, payload in self.every(from_ns, until_ns):
            if topic.startswith(keys.prefix):
                try:
                    row, fields = keys.parse(topic)
                except ProtocolError:
                    continue  # a channel unknown to this program
                yield Recorded(t_ns, topic, row.name, fields, payload)

    def every(self, from_ns: int = 0, until_ns: int | None = None) -> Iterator[tuple[int, str, bytes]]:
        """All MCAP messages, Foxglove's included, as (time [ns], topic, payload); else as `messages`."""
        last_ns = self.end_ns if until_ns is None else until_ns
        with self.path.open("rb") as file:
            for place in self._chunks:
                if self.complete and (place.last_ns < from_ns or place.first_ns > last_ns):
                    continue  # the summary has its channels
                file.seek(place.offset)
                try:
                    content = _unpacked(file.read(place.length))
                    found = list(self._of_chunk(content))
                except _UNREADABLE as error:
                    raise RecordingError(f"{self.path}: damaged at byte {place.offset}: {error}") from error
                yield from (message for message in found if from_ns <= message[0] <= last_ns)

    def _of_chunk(self, content: bytes) -> Iterator[tuple[int, str, bytes]]:
        at, topics, unpack = 0, self._topics, MESSAGE_HEAD.unpack_from
        while at < len(content):
            opcode, length = _HEAD.unpack_from(content, at)
            end = at + _HEAD.size + length
            if opcode == Opcode.MESSAGE:
                _, _, channel, _, t_ns, _ = unpack(content, at)
                yield t_ns, topics[channel], content[at + MESSAGE_HEAD.size : end]
            elif opcode == Opcode.CHANNEL:
                self._add_channel(content[at + _HEAD.size : end])
            at = end

    def _survey(self) -> None:
        """Scan the record headers of the file; stop at the first truncated record."""
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{self.path}: no recording: it is not an MCAP file")
            at = len(MAGIC)
            while at + _HEAD.size <= size:
                file.seek(at)
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                begin, at = at + _HEAD.size, at + _HEAD.size + length
                if at > size:
                    return
                if opcode == Opcode.CHUNK:
                    first_ns, last_ns, _ = _CHUNK_HEAD.unpack(file.read(_CHUNK_HEAD.size))
                    self._chunks.append(_Place(begin, length, first_ns, last_ns))
                elif opcode in _TOP:
                    self._take(opcode, file.read(length))
                if self.complete:
                    return

    def _take(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        match opcode:
            case Opcode.CHANNEL:
                self._add_channel(content)
            case Opcode.METADATA:
                record = Metadata.read(stream)
                if record.name == ABOUT:
                    self.about = dict(record.metadata)
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(stream)
                if attachment.name == DEPLOYMENT:
                    self.raw = msgspec.json.decode(attachment.data)
                elif attachment.name.startswith(MEMORY):
                    self._memory = attachment.name.removeprefix(MEMORY), attachment.data
            case Opcode.FOOTER:
                self.complete = True

    def _add_channel(self, content: bytes) -> None:
        channel = Channel.read(ReadDataStream(BytesIO(content)))
        self._topics[channel.id] = channel.topic

    def _require_known(self) -> None:
        if not self.about:
            cut = "" if self.complete else ", or one that ends before it begins"
            raise RecordingError(
                f"{self.path}: no recording of skinnet: an MCAP file of another program{cut}"
            )
        version = self.about.get("format", "")
        if not version.isdecimal() or int(version) > FORMAT:
            raise RecordingError(
                f"{self.path}: a recording of format {version}, by skinnet {self.about.get('skinnet', '?')}; "
                f"this program reads up to {FORMAT}: update it"
            )
        if not self.raw:
            raise RecordingError(f"{self.path}: it ends before it says what was run: nothing to see")


def _unpacked(content: bytes) -> bytes:
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    if chunk.compression != "zstd":
        raise ValueError(f"compression {chunk.compression!r}")
    unpacked: bytes = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    if zlib.crc32(unpacked) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk is wrong")
    return unpacked
