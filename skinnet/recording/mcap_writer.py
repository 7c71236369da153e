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

__all__ = ["MAGIC", "MESSAGE_HEADER", "McapWriter"]

MAGIC = b"\x89MCAP0\r\n"
MESSAGE_HEADER = struct.Struct("<BQHIQQ")
"""Header of a Message record: opcode, length, channel, sequence, log time [ns], publish time [ns]."""
_MESSAGE_FIELDS_BYTES = MESSAGE_HEADER.size - 9
_INDEX_HEADER = struct.Struct("<BQHI")
_COMPRESSION_LEVEL = 1
"""Compression level of zstd; higher levels gain little on counters and noise."""


class McapWriter:
    """MCAP file written sequentially.

    Attributes:
        n_bytes: Bytes written, without the chunk in progress.
        pending_bytes: Uncompressed bytes of the chunk in progress.
    """

    def __init__(self, file: IO[bytes], profile: str, library: str) -> None:
        """Write the magic bytes and the Header record."""
        self.n_bytes = self.pending_bytes = 0
        self._file = file
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: list[int] = []
        self._declared_channels: set[int] = set()
        """Channels whose Channel record has been written."""
        self._chunk: list[bytes] = []
        self._message_index: dict[int, list[int]] = {}
        self._first_ns, self._last_ns = 2**63, 0
        self._time_range_ns: tuple[int, int] | None = None
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._compress = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL).compress
        self._write(MAGIC + _encode(Header(profile, library)))

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

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment, after flushing the chunk in progress."""
        self.flush()
        offset = self.n_bytes
        record = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        length = self._write(_encode(record))
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

    def add_metadata(self, name: str, fields: dict[str, str]) -> None:
        """Write a metadata record, after flushing the chunk in progress."""
        self.flush()
        offset = self.n_bytes
        length = self._write(_encode(Metadata(name=name, metadata=fields)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))
        self._file.flush()

    def add_message(self, channel: int, t_ns: int, payload: bytes) -> None:
        """Add a message to the chunk in progress."""
        if channel not in self._declared_channels:
            self._declare_channel(channel)
        entry = self._message_index.get(channel)
        if entry is None:
            entry = self._message_index[channel] = []
        entry += (t_ns, self.pending_bytes)
        count = self._counts[channel - 1] + 1
        self._counts[channel - 1] = count
        size = len(payload)
        self._chunk += (
            MESSAGE_HEADER.pack(Opcode.MESSAGE, _MESSAGE_FIELDS_BYTES + size, channel, count, t_ns, t_ns),
            payload,
        )
        self.pending_bytes += MESSAGE_HEADER.size + size
        if t_ns < self._first_ns:
            self._first_ns = t_ns
        if t_ns > self._last_ns:
            self._last_ns = t_ns

    def flush(self) -> None:
        """Write the chunk in progress as a whole and flush the file, so that it survives a kill."""
        if not self._message_index:
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
        length = self._write(_encode(chunk))
        places = {}
        for channel, entry in self._message_index.items():
            head = _INDEX_HEADER.pack(Opcode.MESSAGE_INDEX, 6 + 8 * len(entry), channel, 8 * len(entry))
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
        first_ns, last_ns = self._time_range_ns or (self._first_ns, self._last_ns)
        self._time_range_ns = min(first_ns, self._first_ns), max(last_ns, self._last_ns)
        self._chunk, self._message_index, self.pending_bytes = [], {}, 0
        self._first_ns, self._last_ns = 2**63, 0
        self._file.flush()

    def finish(self) -> None:
        """Write the summary section, Footer and closing magic bytes."""
        self.flush()
        self._write(_encode(DataEnd(data_section_crc=0)))
        begin = self.n_bytes
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [s for s in self._schemas if s.id in {c.schema_id for c in self._used_channels}]),
            (Opcode.CHANNEL, list(self._used_channels)),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self._attachments)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            start, content = begin + len(summary), b"".join(map(_encode, records))
            summary += content
            if content:
                offsets += _encode(SummaryOffset(opcode, start, len(content)))
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, begin + len(summary))
        crc = zlib.crc32(footer, zlib.crc32(summary + offsets))
        end = Footer(summary_start=begin, summary_offset_start=begin + len(summary), summary_crc=crc)
        self._write(summary + offsets + _encode(end) + MAGIC)
        self._file.flush()

    @property
    def _used_channels(self) -> list[Channel]:
        """Channels with at least one message."""
        return [channel for channel in self._channels if channel.id in self._declared_channels]

    def _statistics(self) -> Statistics:
        first_ns, last_ns = self._time_range_ns or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._used_channels),
            channel_message_counts={c.id: self._counts[c.id - 1] for c in self._used_channels},
            chunk_count=len(self._chunks),
            message_count=sum(self._counts),
            message_end_time=last_ns,
            message_start_time=first_ns,
            metadata_count=len(self._metadata),
            schema_count=len({channel.schema_id for channel in self._used_channels}),
        )

    def _declare_channel(self, channel: int) -> None:
        """Add the Schema and Channel records to the chunk, before the channel's first message."""
        self._declared_channels.add(channel)
        of = self._channels[channel - 1]
        records = _encode(self._schemas[of.schema_id - 1]) + _encode(of)
        self._chunk.append(records)
        self.pending_bytes += len(records)

    def _write(self, content: bytes) -> int:
        self._file.write(content)
        self.n_bytes += len(content)
        return len(content)


def _encode(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    content: bytes = builder.end()
    return content
