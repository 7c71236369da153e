"""Recording reader; reads files without a summary up to their last whole chunk.

Earlier formats are read under the present names: keys, messages, deployment and memory are translated.
"""

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

from skinnet.deployment import Deployment
from skinnet.deployment.load import from_document
from skinnet.errors import FormatError, ProtocolError, RecordingError
from skinnet.memory.conversion import to_present_version
from skinnet.migration import deployments
from skinnet.migration.recordings import MessageTranslator, is_channel_key
from skinnet.migration.renaming import remark_old_format
from skinnet.protocol.channels import Keys
from skinnet.recording.format import DEPLOYMENT_ATTACHMENT, FORMAT, MEMORY_PREFIX, METADATA_NAME
from skinnet.recording.mcap_writer import MAGIC, MESSAGE_HEADER

__all__ = ["RecordedMessage", "Recording"]

_RECORD_HEADER = struct.Struct("<BQ")
_CHUNK_HEADER = struct.Struct("<QQQ")
"""Chunk header: first and last time [ns], uncompressed size [bytes]."""
_TOP_LEVEL_OPCODES = (
    Opcode.CHANNEL,
    Opcode.CHUNK,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
    Opcode.FOOTER,
)
_DECODE_ERRORS = (struct.error, zstandard.ZstdError, ValueError, EOFError)


class RecordedMessage(NamedTuple):
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


class _ChunkLocation(NamedTuple):
    """Chunk location in the file [bytes], and its first and last time [ns]."""

    offset: int
    length: int
    first_ns: int
    last_ns: int


