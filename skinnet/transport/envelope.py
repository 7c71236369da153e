"""Envelopes: what a process sends in one period to the same receivers travels as one.

An envelope carries the time of its departure by the machine's monotonic clock, so that its receiver knows
how long it was under way.
"""

import time
from collections.abc import Callable

import msgspec

from skinnet.transport.base import Delivery, matches

__all__ = ["TRANSIT_BINS", "Arrivals", "Messages", "seal"]

TRANSIT_BINS = 100_001
"""Microseconds up to 0.1 s."""
_KNOWN_KEYS = 100_000

Messages = list[tuple[str, bytes]]
"""Keys and payloads."""
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(tuple[int, Messages]).decode


def seal(messages: Messages) -> bytes:
    """An envelope that departs now."""
    return _encode((time.monotonic_ns(), messages))


class Arrivals:
    """The envelopes of one subscription: opens them, hands on what is wanted, counts.

    Zenoh has a thread for each subscription, so each has counts of its own.

    Args:
        expressions: What is wanted.
        on_messages: Called with what was wanted of an envelope, if anything was.
    """

    def __init__(self, expressions: tuple[str, ...], on_messages: Callable[[list[Delivery]], None]) -> None:
        self._expressions = expressions
        self._on_messages = on_messages
        self._wanted: dict[str, bool] = {}
        self.malformed = 0
        self.n_bytes = 0
        self.by_transit_us: dict[int, int] = {}

    def take(self, _key: str, envelope: bytes) -> None:
        """Opens an envelope; one that cannot be opened is counted."""
        try:
            t_sent_ns, messages = _decode(envelope)
        except msgspec.DecodeError:
            self.malformed += 1
            return
        transit_us = min(max(time.monotonic_ns() - t_sent_ns, 0) // 1000, TRANSIT_BINS - 1)
        self.by_transit_us[transit_us] = self.by_transit_us.get(transit_us, 0) + 1
        self.n_bytes += len(envelope)
        wanted = self._wanted
        deliveries = [
            Delivery(key, payload)
            for key, payload in messages
            if (self._is_wanted(key) if (known := wanted.get(key)) is None else known)
        ]
        if deliveries:
            self._on_messages(deliveries)

    def _is_wanted(self, key: str) -> bool:
        wanted = any(matches(expression, key) for expression in self._expressions)
        if len(self._wanted) < _KNOWN_KEYS:
            self._wanted[key] = wanted
        return wanted
