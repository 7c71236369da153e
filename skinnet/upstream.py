"""What a process knows of those it listens to: how far each has said all it had to say."""

from collections import deque

__all__ = ["Upstream"]


class Upstream:
    """One source of frames.

    A frame closes a period: it says up to which time its source has said everything, and how many messages
    belong to that period. It counts only when that many have come in, so nothing depends on the order
    in which messages arrive.

    Attributes:
        name: Name of the source, e.g. a patch.
        process: Name of the process whose loss is the loss of this source.
        covered_ns: Everything before this time has been said and has arrived.
        lost: The source is gone; nobody waits for it any more.
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
        """`count` messages of the source came in."""
        self._arrived += count
        self._settle()

    def close(self, covered_ns: int, count: int = 0) -> None:
        """The frame came in that closes a period of `count` messages."""
        self._announced += count
        self._open.append((covered_ns, self._announced))
        self._settle()

    def _settle(self) -> None:
        while self._open and self._open[0][1] <= self._arrived:
            self.covered_ns = max(self.covered_ns, self._open.popleft()[0])

    @property
    def missing(self) -> int:
        """Messages that frames announced and that have not come in."""
        return max(0, self._announced - self._arrived)
