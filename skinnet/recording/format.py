"""The format of a recording: which message is on which topic, and what else is in the file.

A recording is an MCAP file of profile `skinnet`. Every message of a recorded channel is there as it was
sent: its topic is its key, its encoding MessagePack, its log time its simulated time. The rest is in
docs/recording.md.
"""

from functools import cache
from typing import Any

import msgspec

from skinnet.channels import CHANNELS, Channel, Keys
from skinnet.messages import Message

__all__ = [
    "ABOUT",
    "DEPLOYMENT",
    "ENCODING",
    "FORMAT",
    "MEMORY",
    "PROFILE",
    "RECORDED",
    "SCHEMA_ENCODING",
    "expression",
    "recorded_channels",
    "schema_name",
    "schema_of",
]

FORMAT = 1
"""Version of the format; a program reads those up to its own."""
PROFILE = "skinnet"
RECORDED = "run.mcap"
"""Name of the file in the run folder."""
ENCODING, SCHEMA_ENCODING = "msgpack", "jsonschema"
ABOUT = "skinnet"
"""Name of the metadata record: format, version of skinnet, robot, deployment, seed, pace and base folder."""
DEPLOYMENT = "deployment.json"
"""Attachment: the whole deployment."""
MEMORY = "memory/"
"""Attachments below this name: the file of long-term memory that the controller started with."""


def recorded_channels() -> tuple[Channel, ...]:
    """The rows of the channel table that a recording holds."""
    return tuple(row for row in CHANNELS if row.recorded)


def expression(keys: Keys, row: Channel) -> str:
    """Key expression of all messages of a channel."""
    return keys.of(row.name, *["*"] * row.pattern.count("<"))


def schema_name(kind: type[Message]) -> str:
    """Name of the schema of a message."""
    return f"skinnet.{kind.__name__}"


@cache
def schema_of(kind: type[Message]) -> bytes:
    """JSON Schema of a message; what it calls base64 text travels as MessagePack's own bytes."""
    schema = msgspec.json.schema(kind)
    definitions: dict[str, Any] = schema.pop("$defs")
    whole = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **definitions.pop(kind.__name__),
        **({"$defs": definitions} if definitions else {}),
    }
    return msgspec.json.encode(whole)
