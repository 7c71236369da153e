"""Recording source: playback of a recording with seeking."""

import bisect
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from skinnet.errors import ProtocolError, RecordingError
from skinnet.protocol.channels import channel as row_of
from skinnet.protocol.messages import decode
from skinnet.recording.reader import Recording
from skinnet.view.sources.playback_clock import PlaybackClock
from skinnet.view.state.run_state import RASTER_NS, ReceivedMessage, RunSnapshot, RunState

__all__ = ["RecordingSource"]

_READ_CHANNELS = {
    "joints",
    "free_bodies",
    "command",
    "events",
    "bundle",
    "stream",
    "regions",
    "topology",
    "state",
    "answer",
    "state_machine",
    "counters",
}
"""Channels that the page shows."""
_SNAPSHOT_PERIOD_NS = 5_000_000_000
_MAX_READ_S = 0.15
"""Maximum reading time per call [s], so that the page stays responsive while catching up."""
_MESSAGES_PER_CLOCK_CHECK = 200


class RecordingSource:
    """Recording source with playback and seeking.

    To seek backwards, it restores the scene's snapshot at least one raster length earlier and reads the file
    again from there.

    Args:
        path: Path of the recording.
        base: Folder with the model, if it differs from the run's.
        now_s: Present wall time [s].

    Raises:
        RecordingError: the file is unreadable, or has no message.
        DeploymentError: this program has other deployment keys than the one that recorded.
    """

    end_reason = ""

    def __init__(self, path: Path, base: Path | None, now_s: float) -> None:
        self.recording = Recording(path)
        self.deployment, self.base = self.recording.deployment(), base or self.recording.base
        self.title = path.name
        self.n_malformed = 0
        first = next(self._read(0), None)
        if first is None:
            raise RecordingError(f"{path}: the recording has no messages")
        self.clock = PlaybackClock(first.t_ns, self.recording.end_ns, now_s)
        self._messages: Iterator[ReceivedMessage] = self._read(0)
        self._next: ReceivedMessage | None = None
        self._read_ns = -1
        self._n_seeks = 0
        self._snapshot_times_ns: list[int] = []
        self._snapshots: list[RunSnapshot] = []

    def deliver(self, run_state: RunState, now_s: float) -> int:
        """Deliver the messages up to the playback position to `run_state`; return their number."""
        position_ns = self.clock.position_ns(now_s)
        if not self._snapshots:
            self._take_snapshot(run_state, -1)
        if self.clock.n_seeks != self._n_seeks:
            self._n_seeks = self.clock.n_seeks
            self._seek(run_state, position_ns)
        count, until_s = 0, time.monotonic() + _MAX_READ_S
        while (told := self._next or next(self._messages, None)) is not None:
            self._next = told
            if told.t_ns > position_ns:
                break
            self._next = None
            if told.t_ns >= self._snapshot_times_ns[-1] + _SNAPSHOT_PERIOD_NS:
                self._take_snapshot(run_state, told.t_ns)
            run_state.apply(told, now_s)
            self._read_ns = told.t_ns
            count += 1
            if count % _MESSAGES_PER_CLOCK_CHECK == 0 and time.monotonic() > until_s:
                if self.clock.playing:
                    self.clock.resume_from(told.t_ns, now_s)
                return count
        run_state.t_ns = position_ns
        return count

    def properties(self) -> Mapping[str, str]:
        """Properties of the recording, as text by name."""
        facts = {"recording": str(self.recording.path), "length": f"{self.recording.end_ns * 1e-9:.1f} s"}
        if not self.recording.complete:
            facts["it was cut"] = "it goes up to here"
        return facts | ({"unreadable messages": f"{self.n_malformed}"} if self.n_malformed else {})

    def close(self) -> None:
        """Drop the snapshots."""
        self._snapshots.clear()

    def _read(self, from_ns: int) -> Iterator[ReceivedMessage]:
        """Messages from a time [ns] on; undecodable ones are skipped and counted."""
        for t_ns, _, channel, fields, payload in self.recording.messages(from_ns):
            if channel not in _READ_CHANNELS:
                continue
            try:
                yield ReceivedMessage(channel, fields, decode(payload, row_of(channel).message), t_ns)
            except ProtocolError:
                self.n_malformed += 1

    def _take_snapshot(self, run_state: RunState, t_ns: int) -> None:
        self._snapshot_times_ns.append(t_ns)
        self._snapshots.append(run_state.snapshot())

    def _seek(self, run_state: RunState, t_ns: int) -> None:
        """Restore a snapshot before `t_ns` and reread from it, unless reading on is enough."""
        before_ns = t_ns - RASTER_NS
        kept = max(bisect.bisect_right(self._snapshot_times_ns, before_ns) - 1, 0)
        if self._read_ns <= t_ns and self._snapshot_times_ns[kept] <= self._read_ns:
            return
        run_state.restore(self._snapshots[kept])
        self._messages, self._next = self._read(max(self._snapshot_times_ns[kept], 0)), None
        self._read_ns = self._snapshot_times_ns[kept]
