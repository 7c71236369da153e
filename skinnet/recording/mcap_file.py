"""MCAP writer that flushes each chunk to disk before the next one begins.

Messages are written as the bytes that they came as. A killed process leaves a file without its summary
section, which a sequential reader can read up to the last whole chunk.
"""

import struct
import zlib
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

__all__ = ["MAGIC", "MESSAGE_HEAD", "McapFile"]

MAGIC = b"\x89MCAP0\r\n"
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Header of a Message record: opcode, length, channel, sequence, log time [ns], publish time [ns]."""
_IN_RECORD = MESSAGE_HEAD.size - 9
_INDEX_HEAD = struct.Struct("<BQHI")
_LEVEL = 1
"""Compression level of zstd; higher levels gain little on counters and noise."""


class McapFile:
    """MCAP file written sequentially.

    Attributes:
        n_bytes: Bytes written, without the chunk in progress.
        waiting_bytes: Uncompressed bytes of the chunk in progress.
    """

    def __init__(self, file: IO[bytes], profile: str, library: str) -> None:
        """Write the magic bytes and the Header record."""
        self.n_bytes = self.waiting_bytes = 0
        self._file = file
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: list[int] = []
        self._begun: set[int] = set()
        """Channels whose Channel record has been written."""
        self._chunk: list[bytes] = []
        self._index: dict[int, list[int]] = {}
        self._first_ns, self._last_ns = 2**63, 0
        self._span_ns: tuple[int, int] | None = None
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._compress = zstandard.ZstdCompressor(level=_LEVEL).compress
        self._write(MAGIC + _bytes_of(Header(profile, library)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Register a schema; return its id."""
        number = len(self._schemas) + 1
        self._schemas.append(Schema(id=number, data=data, encoding=encoding, name=name))
        return number

    def add_channel(self, topic: str, encoding: str, schema: int) -> int:
        """Register a channel; return its id."""
        number = len(self._channels) + 1
        self._channels.append(
            Channel(id=number, topic=topic, message_encoding=encoding, metadata={}, schema_id=schema)
        )
        self._counts.append(0)
        return number

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment, after flushing the chunk in progress."""
        self.flush()
        offset = self.n_bytes
        record = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        length = self._write(_bytes_of(record))
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )
        self._file.flush()

    def describe(self, name: str, texts: dict[str, str]) -> None:
        """Write a metadata record, after flushing the chunk in progress."""
        self.flush()
        offset = self.n_bytes
        length = self._write(_bytes_of(Metadata(name=name, metadata=texts)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))
        self._file.flush()

    def add(self, channel: int, t_ns: int, payload: bytes) -> None:
        """Add a message to the chunk in progress."""
        if channel not in self._begun:
            self._begin(channel)
        entry = self._index.get(channel)
        if entry is None:
            entry = self._index[channel] = []
        entry += (t_ns, self.waiting_bytes)
        count = self._counts[channel - 1] + 1
        self._counts[channel - 1] = count
        size = len(payload)
        self._chunk += (
            MESSAGE_HEAD.pack(Opcode.MESSAGE, _IN_RECORD + size, channel, count, t_ns, t_ns),
            payload,
        )
        self.waiting_bytes += MESSAGE_HEAD.size + size
        if t_ns < self._first_ns:
            self._first_ns = t_ns
        if t_ns > self._last_ns:
            self._last_ns = t_ns

    def flush(self) -> None:
        """Write the chunk in progress as a whole and flush the file, so that it survives a kill."""
        if not self._index:
            return
        content = b"".join(self._chunk)
        packed = self._compress(content)
        chunk = Chunk(
            compression="zstd",
            data=packed,
            message_start_time=self._first_ns,
            message_end_time=self._last_ns,
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        offset = self.n_bytes
        length = self._write(_bytes_of(chunk))
        places = {}
        for channel, entry in self._index.items():
            head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + 8 * len(entry), channel, 8 * len(entry))
            places[channel] = self.n_bytes
            self._write(head + struct.pack(f"<{len(entry)}Q", *entry))
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=offset,
                chunk_length=length,
                message_start_time=self._first_ns,
                message_end_time=self._last_ns,
                message_index_offsets=places,
                message_index_length=self.n_bytes - offset - length,
                compression="zstd",
                compressed_size=len(packed),
                uncompressed_size=len(content),
            )
        )
        first_ns, last_ns = self._span_ns or (self._first_ns, self._last_ns)
        self._span_ns = min(first_ns, self._first_ns), max(last_ns, self._last_ns)
        self._chunk, self._index, self.waiting_bytes = [], {}, 0
        self._first_ns, self._last_ns = 2**63, 0
        self._file.flush()

    def finish(self) -> None:
        """Write the summary section, Footer and closing magic bytes."""
        self.flush()
        self._write(_bytes_of(DataEnd(data_section_crc=0)))
        begin = self.n_bytes
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [s for s in self._schemas if s.id in {c.schema_id for c in self._seen}]),
            (Opcode.CHANNEL, list(self._seen)),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self._attachments)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            start, content = begin + len(summary), b"".join(map(_bytes_of, records))
            summary += content
            if content:
                offsets += _bytes_of(SummaryOffset(opcode, start, len(content)))
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, begin + len(summary))
        crc = zlib.crc32(footer, zlib.crc32(summary + offsets))
        end = Footer(summary_start=begin, summary_offset_start=begin + len(summary), summary_crc=crc)
        self._write(summary + offsets + _bytes_of(end) + MAGIC)
        self._file.flush()

    @property
    def _seen(self) -> list[Channel]:
        """Channels with at least one message."""
        return [channel for channel in self._channels if channel.id in self._begun]

    def _statistics(self) -> Statistics:
        first_ns, last_ns = self._span_ns or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._seen),
            channel_message_counts={c.id: self._counts[c.id - 1] for c in self._seen},
            chunk_count=len(self._chunks),
            message_count=sum(self._counts),
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._metadata),
            schema_count=len({channel.schema_id for channel in self._seen}),
        )

    def _begin(self, channel: int) -> None:
        """Add the Schema and Channel records to the chunk, before the channel's first message."""
        self._begun.add(channel)
        of = self._channels[channel - 1]
        records = _bytes_of(self._schemas[of.schema_id - 1]) + _bytes_of(of)
        self._chunk.append(records)
        self.waiting_bytes += len(records)

    def _write(self, content: bytes) -> int:
        self._file.write(content)
        self.n_bytes += len(content)
        return len(content)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()
    return content
