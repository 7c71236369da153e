"""Upstream watermarks: the time up to which each source has published all its messages."""

from collections import deque

__all__ = ["Upstream"]


class Upstream:
    """Upstream of a logical process: its watermark and message counts.

    A period end (null message) carries the watermark of its source and the number of messages of that period.
    The watermark advances once that many messages have arrived, so the result does not depend on their order
    of arrival.

    Attributes:
        name: Source name, e.g. a patch.
        process: Name of the process whose loss is the loss of this source.
        watermark_ns: Watermark [ns]: every message about the time before it has arrived.
        lost: The source is lost and no longer waited for.
    """

    def __init__(self, name: str, process: str, watermark_ns: int = 0) -> None:
        self.name = name
        self.process = process
        self.watermark_ns = watermark_ns
        self.lost = False
        self._arrived = 0
        self._announced = 0
        self._open_periods: deque[tuple[int, int]] = deque()

    def count_arrivals(self, count: int = 1) -> None:
        """Count `count` messages that arrived from the source."""
        self._arrived += count
        self._advance_watermark()

    def end_period(self, watermark_ns: int, count: int = 0) -> None:
        """Record the end of a period of `count` messages, with its watermark `watermark_ns` [ns]."""
        self._announced += count
        self._open_periods.append((watermark_ns, self._announced))
        self._advance_watermark()

    def _advance_watermark(self) -> None:
        while self._open_periods and self._open_periods[0][1] <= self._arrived:
            self.watermark_ns = max(self.watermark_ns, self._open_periods.popleft()[0])

    @property
    def n_missing(self) -> int:
        """Messages announced by period ends that have not arrived."""
        return max(0, self._announced - self._arrived)
