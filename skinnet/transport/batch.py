"""Message batches: all messages of one process, period and route group in one payload.

A batch carries its send time by the computer's monotonic clock, from which its receiver computes the transit
time.
"""

import time
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.transport.interface import Delivery
from skinnet.transport.key_expressions import key_matches

__all__ = ["BatchReader", "BatchStatistics", "Messages", "encode_batch"]

_N_TRANSIT_BINS = 100_001
"""Transit-time histogram bins of 1 µs, up to 0.1 s."""
_MAX_CACHED_KEYS = 100_000

Messages = list[tuple[str, bytes]]
"""Messages as (key, payload)."""
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(tuple[int, Messages]).decode


def encode_batch(messages: Messages) -> bytes:
    """Encode a batch, stamped with the current monotonic time [ns]."""
    return _encode((time.monotonic_ns(), messages))


class BatchReader:
    """Batch reader of one subscription: decodes, filters by key, counts.

    Zenoh has a thread for each subscription, so each reader has counts of its own.

    Args:
        expressions: Key expressions of the messages to pass on.
        on_messages: Called with the matching messages of a batch, if there are any.

    Attributes:
        malformed: Batches that did not decode.
        received_bytes: Bytes received.
        transit_us_counts: Batches by transit time [µs].
    """

    def __init__(self, expressions: tuple[str, ...], on_messages: Callable[[list[Delivery]], None]) -> None:
        self._expressions = expressions
        self._on_messages = on_messages
        self._match_cache: dict[str, bool] = {}
        self.malformed = 0
        self.received_bytes = 0
        self.transit_us_counts: dict[int, int] = {}

    def read(self, _key: str, batch: bytes) -> None:
        """Decode a batch and pass on its matching messages; count a malformed one."""
        try:
            t_sent_ns, messages = _decode(batch)
        except msgspec.DecodeError:
            self.malformed += 1
            return
        transit_us = min(max(time.monotonic_ns() - t_sent_ns, 0) // 1000, _N_TRANSIT_BINS - 1)
        self.transit_us_counts[transit_us] = self.transit_us_counts.get(transit_us, 0) + 1
        self.received_bytes += len(batch)
        wanted = self._match_cache
        deliveries = [
            Delivery(key, payload)
            for key, payload in messages
            if (self._matches(key) if (known := wanted.get(key)) is None else known)
        ]
        if deliveries:
            self._on_messages(deliveries)

    def _matches(self, key: str) -> bool:
        wanted = any(key_matches(expression, key) for expression in self._expressions)
        if len(self._match_cache) < _MAX_CACHED_KEYS:
            self._match_cache[key] = wanted
        return wanted


class BatchStatistics:
    """Batch statistics of one process.

    Attributes:
        sent_bytes: Bytes of the batches sent.
    """

    def __init__(self) -> None:
        self.sent_bytes = 0
        self._readers: list[BatchReader] = []

    def add(self, reader: BatchReader) -> None:
        """Include the counts of `reader`."""
        self._readers.append(reader)

    @property
    def received_bytes(self) -> int:
        """Bytes of the batches received."""
        return sum(reader.received_bytes for reader in self._readers)

    @property
    def malformed_batches(self) -> int:
        """Number of batches that did not decode."""
        return sum(reader.malformed for reader in self._readers)

    @property
    def transit_histogram(self) -> NDArray[np.int64]:
        """Transit-time histogram of the batches, (100001,) bins of 1 µs; the last bin counts all longer ones.

        Valid only between processes of one computer, which share the monotonic clock.
        """
        histogram = np.zeros(_N_TRANSIT_BINS, dtype=np.int64)
        for reader in self._readers:
            for transit_us, count in reader.transit_us_counts.copy().items():
                histogram[transit_us] += count
        return histogram
