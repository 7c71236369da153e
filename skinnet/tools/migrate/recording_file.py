"""Recordings of earlier formats rewritten in the present one, message by message.

Messages keep order, times, sequence numbers and chunks, Foxglove's topics also their bytes. A recording
without its summary section stays without: it says that the run was cut.
"""

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk

from skinnet.deployment.load import from_document
from skinnet.errors import MemoryFileError, ProtocolError, RecordingError
from skinnet.files import atomic_replacement
from skinnet.memory.conversion import to_present_version
from skinnet.migration import deployments
from skinnet.migration.recordings import FORMAT, MessageTranslator, is_channel_key
from skinnet.protocol.channels import Keys
from skinnet.recording.format import (
    DEPLOYMENT_ATTACHMENT,
    MEMORY_PREFIX,
    METADATA_NAME,
    SCHEMA_ENCODING,
    json_schema,
    schema_name,
)
from skinnet.recording.mcap_writer import MAGIC, McapWriter

__all__ = ["count_renamed", "rewrite_recording"]

_RECORD_HEADER = struct.Struct("<BQ")


def count_renamed(path: Path, translator: MessageTranslator) -> int:
    """Number of keys, messages, fields and deployment keys of a recording that are called otherwise today.

    Raises:
        RecordingError: the file is damaged.
    """
    names: set[str] = set()
    n_of_files = 0
    topics: dict[int, str] = {}
    seen: set[int] = set()
    for record in _records(path):
        match record:
            case Channel(id=number, topic=topic):
                topics[number] = topic
            case Message(channel_id=number, data=payload) if number not in seen:
                seen.add(number)
                if is_channel_key(topics[number]):
                    names |= translator.changed_names(topics[number], payload)
            case Attachment(name=name, data=content):
                n_of_files += _translated_attachment(path, name, content)[1]
    return len(names) + n_of_files


def rewrite_recording(path: Path, target: Path, translator: MessageTranslator, *, complete: bool) -> None:
    """Rewrite a recording of format 1 in the present format.

    Args:
        path: Recording to read.
        target: File to write, atomically; may be `path`.
        translator: Translator of its messages.
        complete: Whether the recording has its summary section.

    Raises:
        RecordingError: the file is damaged.
    """
    with atomic_replacement(target) as file:
        records = _records(path)
        first = next(records)
        assert isinstance(first, Header)
        rewriter = _Rewriter(path, translator, McapWriter(file, first.profile, first.library))
        for record in records:
            rewriter.add(record)
        rewriter.close(complete=complete)


class _Rewriter:
    """Translation of the records of one recording, one after the other."""

    def __init__(self, path: Path, translator: MessageTranslator, writer: McapWriter) -> None:
        self._path, self._translator, self._writer = path, translator, writer
        self._schemas: dict[int, Schema] = {}
        self._schema_ids: dict[int, int] = {}
        self._channels: dict[int, tuple[int, bool]] = {}
        """New id and whether it is a key of the middleware, by old id."""

    def add(self, record: McapRecord) -> None:
        """Translate one record; a chunk is announced by itself and followed by its content."""
        match record:
            case Metadata():
                fields = record.metadata
                if record.name == METADATA_NAME:
                    fields = fields | {"format": str(FORMAT)}
                self._writer.add_metadata(record.name, fields)
            case Attachment():
                content, _ = _translated_attachment(self._path, record.name, record.data)
                self._writer.add_attachment(record.name, record.media_type, content)
            case Chunk():
                self._writer.flush()  # chunks begin where they began
            case Schema():
                self._schemas[record.id] = record
            case Channel():
                if record.id not in self._channels:
                    self._channels[record.id] = self._declared(record)
            case Message():
                number, translated = self._channels[record.channel_id]
                payload = self._translator.message(record.data) if translated else record.data
                self._writer.add_message(number, record.log_time, payload)

    def close(self, *, complete: bool) -> None:
        """Write the last chunk and, if the recording had one, the summary section."""
        if complete:
            self._writer.finish()
        else:
            self._writer.flush()

    def _declared(self, channel: Channel) -> tuple[int, bool]:
        topic = self._translator.key(channel.topic)
        schema_id = self._schema_ids.get(channel.schema_id)
        if schema_id is None:
            schema = _present_schema(topic, self._schemas[channel.schema_id])
            schema_id = self._schema_ids[channel.schema_id] = self._writer.add_schema(*schema)
        number = self._writer.add_channel(topic, channel.message_encoding, schema_id)
        return number, is_channel_key(channel.topic)


def _present_schema(topic: str, schema: Schema) -> tuple[str, str, bytes]:
    """Name, encoding and data of the schema of a topic."""
    if is_channel_key(topic):
        try:
            row, _ = Keys(topic.split("/")[1]).parse(topic)
        except ProtocolError:
            return schema.name, schema.encoding, schema.data  # a channel unknown to this program
        return schema_name(row.message), SCHEMA_ENCODING, json_schema(row.message)
    return schema.name, schema.encoding, schema.data


def _translated_attachment(path: Path, name: str, content: bytes) -> tuple[bytes, int]:
    """Content of an attachment under the present names, and the number of new ones."""
    if name == DEPLOYMENT_ATTACHMENT:
        document, n_renamed = deployments.translate(msgspec.json.decode(content), str(path))
        document = {deployments.FORMAT_KEY: deployments.FORMAT, **document}
        from_document(document, str(path))
        return msgspec.json.format(msgspec.json.encode(document), indent=1), n_renamed
    if name.startswith(MEMORY_PREFIX):
        try:
            content, stored = to_present_version(name, content)
        except MemoryFileError as error:
            raise RecordingError(f"{path}: {error}") from None
        return content, stored.n_renamed
    return content, 0


def _records(path: Path) -> Iterator[McapRecord]:
    """Records of a recording up to its first truncated one; chunks are followed by what is in them."""
    size = path.stat().st_size
    with path.open("rb") as file:
        at = len(MAGIC)
        while at + _RECORD_HEADER.size <= size:
            file.seek(at)
            opcode, length = _RECORD_HEADER.unpack(file.read(_RECORD_HEADER.size))
            at += _RECORD_HEADER.size + length
            if at > size or opcode == Opcode.DATA_END:
                return
            yield from _decoded(path, opcode, length, file)


def _decoded(path: Path, opcode: int, length: int, file: IO[bytes]) -> Iterator[McapRecord]:
    kinds = {
        Opcode.HEADER: Header,
        Opcode.METADATA: Metadata,
        Opcode.ATTACHMENT: Attachment,
        Opcode.CHUNK: Chunk,
    }
    kind = kinds.get(Opcode(opcode)) if opcode in set(Opcode) else None
    if kind is None:
        return  # message indices: the writer makes its own
    begin = file.tell()
    try:
        record = kind.read(ReadDataStream(BytesIO(file.read(length))))
        yield record
        if isinstance(record, Chunk):
            yield from breakup_chunk(record, validate_crc=True)
    except (struct.error, ValueError, EOFError) as error:
        raise RecordingError(f"{path}: damaged at byte {begin}: {error}") from error
