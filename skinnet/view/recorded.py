"""Recording source: playback of a recording with seeking."""

import bisect
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from skinnet.channels import channel as row_of
from skinnet.errors import ProtocolError, RecordingError
from skinnet.messages import decode
from skinnet.recording.reader import Recording
from skinnet.view.playback import Playback
from skinnet.view.state import RASTER_NS, Kept, Scene, Told

__all__ = ["RecordedSource"]

_SHOWN = {
    "joints",
    "world",
    "command",
    "events",
    "bundle",
    "stream",
    "regions",
    "topology",
    "state",
    "answer",
    "machine",
    "counters",
}
"""Channels that the page shows."""
_KEEP_EVERY_NS = 5_000_000_000
_BUDGET_S = 0.15
"""Maximum reading time per call [s], so that the page stays responsive while catching up."""
_LOOK_EVERY = 200


class RecordedSource:
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

    over = ""

    def __init__(self, path: Path, base: Path | None, now_s: float) -> None:
        self.recording = Recording(path)
        self.deployment, self.base = self.recording.deployment(), base or self.recording.base
        self.title = path.name
        self.malformed = 0
        first = next(self._read(0), None)
        if first is None:
            raise RecordingError(f"{path}: there is no message in it: nothing to see")
        self.playback = Playback(first.t_ns, self.recording.end_ns, now_s)
        self._messages: Iterator[Told] = self._read(0)
        self._next: Told | None = None
        self._read_ns = -1
        self._jumps = 0
        self._kept_ns: list[int] = []
        self._kept: list[Kept] = []

    def feed(self, scene: Scene, now_s: float) -> int:
        """Deliver the messages up to the playback position to `scene`; return their number."""
        position_ns = self.playback.position_ns(now_s)
        if not self._kept:
            self._keep(scene, -1)
        if self.playback.jumps != self._jumps:
            self._jumps = self.playback.jumps
            self._go_to(scene, position_ns)
        count, until_s = 0, time.monotonic() + _BUDGET_S
        while (told := self._next or next(self._messages, None)) is not None:
            self._next = told
            if told.t_ns > position_ns:
                break
            self._next = None
            if told.t_ns >= self._kept_ns[-1] + _KEEP_EVERY_NS:
                self._keep(scene, told.t_ns)
            scene.take(told, now_s)
            self._read_ns = told.t_ns
            count += 1
            if count % _LOOK_EVERY == 0 and time.monotonic() > until_s:
                if self.playback.playing:
                    self.playback.wait_at(told.t_ns, now_s)
                return count
        scene.t_ns = position_ns
        return count

    def facts(self) -> Mapping[str, str]:
        """Properties of the recording, as text by name."""
        facts = {"recording": str(self.recording.path), "length": f"{self.recording.end_ns * 1e-9:.1f} s"}
        if not self.recording.complete:
            facts["it was cut"] = "it goes up to here"
        return facts | ({"unreadable messages": f"{self.malformed}"} if self.malformed else {})

    def close(self) -> None:
        """Drop the snapshots."""
        self._kept.clear()

    def _read(self, from_ns: int) -> Iterator[Told]:
        """Messages from a time [ns] on; undecodable ones are skipped and counted."""
        for t_ns, _, channel, fields, payload in self.recording.messages(from_ns):
            if channel not in _SHOWN:
                continue
            try:
                yield Told(channel, fields, decode(payload, row_of(channel).message), t_ns)
            except ProtocolError:
                self.malformed += 1

    def _keep(self, scene: Scene, t_ns: int) -> None:
        self._kept_ns.append(t_ns)
        self._kept.append(scene.keep())

    def _go_to(self, scene: Scene, t_ns: int) -> None:
        """Restore a snapshot before `t_ns` and reread from it, unless reading on is enough."""
        before_ns = t_ns - RASTER_NS
        kept = max(bisect.bisect_right(self._kept_ns, before_ns) - 1, 0)
        if self._read_ns <= t_ns and self._kept_ns[kept] <= self._read_ns:
            return
        scene.recall(self._kept[kept])
        self._messages, self._next = self._read(max(self._kept_ns[kept], 0)), None
        self._read_ns = self._kept_ns[kept]
