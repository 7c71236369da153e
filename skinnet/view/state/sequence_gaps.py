"""Sequence-number gaps: losses between a sender and the page."""

from collections.abc import Sequence

__all__ = ["SequenceGaps"]


class SequenceGaps:
    """Gap counter of a sender's sequence numbers.

    Consecutive numbers may come in several messages and be reordered over a short time: a number counts as
    missing if it has not come by the second call of `count_missing` after a higher one.
    """

    def __init__(self) -> None:
        self._first: int | None = None
        self._previous_highest = -1
        self._highest = -1
        self._n_up_to_previous = 0
        self._n_above_previous = 0

    def add(self, numbers: Sequence[int]) -> None:
        """Add received numbers."""
        if not len(numbers):
            return
        if self._first is None:
            self._first = min(numbers)
            self._previous_highest = self._highest = self._first - 1
        self._highest = max(self._highest, *numbers) if len(numbers) > 1 else max(self._highest, numbers[0])
        late = sum(number <= self._previous_highest for number in numbers)
        self._n_up_to_previous += late
        self._n_above_previous += len(numbers) - late

    def count_missing(self) -> int:
        """Count the missing numbers up to the highest one at the previous call."""
        if self._first is None:
            return 0
        missing = self._previous_highest + 1 - self._first - self._n_up_to_previous
        self._previous_highest = self._highest
        self._n_up_to_previous += self._n_above_previous
        self._n_above_previous = 0
        return max(missing, 0)
