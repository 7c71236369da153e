"""Playback of a recording to observers: the same messages on the same keys, at a chosen rate."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from skinnet.clock import NS_PER_S
from skinnet.protocol.channels import Keys
from skinnet.protocol.external_messages import DeploymentInfo
from skinnet.protocol.messages import encode
from skinnet.recording.reader import RecordedMessage, Recording
from skinnet.transport.zenoh_session import ZenohSession

__all__ = ["PlaybackOptions", "PlaybackSchedule", "publish_recording"]

_LATCHED_CHANNELS = ("topology", "state", "state_machine")
"""Channels whose newest message answers Zenoh queries, as in a run."""
_MIN_WAIT_S = 0.001
"""Shortest wait [s] before a message; shorter ones are skipped."""


class PlaybackOptions(NamedTuple):
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


class PlaybackSchedule:
    """Playback schedule: the messages of a stretch with their due times. No I/O but the file's."""

    def __init__(self, recording: Recording, options: PlaybackOptions) -> None:
        self._recording, self._options = recording, options
        self.latched: dict[str, bytes] = {}
        """Newest payload by key, for keys that answer queries."""

    @property
    def duration_s(self) -> float:
        """Duration of one round in wall time [s]."""
        until_ns = self._recording.end_ns if self._options.until_ns is None else self._options.until_ns
        return max(until_ns - self._options.from_ns, 0) / NS_PER_S / self._options.rate

    def scheduled_messages(self) -> Iterator[tuple[float, RecordedMessage]]:
        """Messages with their due times since the start [s]; endless if the stretch loops."""
        start_s = 0.0
        while True:
            yield from self._scheduled_round(start_s)
            if not self._options.loop or self.duration_s <= 0.0:
                return
            start_s += self.duration_s

    def _scheduled_round(self, start_s: float) -> Iterator[tuple[float, RecordedMessage]]:
        stretch = self._options
        before = True
        earlier: dict[str, RecordedMessage] = {}
        for message in self._recording.messages(0, stretch.until_ns):
            if message.t_ns < stretch.from_ns:
                if message.channel in _LATCHED_CHANNELS:
                    earlier[message.key] = message
                continue
            if before:  # an observer that joins here needs the state channels' earlier messages
                before = False
                for kept in earlier.values():
                    self.latched[kept.key] = kept.payload
                    yield start_s, kept
            if message.channel in _LATCHED_CHANNELS:
                self.latched[message.key] = message.payload
            yield start_s + (message.t_ns - stretch.from_ns) / NS_PER_S / stretch.rate, message


def publish_recording(
    recording: Recording,
    options: PlaybackOptions,
    listen: str,
    *,
    base: Path,
    wait_for_subscriber: bool,
    log: Callable[[str], None],
) -> int:
    """Publish a recording to the observers of an endpoint; return the number of messages.

    Args:
        recording: Recording to play.
        options: Range and rate.
        listen: Endpoint to listen on.
        base: Folder that relative paths in the deployment start from, as reported to observers.
        wait_for_subscriber: Start when the first observer has subscribed.
        log: Called with each line for the user.

    Raises:
        PortInUseError: the endpoint is taken.
        RecordingError: the recording is damaged.
    """
    keys = Keys(recording.robot)
    playback = PlaybackSchedule(recording, options)
    session = ZenohSession.open_hub(listen)
    try:
        text = msgspec.json.encode(recording.deployment_dict).decode()
        deployed = {keys.deployment: encode(DeploymentInfo(deployment=text, base_folder=str(base)))}
        session.declare_queryable(keys.deployment, lambda query: query.reply_values(deployed))
        for expression in (keys.of("topology", "*"), keys.of("state"), keys.of("state_machine")):
            session.declare_queryable(expression, lambda query: query.reply_values(playback.latched.copy()))
        somebody = threading.Event()
        session.declare_matching_listener(f"{keys.prefix}**", lambda there: somebody.set() if there else None)
        log(f"watch with any Zenoh client: connect to {listen}, subscribe to {keys.prefix}**")
        if wait_for_subscriber:
            somebody.wait()
        return _play(playback, session)
    finally:
        session.close()


def _play(playback: PlaybackSchedule, session: ZenohSession) -> int:
    begin_s = time.monotonic()
    count = 0
    for due_s, message in playback.scheduled_messages():
        early_s = begin_s + due_s - time.monotonic()
        if early_s > _MIN_WAIT_S:
            time.sleep(early_s)
        session.put(message.key, message.payload)
        count += 1
    return count
