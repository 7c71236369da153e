"""A recording as a source: it is played, and one may go anywhere in it."""

import bisect
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from skinnet.view.playback import Playback
from skinnet.view.recording import Recording
from skinnet.view.state import RASTER_NS, Kept, Scene, Told

__all__ = ["RecordedSource"]

_KEEP_EVERY_NS = 5_000_000_000
_BUDGET_S = 0.15
"""So long a call reads at most: the page moves on while it catches up."""
_LOOK_EVERY = 200


class RecordedSource:
    """A recording that is played.

    To go back, the scene becomes what it was at a moment that was kept, one raster before; from there on the
    file is read again.

    Args:
        path: The file.
        base: Folder with the model, if it is not where the run had it.
        now_s: Present time of the wall's clock [s].

    Raises:
        RecordingError: it is no recording that this program understands.
        OSError: it cannot be read.
    """

    over = ""

    def __init__(self, path: Path, base: Path | None, now_s: float) -> None:
        self.recording = Recording(path, base)
        self.deployment, self.base = self.recording.deployment, self.recording.base
        self.title = path.name
        self.playback = Playback(self.recording.start_ns, self.recording.end_ns, now_s)
        self._messages: Iterator[Told] = self.recording.messages(0)
        self._next: Told | None = None
        self._read_ns = -1
        self._jumps = 0
        self._kept_ns: list[int] = []
        self._kept: list[Kept] = []

    def feed(self, scene: Scene, now_s: float) -> int:
        """Lets `scene` take what stands before the present position."""
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
        """Where it is."""
        facts = {"recording": str(self.recording.path), "length": f"{self.recording.end_ns * 1e-9:.1f} s"}
        return facts | ({"it is cut": "it goes up to here"} if self.recording.cut else {})

    def close(self) -> None:
        """Closes the file."""
        self.recording.close()

    def _keep(self, scene: Scene, t_ns: int) -> None:
        self._kept_ns.append(t_ns)
        self._kept.append(scene.keep())

    def _go_to(self, scene: Scene, t_ns: int) -> None:
        """Puts the scene to a moment before `t_ns`, unless it stands there already."""
        before_ns = t_ns - RASTER_NS
        kept = max(bisect.bisect_right(self._kept_ns, before_ns) - 1, 0)
        if self._read_ns <= t_ns and self._kept_ns[kept] <= self._read_ns:
            return
        scene.recall(self._kept[kept])
        self._messages, self._next = self.recording.messages(max(self._kept_ns[kept], 0)), None
        self._read_ns = self._kept_ns[kept]
