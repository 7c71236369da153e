"""Messages of recordings of earlier formats, translated to the present ones."""

import re
from functools import cache
from typing import Any

import msgspec

from skinnet.errors import FormatError
from skinnet.migration.format_1 import (
    CHANNEL_KEYS,
    COUNTERS,
    ENCODINGS,
    FAULT_KINDS,
    MESSAGE_FIELDS,
    MESSAGE_TYPES,
)
from skinnet.migration.renaming import rename_keys

__all__ = ["FORMAT", "changed_names", "is_channel_key", "translate_key", "translate_message"]

FORMAT = 2
"""Format of recordings, in their metadata."""
_decode = msgspec.msgpack.Decoder().decode
_encode = msgspec.msgpack.Encoder().encode
_PATTERNS = tuple((re.compile(old), new) for old, new in CHANNEL_KEYS)
_PREFIX = "skinnet/"
_SCHEMA = 2
"""Schema version of messages that format 2 holds."""
_DECODE_ERRORS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)


def is_channel_key(topic: str) -> bool:
    """Test whether a topic is a key of the middleware; others, such as Foxglove's, stay as they are."""
    return topic.startswith(_PREFIX)


@cache
def translate_key(key: str) -> str:
    """Present key of a message that format 1 put on `key`."""
    prefix, _, rest = key.partition("/")
    robot, slash, channel = rest.partition("/")
    if not slash or not is_channel_key(key):
        return key
    for pattern, new in _PATTERNS:
        if pattern.fullmatch(channel):
            return f"{prefix}/{robot}/{pattern.sub(new, channel)}"
    return key


def translate_message(payload: bytes) -> bytes:
    """Present bytes of a message of format 1; its numbers stay as they are.

    What is no message stays as it is: the run counted and dropped it, and so does the replay.
    """
    message = _decoded(payload)
    if message is None:
        return payload
    kind = message["type"]
    fields = MESSAGE_FIELDS.get(kind, {})
    try:
        translated = rename_keys(message, lambda name: fields.get(name, name), kind)
        if isinstance(counts := translated.get("counts"), dict) and kind == "counters":
            translated["counts"] = rename_keys(counts, lambda name: COUNTERS.get(name, name), kind)
    except FormatError:
        return payload
    translated["type"] = MESSAGE_TYPES.get(kind, kind)
    translated["schema"] = _SCHEMA
    if kind == "fault":
        _replace(translated, "kind", FAULT_KINDS)
    elif kind == "config":
        _replace(translated, "encoding", ENCODINGS)
    return _encode(translated)


def changed_names(key: str, payload: bytes) -> set[str]:
    """Names of a message of format 1 that differ today: its key, its type, its fields."""
    names = {key} if translate_key(key) != key else set()
    message = _decoded(payload)
    if message is not None:
        kind = message["type"]
        names |= {kind} & MESSAGE_TYPES.keys()
        names |= {f"{kind}.{name}" for name in message if name in MESSAGE_FIELDS.get(kind, {})}
    return names


def _decoded(payload: bytes) -> dict[str, Any] | None:
    try:
        message = _decode(payload)
    except _DECODE_ERRORS:
        return None
    named = isinstance(message, dict) and all(isinstance(name, str) for name in message)
    return message if named and isinstance(message.get("type"), str) else None


def _replace(message: dict[str, Any], field: str, values: Any) -> None:
    value = message.get(field)
    if isinstance(value, str):
        message[field] = values.get(value, value)
