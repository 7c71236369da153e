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
        covered_ns: Watermark [ns]: every message about the time before it has arrived.
        lost: The source is lost and no longer waited for.
    """

    def __init__(self, name: str, process: str, covered_ns: int = 0) -> None:
        self.name = name
        self.process = process
        self.covered_ns = covered_ns
        self.lost = False
        self._arrived = 0
        self._announced = 0
        self._open: deque[tuple[int, int]] = deque()

    def arrive(self, count: int = 1) -> None:
        """Count `count` messages that arrived from the source."""
        self._arrived += count
        self._settle()

    def close(self, covered_ns: int, count: int = 0) -> None:
        """Record the end of a period of `count` messages, with its watermark `covered_ns` [ns]."""
        self._announced += count
        self._open.append((covered_ns, self._announced))
        self._settle()

    def _settle(self) -> None:
        while self._open and self._open[0][1] <= self._arrived:
            self.covered_ns = max(self.covered_ns, self._open.popleft()[0])

    @property
    def missing(self) -> int:
        """Messages announced by period ends that have not arrived."""
        return max(0, self._announced - self._arrived)
