"""Message batches: all messages of one process, period and route group in one payload.

A batch carries its send time by the computer's monotonic clock, from which its receiver computes the transit
time.
"""

import time
from collections.abc import Callable

import msgspec

from skinnet.transport.base import Delivery, matches

__all__ = ["TRANSIT_BINS", "Arrivals", "Messages", "seal"]

TRANSIT_BINS = 100_001
"""Transit-time histogram bins of 1 µs, up to 0.1 s."""
_KNOWN_KEYS = 100_000

Messages = list[tuple[str, bytes]]
"""Messages as (key, payload)."""
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(tuple[int, Messages]).decode


def seal(messages: Messages) -> bytes:
    """Encode a batch, stamped with the current monotonic time [ns]."""
    return _encode((time.monotonic_ns(), messages))


class Arrivals:
    """Batch reader of one subscription: decodes, filters by key, counts.

    Zenoh has a thread for each subscription, so each reader has counts of its own.

    Args:
        expressions: Key expressions of the messages to pass on.
        on_messages: Called with the matching messages of a batch, if there are any.

    Attributes:
        malformed: Batches that did not decode.
        n_bytes: Bytes received.
        by_transit_us: Batches by transit time [µs].
    """

    def __init__(self, expressions: tuple[str, ...], on_messages: Callable[[list[Delivery]], None]) -> None:
        self._expressions = expressions
        self._on_messages = on_messages
        self._wanted: dict[str, bool] = {}
        self.malformed = 0
        self.n_bytes = 0
        self.by_transit_us: dict[int, int] = {}

    def take(self, _key: str, envelope: bytes) -> None:
        """Decode a batch and pass on its matching messages; count a malformed one."""
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
