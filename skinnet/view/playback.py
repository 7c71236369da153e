"""Where a recording is played: position, pause, rate and loop over the clock on the wall. No I/O."""

__all__ = ["Playback"]


class Playback:
    """A position that moves with the clock on the wall.

    Args:
        start_ns: Where the recording begins [ns].
        end_ns: Where it ends [ns].
        now_s: Present time of the wall's clock [s].

    Attributes:
        playing: Whether it moves.
        rate: Simulated seconds per second.
        loop: Whether it begins anew at the end, or stops there.
        jumps: How often it was put elsewhere.
    """

    def __init__(self, start_ns: int, end_ns: int, now_s: float) -> None:
        self.start_ns, self.end_ns = start_ns, end_ns
        self.playing, self.rate, self.loop = True, 1.0, False
        self.jumps = 0
        self._from_ns, self._since_s = start_ns, now_s

    def position_ns(self, now_s: float) -> int:
        """Where it is; at the end it stops, or begins anew."""
        if not self.playing:
            return self._from_ns
        position_ns = self._from_ns + round((now_s - self._since_s) * self.rate * 1e9)
        if position_ns < self.end_ns:
            return max(position_ns, self.start_ns)
        if self.loop and self.end_ns > self.start_ns:
            self.seek(self.start_ns, now_s)
            return self.start_ns
        self._from_ns, self.playing = self.end_ns, False
        return self.end_ns

    def seek(self, t_ns: int, now_s: float) -> None:
        """Goes to a time, or as near as the recording comes."""
        self.jumps += 1
        self.wait_at(min(max(t_ns, self.start_ns), self.end_ns), now_s)

    def wait_at(self, t_ns: int, now_s: float) -> None:
        """Goes on from `t_ns`, which is as far as one got: the clock is faster than the reader."""
        self._from_ns, self._since_s = t_ns, now_s

    def play(self, now_s: float) -> None:
        """Moves; at the end, from the beginning on."""
        if self.playing:
            return
        if self._from_ns >= self.end_ns:
            self.seek(self.start_ns, now_s)
        self.playing, self._since_s = True, now_s

    def pause(self, now_s: float) -> None:
        """Stays where it is."""
        self._from_ns = self.position_ns(now_s)
        self.playing = False

    def set_rate(self, rate: float, now_s: float) -> None:
        """Moves at another rate from here on."""
        if rate <= 0.0:
            raise ValueError(f"rate is {rate}; it is above 0")
        self._from_ns, self._since_s = self.position_ns(now_s), now_s
        self.rate = rate
