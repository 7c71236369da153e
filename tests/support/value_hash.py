"""Hash of the values in a recording that knows no names: channel number, time, raw numbers.

Renaming a key, a field, a class or a state leaves the hash as it was; any other number changes it. Only the
libraries of MCAP and MessagePack read the file, so the hash holds for recordings of every format.
"""

import hashlib
import re
import struct
from collections import defaultdict
from pathlib import Path
from typing import Any

import msgpack
from mcap.reader import make_reader

__all__ = ["channel_hashes", "value_hash"]

_CHANNELS = (
    (r"body/(world|free_bodies)",),
    (r"body/joints",),
    (r"body/command",),
    (r"skin/[^/]+/[^/]+/events",),
    (r"skin/[^/]+/events",),
    (r"skin/[^/]+/stream",),
    (r"skin/[^/]+/(frame|period_end)",),
    (r"skin/[^/]+/regions",),
    (r"skin/[^/]+/topology",),
    (r"skin/[^/]+/[^/]+/config",),
    (r"controller/request/[^/]+",),
    (r"controller/velocity",),
    (r"controller/answer",),
    (r"controller/state",),
    (r"controller/(machine|state_machine)",),
    (r"(host|process)/[^/]+/counters",),
    (r"run/fault",),
)
"""Channels by number: key below `skinnet/<robot>/` in every format. Frozen: new channels come last."""
_NUMBERS = [re.compile(f"skinnet/[^/]+/(?:{pattern})$") for (pattern,) in _CHANNELS]
_NAMES = ("type", "schema")
"""Fields of a message that say what it is, not what it measured."""


def value_hash(path: Path) -> str:
    """SHA-256 over all channels of a recording."""
    return hashlib.sha256(repr(sorted(channel_hashes(path).items())).encode()).hexdigest()


def channel_hashes(path: Path) -> dict[int, str]:
    """SHA-256 of each channel by its number: of its topics one by one, whatever they are called."""
    topics: defaultdict[tuple[int, str], Any] = defaultdict(hashlib.sha256)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            number = _number(channel.topic)
            if number is not None:
                log = topics[number, channel.topic]
                log.update(struct.pack("<q", message.log_time))
                log.update(_values(msgpack.unpackb(message.data, strict_map_key=False)))
    channels: defaultdict[int, list[str]] = defaultdict(list)
    for (number, _), log in topics.items():
        channels[number].append(log.hexdigest())
    return {
        number: hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()
        for number, digests in sorted(channels.items())
    }


def _number(topic: str) -> int | None:
    return next((number for number, shape in enumerate(_NUMBERS) if shape.match(topic)), None)


def _values(message: dict[str, Any]) -> bytes:
    """Numbers of a message in the order of its fields; text counts for nothing."""
    return b"".join(_packed(value) for name, value in message.items() if name not in _NAMES)


def _packed(value: Any) -> bytes:
    match value:
        case None:
            return b"n"
        case bool():
            return b"t" if value else b"f"
        case int():
            return b"i" + value.to_bytes(16, "little", signed=True)
        case float():
            return b"d" + struct.pack("<d", value)
        case bytes():
            return b"b" + value
        case str():
            return b"s"
        case list():
            return b"[" + b"".join(map(_packed, value)) + b"]"
        case dict():  # entries go by name, and names may change: their order counts for nothing
            return b"{" + b"".join(sorted(map(_packed, value.values()))) + b"}"
    raise TypeError(f"a {type(value).__name__} in a message")