class Recording:
    """Recording on disk.

    Attributes:
        path: Path of the file.
        metadata: Format, version of skinnet, robot, deployment, seed, pace and base folder.
        complete: Whether the file has its footer; if not, it ends with its last whole chunk.
        translator: Translator of messages of an earlier format; None if the file is of the present one.
        deployment_dict: Resolved deployment of the run, with every default.
        end_ns: Time of the last message [ns]; 0 if there is none.
    """

    def __init__(self, path: Path, *, remark: bool = True) -> None:
        """Open a recording.

        Args:
            path: Path of the file.
            remark: Log one line if the file is of an earlier format.

        Raises:
            RecordingError: there is no such file, or this program cannot read it.
        """
        self.path = path
        self.metadata: dict[str, str] = {}
        self.complete = False
        self.deployment_dict: dict[str, Any] = {}
        self._chunks: list[_ChunkLocation] = []
        self._topics: dict[int, str] = {}
        self._memory: tuple[str, bytes] | None = None
        try:
            self._scan()
        except OSError as error:
            raise RecordingError(f"{path}: {(error.strerror or str(error)).lower()}") from error
        except _DECODE_ERRORS as error:
            raise RecordingError(f"{path}: damaged: {error}") from error
        self.translator = self._check_format()
        if self.translator is not None and remark:
            remark_old_format(path, "recording")
        self.end_ns = max((place.last_ns for place in self._chunks), default=0)

    @property
    def chunk_offsets(self) -> tuple[int, ...]:
        """Offsets of the chunks in the file [bytes]."""
        return tuple(place.offset for place in self._chunks)

    @property
    def robot(self) -> str:
        """Robot's name."""
        return self.metadata["robot"]

    @property
    def base(self) -> Path:
        """Base folder of relative paths in the deployment, on the computer that recorded."""
        return Path(self.metadata["base"])

    @property
    def memory(self) -> tuple[str, bytes] | None:
        """Long-term memory (name, content) that the controller started with; None if it had none.

        Raises:
            MemoryFileError: it is of an earlier version, and damaged.
        """
        if self._memory is None or self.translator is None:
            return self._memory
        name, content = self._memory
        return name, to_present_version(name, content)[0]

    def deployment(self) -> Deployment:
        """Deployment of the run.

        Raises:
            DeploymentError: this program has other deployment keys than the one that recorded.
        """
        return from_document(self.deployment_dict, str(self.path))

    def messages(self, from_ns: int = 0, until_ns: int | None = None) -> Iterator[RecordedMessage]:
        """Recorded messages with `from_ns` ≤ t ≤ `until_ns`, in the order of the file.

        Raises:
            RecordingError: a chunk is damaged.
        """
        keys = Keys(self.robot)
        for t_ns, topic, payload in self.all_messages(from_ns, until_ns):
            if topic.startswith(keys.prefix):
                try:
                    row, fields = keys.parse(topic)
                except ProtocolError:
                    continue  # a channel unknown to this program
                yield RecordedMessage(t_ns, topic, row.name, fields, payload)

    def all_messages(self, from_ns: int = 0, until_ns: int | None = None) -> Iterator[tuple[int, str, bytes]]:
        """All MCAP messages, Foxglove's included, as (time [ns], topic, payload); else as `messages`."""
        last_ns = self.end_ns if until_ns is None else until_ns
        with self.path.open("rb") as file:
            for place in self._chunks:
                if self.complete and (place.last_ns < from_ns or place.first_ns > last_ns):
                    continue  # the summary has its channels
                file.seek(place.offset)
                try:
                    content = _decompress(file.read(place.length))
                    found = list(self._messages_of_chunk(content))
                except _DECODE_ERRORS as error:
                    raise RecordingError(f"{self.path}: damaged at byte {place.offset}: {error}") from error
                yield from (self._present(message) for message in found if from_ns <= message[0] <= last_ns)

    def _present(self, message: tuple[int, str, bytes]) -> tuple[int, str, bytes]:
        """Message under its present names."""
        t_ns, topic, payload = message
        if self.translator is None or not is_channel_key(topic):
            return message
        return t_ns, self.translator.key(topic), self.translator.message(payload)

    def _messages_of_chunk(self, content: bytes) -> Iterator[tuple[int, str, bytes]]:
        at, topics, unpack = 0, self._topics, MESSAGE_HEADER.unpack_from
        while at < len(content):
            opcode, length = _RECORD_HEADER.unpack_from(content, at)
            end = at + _RECORD_HEADER.size + length
            if opcode == Opcode.MESSAGE:
                _, _, channel, _, t_ns, _ = unpack(content, at)
                yield t_ns, topics[channel], content[at + MESSAGE_HEADER.size : end]
            elif opcode == Opcode.CHANNEL:
                self._add_channel(content[at + _RECORD_HEADER.size : end])
            at = end

    def _scan(self) -> None:
        """Scan the record headers of the file; stop at the first truncated record."""
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{self.path}: not a recording: not an MCAP file")
            at = len(MAGIC)
            while at + _RECORD_HEADER.size <= size:
                file.seek(at)
                opcode, length = _RECORD_HEADER.unpack(file.read(_RECORD_HEADER.size))
                begin, at = at + _RECORD_HEADER.size, at + _RECORD_HEADER.size + length
                if at > size:
                    return
                if opcode == Opcode.CHUNK:
                    first_ns, last_ns, _ = _CHUNK_HEADER.unpack(file.read(_CHUNK_HEADER.size))
                    self._chunks.append(_ChunkLocation(begin, length, first_ns, last_ns))
                elif opcode in _TOP_LEVEL_OPCODES:
                    self._read_record(opcode, file.read(length))
                if self.complete:
                    return

    def _read_record(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        match opcode:
            case Opcode.CHANNEL:
                self._add_channel(content)
            case Opcode.METADATA:
                record = Metadata.read(stream)
                if record.name == METADATA_NAME:
                    self.metadata = dict(record.metadata)
            case Opcode.ATTACHMENT:
                attachment = Attachment.read(stream)
                if attachment.name == DEPLOYMENT_ATTACHMENT:
                    self.deployment_dict = msgspec.json.decode(attachment.data)
                elif attachment.name.startswith(MEMORY_PREFIX):
                    self._memory = attachment.name.removeprefix(MEMORY_PREFIX), attachment.data
            case Opcode.FOOTER:
                self.complete = True

    def _add_channel(self, content: bytes) -> None:
        channel = Channel.read(ReadDataStream(BytesIO(content)))
        self._topics[channel.id] = channel.topic

    def _check_format(self) -> MessageTranslator | None:
        if not self.metadata:
            cut = "" if self.complete else ", or truncated before it"
            raise RecordingError(
                f"{self.path}: not a skinnet recording: an MCAP file without the metadata record of "
                f"skinnet{cut}"
            )
        version = self.metadata.get("format", "")
        if not version.isdecimal() or not 1 <= int(version) <= FORMAT:
            raise RecordingError(
                f"{self.path}: a recording of format {version}, "
                f"by skinnet {self.metadata.get('skinnet', '?')}; "
                f"this version reads up to {FORMAT}: update skinnet"
            )
        if not self.deployment_dict:
            raise RecordingError(f"{self.path}: truncated before its deployment: no messages")
        translator = MessageTranslator(self.deployment_dict) if int(version) < FORMAT else None
        try:
            document, _ = deployments.translate(self.deployment_dict, str(self.path))
        except FormatError as error:
            raise RecordingError(str(error)) from None
        self.deployment_dict = {deployments.FORMAT_KEY: deployments.FORMAT, **document}
        return translator


def _decompress(content: bytes) -> bytes:
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    if chunk.compression != "zstd":
        raise ValueError(f"unsupported compression {chunk.compression!r}; expected 'zstd'")
    unpacked: bytes = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    if zlib.crc32(unpacked) != chunk.uncompressed_crc:
        raise ValueError("chunk checksum mismatch")
    return unpacked
