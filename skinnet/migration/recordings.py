"""Messages of recordings of earlier formats, translated to the present ones."""

import re
from collections.abc import Mapping
from typing import Any

import msgspec

from skinnet.errors import FormatError
from skinnet.migration.deployments import current_process, has_default_processes
from skinnet.migration.format_1 import (
    CHANNEL_KEYS,
    COUNTERS,
    ENCODINGS,
    FAULT_KINDS,
    MESSAGE_FIELDS,
    MESSAGE_TYPES,
)
from skinnet.migration.renaming import rename_keys

__all__ = ["FORMAT", "MessageTranslator", "is_channel_key"]

FORMAT = 2
"""Format of recordings, in their metadata."""
_decode = msgspec.msgpack.Decoder().decode
_encode = msgspec.msgpack.Encoder().encode
_PATTERNS = tuple((re.compile(old), new) for old, new in CHANNEL_KEYS)
_COUNTERS_KEY = re.compile(r"process/([^/]+)/counters")
_PREFIX = "skinnet/"
_SCHEMA = 2
"""Schema version of messages that format 2 holds."""
_DECODE_ERRORS = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)


def is_channel_key(topic: str) -> bool:
    """Test whether a topic is a key of the middleware; others, such as Foxglove's, stay as they are."""
    return topic.startswith(_PREFIX)


class MessageTranslator:
    """Translator of the keys and messages of one recording of format 1.

    Args:
        deployment: Deployment of the recording, in format 1: cell processes that the program named have other
            names now.
    """

    def __init__(self, deployment: Mapping[str, Any]) -> None:
        self._default_processes = has_default_processes(deployment)
        self._keys: dict[str, str] = {}

    def key(self, key: str) -> str:
        """Present key of a message that format 1 put on `key`."""
        if key not in self._keys:
            self._keys[key] = self._translated_key(key)
        return self._keys[key]

    def message(self, payload: bytes) -> bytes:
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
        self._translate_values(kind, translated)
        return _encode(translated)

    def changed_names(self, key: str, payload: bytes) -> set[str]:
        """Names of a message of format 1 that differ today: its key, its type, its fields."""
        names = {key} if self.key(key) != key else set()
        message = _decoded(payload)
        if message is not None:
            kind = message["type"]
            names |= {kind} & MESSAGE_TYPES.keys()
            names |= {f"{kind}.{name}" for name in message if name in MESSAGE_FIELDS.get(kind, {})}
        return names

    def _translated_key(self, key: str) -> str:
        prefix, _, rest = key.partition("/")
        robot, slash, channel = rest.partition("/")
        if not slash or not is_channel_key(key):
            return key
        for pattern, new in _PATTERNS:
            if pattern.fullmatch(channel):
                channel = pattern.sub(new, channel)
                break
        if self._default_processes and (match := _COUNTERS_KEY.fullmatch(channel)):
            channel = f"process/{current_process(match[1])}/counters"
        return f"{prefix}/{robot}/{channel}"

    def _translate_values(self, kind: str, message: dict[str, Any]) -> None:
        match kind, message:
            case "fault", {"kind": str(fault)}:
                message["kind"] = FAULT_KINDS.get(fault, fault)
            case "config", {"encoding": str(encoding)}:
                message["encoding"] = ENCODINGS.get(encoding, encoding)
        match kind, message:
            case "fault", {"target": str(process)} if self._default_processes:
                message["target"] = current_process(process)
            case "counters", {"process": str(process)} if self._default_processes:
                message["process"] = current_process(process)


def _decoded(payload: bytes) -> dict[str, Any] | None:
    try:
        message = _decode(payload)
    except _DECODE_ERRORS:
        return None
    named = isinstance(message, dict) and all(isinstance(name, str) for name in message)
    return message if named and isinstance(message.get("type"), str) else None
