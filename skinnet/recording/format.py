"""Recording format: topics, schemas, metadata and attachments of the MCAP file.

A recording is an MCAP file of profile `skinnet`. It holds every message of the recorded channels unchanged:
the topic is the message's key, the encoding MessagePack, the log time its simulated time. docs/recording.md
has the rest.
"""

from functools import cache
from typing import Any

import msgspec

from skinnet.migration.recordings import FORMAT
from skinnet.protocol.channels import CHANNELS, Channel, Keys
from skinnet.protocol.messages import Message

__all__ = [
    "DEPLOYMENT_ATTACHMENT",
    "FILE_NAME",
    "FORMAT",
    "MEMORY_PREFIX",
    "MESSAGE_ENCODING",
    "METADATA_NAME",
    "PROFILE",
    "SCHEMA_ENCODING",
    "json_schema",
    "key_expression",
    "recorded_channels",
    "schema_name",
]

PROFILE = "skinnet"
FILE_NAME = "run.mcap"
"""Recording's file name in the run folder."""
MESSAGE_ENCODING, SCHEMA_ENCODING = "msgpack", "jsonschema"
METADATA_NAME = "skinnet"
"""Metadata record's name; it holds format, version of skinnet, robot, deployment, seed, pace, base folder."""
DEPLOYMENT_ATTACHMENT = "deployment.json"
"""Attachment with the whole deployment."""
MEMORY_PREFIX = "memory/"
"""Attachment name prefix of the long-term memory file that the controller started with."""


def recorded_channels() -> tuple[Channel, ...]:
    """Recorded rows of the channel table."""
    return tuple(row for row in CHANNELS if row.recorded)


def key_expression(keys: Keys, row: Channel) -> str:
    """Key expression that matches all messages of a channel."""
    return keys.of(row.name, *["*"] * row.pattern.count("<"))


def schema_name(kind: type[Message]) -> str:
    """Schema name of a message type."""
    return f"skinnet.{kind.__name__}"


@cache
def json_schema(kind: type[Message]) -> bytes:
    """JSON Schema of a message type; its base64 strings are MessagePack `bin` values on the wire."""
    schema = msgspec.json.schema(kind)
    definitions: dict[str, Any] = schema.pop("$defs")
    whole = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **definitions.pop(kind.__name__),
        **({"$defs": definitions} if definitions else {}),
    }
    return msgspec.json.encode(whole)
