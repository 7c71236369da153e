"""A mailbox that other threads fill and one coroutine empties, with one wake-up per burst."""

import asyncio
import contextlib
from collections import deque

from skinnet.transport.base import Delivery

__all__ = ["Mailbox"]


class Mailbox:
    """Deliveries in order of arrival; `post` is safe from any thread, `receive` from one coroutine."""

    def __init__(self) -> None:
        self._waiting: deque[Delivery] = deque()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wake: asyncio.Event = asyncio.Event()
        self._asleep = False
        self._enough = 1

    def post(self, delivery: Delivery) -> None:
        """Adds a delivery; wakes the reader if it sleeps and this makes enough: bursts are cheap."""
        self._waiting.append(delivery)
        if self._asleep and self._loop is not None and self._is_enough(delivery):
            self._asleep = False
            with contextlib.suppress(RuntimeError):  # the loop has ended, nobody reads any more
                self._loop.call_soon_threadsafe(self._wake.set)

    def _is_enough(self, newest: Delivery) -> bool:
        return len(self._waiting) >= self._enough or newest.payload is None

    async def receive(self, timeout_s: float | None = None, enough: int = 1) -> list[Delivery]:
        """Everything that waits; sleeps until something does, at most `timeout_s`.

        Args:
            timeout_s: Returns what there is after this time, possibly nothing.
            enough: Need not wake for fewer deliveries than these, but for the loss of a process.
        """
        self._enough = enough
        if len(self._waiting) < enough:
            await self._sleep(timeout_s)
        batch: list[Delivery] = []
        with contextlib.suppress(IndexError):
            while True:
                batch.append(self._waiting.popleft())
        return batch

    async def _sleep(self, timeout_s: float | None) -> None:
        self._loop = asyncio.get_running_loop()
        self._wake.clear()
        self._asleep = True
        if len(self._waiting) >= self._enough:  # came between the look and the flag: its poster saw us awake
            self._asleep = False
            return
        alarm = None if timeout_s is None else self._loop.call_later(max(timeout_s, 0.0), self._wake.set)
        try:
            await self._wake.wait()
        finally:
            self._asleep = False
            if alarm is not None:
                alarm.cancel()
