"""Mailboxes for deliveries: one between tasks of an event loop, one filled by other threads.

Both wake their reader once per burst, and only when it has the number of deliveries that it needs.
"""

import asyncio
import threading
from collections import deque
from typing import Protocol

from skinnet.transport.interface import Delivery

__all__ = ["Mailbox", "TaskMailbox", "ThreadMailbox"]


class Mailbox(Protocol):
    """Mailbox with one reader."""

    def post(self, delivery: Delivery) -> None:
        """Add a delivery, from any thread."""

    def post_all(self, deliveries: list[Delivery]) -> None:
        """Add the deliveries of one batch, from any thread."""

    async def receive(self, timeout_s: float | None = None, min_count: int = 1) -> list[Delivery]:
        """Receive all deliveries since the last call; see `LoopTransport.receive`."""


def _running_loop() -> tuple[int, asyncio.AbstractEventLoop] | None:
    """Return the current thread id and its running event loop, or None."""
    try:
        return threading.get_ident(), asyncio.get_running_loop()
    except RuntimeError:
        return None


class TaskMailbox:
    """Mailbox between tasks of one event loop; posts of other threads go through that loop."""

    def __init__(self) -> None:
        self._reader = _running_loop()
        self._pending: list[Delivery] = []
        self._min_count = 1
        self._urgent = False
        self._wake = asyncio.Event()

    def post(self, delivery: Delivery) -> None:
        """Add a delivery."""
        self.post_all([delivery])

    def post_all(self, deliveries: list[Delivery]) -> None:
        """Add the deliveries of one batch."""
        if self._reader is not None and self._reader[0] != threading.get_ident():
            self._reader[1].call_soon_threadsafe(self._post_all, deliveries)
        else:
            self._post_all(deliveries)

    def _post_all(self, deliveries: list[Delivery]) -> None:
        self._pending.extend(deliveries)
        if any(payload is None for _, payload in deliveries):
            self._urgent = True
        if self._urgent or len(self._pending) >= self._min_count:
            self._wake.set()

    async def receive(self, timeout_s: float | None = None, min_count: int = 1) -> list[Delivery]:
        """See `LoopTransport.receive`."""
        self._reader = self._reader or _running_loop()
        self._min_count = min_count
        if len(self._pending) < min_count and not self._urgent:
            self._wake.clear()
            alarm = None
            if timeout_s is not None:
                alarm = asyncio.get_running_loop().call_later(max(timeout_s, 0.0), self._wake.set)
            await self._wake.wait()
            if alarm is not None:
                alarm.cancel()
        self._urgent = False
        batch, self._pending = self._pending, []
        return batch


class ThreadMailbox:
    """Mailbox filled by other threads; its reader blocks the thread, as a process has no other task."""

    def __init__(self) -> None:
        self._pending: deque[Delivery] = deque()
        self._min_count = 1
        self._reader_waiting = False
        self._urgent = False
        self._wake = threading.Semaphore(0)

    def post(self, delivery: Delivery) -> None:
        """Add a delivery; thread-safe."""
        self.post_all([delivery])

    def post_all(self, deliveries: list[Delivery]) -> None:
        """Add the deliveries of one batch."""
        self._pending.extend(deliveries)
        if any(payload is None for _, payload in deliveries):
            self._urgent = True
        if self._reader_waiting and (self._urgent or len(self._pending) >= self._min_count):
            self._reader_waiting = False
            self._wake.release()

    async def receive(self, timeout_s: float | None = None, min_count: int = 1) -> list[Delivery]:
        """See `LoopTransport.receive`."""
        if len(self._pending) < min_count:
            self._wait(timeout_s, min_count)
        self._urgent = False
        return [self._pending.popleft() for _ in range(len(self._pending))]

    def _wait(self, timeout_s: float | None, min_count: int) -> None:
        self._min_count = min_count
        self._reader_waiting = True
        # deliveries between the check in `receive` and the flag were posted without a wake-up
        if len(self._pending) < min_count and not self._urgent:
            self._wake.acquire(timeout=timeout_s)
        self._reader_waiting = False
        while self._wake.acquire(blocking=False):  # wake-ups released after this wait had timed out
            pass
