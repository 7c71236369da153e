"""A recording: an MCAP file in which each message of the wire stands under its key, at its simulated time.

Beside them it may have other channels, which are left alone. What was deployed is the attachment
`deployment.json`; the metadata record `skinnet` has the folder `base` from which its paths start, and the
`schema` of the messages. A file that was cut off is read up to where it is whole.
"""

import itertools
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import msgspec
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from skinnet.channels import Keys
from skinnet.deployment.load import build
from skinnet.deployment.schema import Deployment
from skinnet.errors import DeploymentError, ProtocolError, RecordingError
from skinnet.messages import SCHEMA, decode
from skinnet.view.state import Told

__all__ = ["Recording"]

_DEPLOYMENT = "deployment.json"
_METADATA = "skinnet"
_ENCODING = "msgpack"

log = logging.getLogger(__name__)


class Recording:
    """A file to be read from any time on.

    Attributes:
        path: The file.
        deployment: What ran.
        base: Folder that paths in it start from.
        start_ns: Time of the first message [ns].
        end_ns: Time of the last [ns].
        cut: Whether the file has no end.

    Raises:
        RecordingError: it is no recording of this program, or of a newer version, or nothing of it is whole.
        OSError: it cannot be read.
    """

    def __init__(self, path: Path, base: Path | None = None) -> None:
        self.path = path
        self._file: IO[bytes] = path.open("rb")
        try:
            self._open(base)
        except BaseException:
            self._file.close()
            raise

    def messages(self, from_ns: int) -> Iterator[Told]:
        """Messages from a time on, in order of time; those that do not decode are left out."""
        for topic, t_ns, payload in self._raw(from_ns):
            row, fields = self._keys.parse(topic)
            try:
                yield Told(row.name, fields, decode(payload, row.message), t_ns)
            except ProtocolError:
                self.malformed += 1

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def _open(self, base: Path | None) -> None:
        self.malformed = 0
        self._kept: list[tuple[str, int, bytes]] = []
        attachments, metadata, channels = self._contents()
        if _DEPLOYMENT not in attachments:
            raise RecordingError(f"{self.path}: is of another program: it has no attachment {_DEPLOYMENT}")
        facts = metadata.get(_METADATA, {})
        if (schema := facts.get("schema", str(SCHEMA))) != str(SCHEMA):
            raise RecordingError(
                f"{self.path}: has messages of schema {schema}; this program reads {SCHEMA}: "
                "take the version of skinnet that recorded it"
            )
        try:
            raw = msgspec.json.decode(attachments[_DEPLOYMENT])
            self.deployment: Deployment = build(raw, str(self.path))
        except (msgspec.DecodeError, DeploymentError) as error:
            raise RecordingError(
                f"{self.path}: was recorded by another version of skinnet: {error}"
            ) from error
        self.base = base or Path(facts.get("base", "."))
        self._keys = Keys(self.deployment.robot)
        self._topics = [channel.topic for channel in channels if self._is_ours(channel)]
        if self.cut:
            self._kept = sorted(
                (entry for entry in self._kept if entry[0] in set(self._topics)), key=lambda entry: entry[1]
            )
        first = next(self._raw(0), None)
        if first is None:
            raise RecordingError(f"{self.path}: has no message of robot {self.deployment.robot}")
        self.start_ns = first[1]
        if self.cut:
            self.end_ns = self._kept[-1][1]

    def _contents(self) -> tuple[dict[str, bytes], dict[str, dict[str, str]], list[Channel]]:
        """Attachments and metadata by name, and channels."""
        try:
            reader = make_reader(self._file)
            summary = reader.get_summary()
            if summary is not None and summary.statistics is not None:
                self.cut, self._reader = False, reader
                self.end_ns = summary.statistics.message_end_time
                attachments = {entry.name: entry.data for entry in reader.iter_attachments()}
                metadata = {entry.name: dict(entry.metadata) for entry in reader.iter_metadata()}
                return attachments, metadata, list(summary.channels.values())
        except Exception as error:  # what stands where an end should be makes the reader fail in many ways
            log.debug("%s has no end: %s", self.path, error)
        self.cut = True
        return self._rescue()

    def _rescue(self) -> tuple[dict[str, bytes], dict[str, dict[str, str]], list[Channel]]:
        """What is whole of a file without an end."""
        attachments: dict[str, bytes] = {}
        metadata: dict[str, dict[str, str]] = {}
        channels: dict[int, Channel] = {}
        self._file.seek(0)
        try:
            for record in StreamReader(self._file).records:
                match record:
                    case Attachment():
                        attachments[record.name] = record.data
                    case Metadata():
                        metadata[record.name] = dict(record.metadata)
                    case Channel():
                        channels[record.id] = record
                    case Message() if channels[record.channel_id].message_encoding == _ENCODING:
                        topic = channels[record.channel_id].topic
                        self._kept.append((topic, record.log_time, record.data))
        except Exception as error:  # as above: here the file is whole no more
            if not channels and not attachments:
                raise RecordingError(f"{self.path}: is no recording: {_one_line(error)}") from error
        return attachments, metadata, list(channels.values())

    def _is_ours(self, channel: Channel) -> bool:
        if channel.message_encoding != _ENCODING:
            return False
        try:
            self._keys.parse(channel.topic)
        except ProtocolError:
            return False
        return True

    def _raw(self, from_ns: int) -> Iterator[tuple[str, int, bytes]]:
        if self.cut:
            yield from itertools.dropwhile(lambda entry: entry[1] < from_ns, self._kept)
            return
        found: Any = self._reader.iter_messages(topics=self._topics, starting_at=from_ns)
        for _, channel, message in found:
            yield channel.topic, message.log_time, message.data


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
