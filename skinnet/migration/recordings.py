"""Messages of recordings of earlier formats, translated to the present ones."""

import re
from functools import cache
from typing import Any

import msgspec

from skinnet.migration.format_1 import (
    CHANNEL_KEYS,
    COUNTERS,
    ENCODINGS,
    FAULT_KINDS,
    MESSAGE_FIELDS,
    MESSAGE_TYPES,
)

__all__ = ["translate_key", "translate_message"]

_decode = msgspec.msgpack.Decoder().decode
_encode = msgspec.msgpack.Encoder().encode
_PATTERNS = tuple((re.compile(old), new) for old, new in CHANNEL_KEYS)
_SCHEMA = 2


@cache
def translate_key(key: str) -> str:
    """Present key of a message that format 1 put on `key`."""
    prefix, robot, *rest = key.split("/", 2)
    if not rest:
        return key
    for pattern, new in _PATTERNS:
        if pattern.fullmatch(rest[0]):
            return f"{prefix}/{robot}/{pattern.sub(new, rest[0])}"
    return key


def translate_message(payload: bytes) -> bytes:
    """Present bytes of a message of format 1; its numbers stay as they are.

    Raises:
        ValueError: it is no message.
    """
    try:
        message = _decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"no message: {error}") from error
    match message:
        case {"type": str(kind)}:
            pass
        case _:
            raise ValueError("no message: it has no type")
    fields = MESSAGE_FIELDS.get(kind, {})
    translated = {fields.get(name, name): value for name, value in message.items()}
    translated["type"] = MESSAGE_TYPES.get(kind, kind)
    translated["schema"] = _SCHEMA
    _translate_values(kind, translated)
    return _encode(translated)


def _translate_values(kind: str, message: dict[str, Any]) -> None:
    match kind:
        case "counters":
            counts = message["counts"]
            message["counts"] = {COUNTERS.get(name, name): count for name, count in counts.items()}
        case "fault":
            message["kind"] = FAULT_KINDS.get(message["kind"], message["kind"])
        case "config" if message.get("encoding") is not None:
            message["encoding"] = ENCODINGS.get(message["encoding"], message["encoding"])
