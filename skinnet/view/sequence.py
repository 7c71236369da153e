"""What never came: the numbers of a source that are missing."""

from collections.abc import Sequence

__all__ = ["Numbering"]


class Numbering:
    """Counts the gaps in the numbers that a source gives to what it sends.

    What a source numbers one after the other may come in several messages, in any order, as long as they come
    close together: a number is missing if it is not there when `settle` is called for the second time.
    """

    def __init__(self) -> None:
        self._first: int | None = None
        self._mark = -1
        self._highest = -1
        self._up_to_mark = 0
        self._beyond = 0

    def take(self, numbers: Sequence[int]) -> None:
        """These came."""
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
        """How many of those are missing that should have been there when this was called before."""
        if self._first is None:
            return 0
        missing = self._mark + 1 - self._first - self._up_to_mark
        self._mark = self._highest
        self._up_to_mark += self._beyond
        self._beyond = 0
        return max(missing, 0)
