"""Playback of a recording to observers: the same messages on the same keys, at a chosen rate."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from skinnet.channels import OUTSIDE, Keys
from skinnet.clock import NS_PER_S
from skinnet.messages import encode
from skinnet.outside_messages import Deployed
from skinnet.recording.reader import Recorded, Recording
from skinnet.transport.zenoh import ZenohTransport

__all__ = ["Playback", "Stretch", "publish"]

_KEPT = ("topology", "state", "machine")
"""Channels whose newest message answers Zenoh queries, as in a run."""
_AHEAD_S = 0.001
"""Shortest wait [s] before a message; shorter ones are skipped."""


class Stretch(NamedTuple):
    """Playback range, rate and looping.

    Attributes:
        from_ns: Begin [ns].
        until_ns: End, inclusive [ns]; None for the end of the recording.
        rate: Simulated seconds per second of wall time.
        loop: Restart at the end.
    """

    from_ns: int = 0
    until_ns: int | None = None
    rate: float = 1.0
    loop: bool = False


class Playback:
    """Playback schedule: the messages of a stretch with their due times. No I/O but the file's."""

    def __init__(self, recording: Recording, stretch: Stretch) -> None:
        self._recording, self._stretch = recording, stretch
        self.newest: dict[str, bytes] = {}
        """Newest payload by key, for keys that answer queries."""

    @property
    def length_s(self) -> float:
        """Duration of one round in wall time [s]."""
        until_ns = self._recording.end_ns if self._stretch.until_ns is None else self._stretch.until_ns
        return max(until_ns - self._stretch.from_ns, 0) / NS_PER_S / self._stretch.rate

    def rounds(self) -> Iterator[tuple[float, Recorded]]:
        """Messages with their due times since the start [s]; endless if the stretch loops."""
        start_s = 0.0
        while True:
            yield from self._round(start_s)
            if not self._stretch.loop or self.length_s <= 0.0:
                return
            start_s += self.length_s

    def _round(self, start_s: float) -> Iterator[tuple[float, Recorded]]:
        stretch = self._stretch
        before = True
        earlier: dict[str, Recorded] = {}
        for message in self._recording.messages(0, stretch.until_ns):
            if message.t_ns < stretch.from_ns:
                if message.channel in _KEPT:
                    earlier[message.key] = message
                continue
            if before:  # an observer that joins here needs the state channels' earlier messages
                before = False
                for kept in earlier.values():
                    self.newest[kept.key] = kept.payload
                    yield start_s, kept
            if message.channel in _KEPT:
                self.newest[message.key] = message.payload
            yield start_s + (message.t_ns - stretch.from_ns) / NS_PER_S / stretch.rate, message


def publish(
    recording: Recording,
    stretch: Stretch,
    listen: str,
    *,
    base: Path,
    wait: bool,
    say: Callable[[str], None],
) -> int:
    """Publish a recording to the observers of an endpoint; return the number of messages.

    Args:
        recording: Recording to play.
        stretch: Range and rate.
        listen: Endpoint to listen on.
        base: Folder that relative paths in the deployment start from, as reported to observers.
        wait: Start when the first observer has subscribed.
        say: Called with each line for the user.

    Raises:
        PortInUseError: the endpoint is taken.
        RecordingError: the recording is damaged.
    """
    keys = Keys(recording.robot)
    playback = Playback(recording, stretch)
    transport = ZenohTransport(keys, OUTSIDE, listen=listen)
    try:
        text = msgspec.json.encode(recording.raw).decode()
        deployed = {keys.deployment: encode(Deployed(deployment=text, base=str(base)))}
        transport.serve(keys.deployment, lambda: deployed)
        for expression in (keys.of("topology", "*"), keys.of("state"), keys.of("machine")):
            transport.serve(expression, playback.newest.copy)
        somebody = threading.Event()
        transport.on_interest(f"{keys.prefix}**", lambda there: somebody.set() if there else None)
        say(f"watch with any Zenoh client: connect to {listen}, subscribe to {keys.prefix}**")
        if wait:
            somebody.wait()
        return _play(playback, transport)
    finally:
        transport.close()


def _play(playback: Playback, transport: ZenohTransport) -> int:
    begin_s = time.monotonic()
    count = 0
    for due_s, message in playback.rounds():
        early_s = begin_s + due_s - time.monotonic()
        if early_s > _AHEAD_S:
            time.sleep(early_s)
        transport.tell(message.key, message.payload)
        count += 1
    return count
