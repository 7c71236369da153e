"""Playback clock of a recording: position, pause, rate and loop against wall time. No I/O."""

__all__ = ["PlaybackClock"]


class PlaybackClock:
    """Playback clock, whose position advances with wall time.

    Args:
        start_ns: Begin of the recording [ns].
        end_ns: End of the recording [ns].
        now_s: Present wall time [s].

    Attributes:
        playing: Whether the position advances.
        rate: Simulated seconds per second of wall time.
        loop: Whether playback restarts at the end.
        n_seeks: Number of seeks.
    """

    def __init__(self, start_ns: int, end_ns: int, now_s: float) -> None:
        self.start_ns, self.end_ns = start_ns, end_ns
        self.playing, self.rate, self.loop = True, 1.0, False
        self.n_seeks = 0
        self._anchor_ns, self._anchor_s = start_ns, now_s

    def position_ns(self, now_s: float) -> int:
        """Playback position [ns]; stops or restarts at the end."""
        if not self.playing:
            return self._anchor_ns
        position_ns = self._anchor_ns + round((now_s - self._anchor_s) * self.rate * 1e9)
        if position_ns < self.end_ns:
            return max(position_ns, self.start_ns)
        if self.loop and self.end_ns > self.start_ns:
            self.seek(self.start_ns, now_s)
            return self.start_ns
        self._anchor_ns, self.playing = self.end_ns, False
        return self.end_ns

    def seek(self, t_ns: int, now_s: float) -> None:
        """Seek to a time [ns], clipped to the recording."""
        self.n_seeks += 1
        self.resume_from(min(max(t_ns, self.start_ns), self.end_ns), now_s)

    def resume_from(self, t_ns: int, now_s: float) -> None:
        """Continue from `t_ns`, the position reached by a reader slower than the clock."""
        self._anchor_ns, self._anchor_s = t_ns, now_s

    def play(self, now_s: float) -> None:
        """Start playback; at the end, restart."""
        if self.playing:
            return
        if self._anchor_ns >= self.end_ns:
            self.seek(self.start_ns, now_s)
        self.playing, self._anchor_s = True, now_s

    def pause(self, now_s: float) -> None:
        """Pause playback."""
        self._anchor_ns = self.position_ns(now_s)
        self.playing = False

    def set_rate(self, rate: float, now_s: float) -> None:
        """Set the playback rate.

        Raises:
            ValueError: `rate` is not above 0.
        """
        if rate <= 0.0:
            raise ValueError(f"rate is {rate}; it must be above 0")
        self._anchor_ns, self._anchor_s = self.position_ns(now_s), now_s
        self.rate = rate
