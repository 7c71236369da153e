"""Sequence-number gaps: losses between a sender and the page."""

from collections.abc import Sequence

__all__ = ["Numbering"]


class Numbering:
    """Gap counter of a sender's sequence numbers.

    Consecutive numbers may come in several messages and be reordered over a short time: a number counts as
    missing if it has not come by the second call of `settle` after a higher one.
    """

    def __init__(self) -> None:
        self._first: int | None = None
        self._mark = -1
        self._highest = -1
        self._up_to_mark = 0
        self._beyond = 0

    def take(self, numbers: Sequence[int]) -> None:
        """Add received numbers."""
        if not len(numbers):
            return
        if self._first is None:
            self._first = min(numbers)
            self._mark = self._highest = self._first - 1
        self._highest = max(self._highest, *numbers) if len(numbers) > 1 else max(self._highest, numbers[0])
        late = sum(number <= self._mark for number in numbers)
        self._up_to_mark += late
        self._beyond += len(numbers) - late

    def settle(self) -> int:
        """Count the missing numbers up to the highest one at the previous call."""
        if self._first is None:
            return 0
        missing = self._mark + 1 - self._first - self._up_to_mark
        self._mark = self._highest
        self._up_to_mark += self._beyond
        self._beyond = 0
        return max(missing, 0)
