"""Timeouts of upstreams: how long each missing one has been waited for, and when it counts as lost.

An upstream is silent if its process is there but sends no period end for the run's deadline, and gone if the
process has left the loop. Waits are counted in slices, so that a process that was itself paused, or kept from
running by a busy computer, counts no more than one slice of that time against its upstreams.
"""

from collections.abc import Iterable, Set

from skinnet.protocol.channels import RECORDER
from skinnet.runtime.upstream import Upstream

__all__ = ["UpstreamTimeouts"]

_LIVELINESS_GRACE_S = 0.2
"""Grace period [s]: the loss of a token may overtake the last messages, which come through another thread."""
_INDIRECT_DEADLINES = 2
"""Deadlines for an upstream that may itself be waiting, until its own deadline, for one that may be lost."""
_N_SLICES = 8
_MAX_SLICE_S = 60.0
"""Slices of a limit, and the longest one [s]."""


class UpstreamTimeouts:
    """Timeouts of the upstreams of one process.

    Args:
        name: Name of the process.
        deadline_s: Deadline of the run [s].
        tolerated_losses: Names of the processes whose loss does not end this one.
    """

    def __init__(self, name: str, deadline_s: float, tolerated_losses: Set[str]) -> None:
        self._name, self._deadline_s, self._tolerated = name, deadline_s, tolerated_losses
        self._slice_s = min(deadline_s / _N_SLICES, _MAX_SLICE_S)
        self._waited_s: dict[tuple[str, bool], float] = {}  # by upstream, and whether its process is gone

    def timeout_s(self, missing: Iterable[Upstream], gone: Set[str]) -> float:
        """Return the timeout [s] for the next message; `gone` are the processes that have left the loop."""
        if any(up.process in gone for up in missing):
            return min(_LIVELINESS_GRACE_S / _N_SLICES, self._slice_s)
        return self._slice_s

    def reset(self, upstream: Upstream) -> None:
        """Forget the wait for an upstream that has ended a period."""
        self._waited_s.pop((upstream.name, False), None)
        self._waited_s.pop((upstream.name, True), None)

    def is_over(self, upstream: Upstream, passed_s: float, *, gone: bool) -> bool:
        """Count a wait of `passed_s` [s] for a missing upstream; return whether it counts as lost now."""
        limit_s, slice_s = self.silence_limit_s(upstream), self._slice_s
        if gone:
            limit_s, slice_s = _LIVELINESS_GRACE_S, _LIVELINESS_GRACE_S / _N_SLICES
        key = upstream.name, gone
        self._waited_s[key] = waited_s = self._waited_s.get(key, 0.0) + min(passed_s, slice_s)
        return waited_s > limit_s * (1.0 - 1e-9)

    def silence_limit_s(self, upstream: Upstream) -> float:
        """Return the time [s] for which an upstream may be silent.

        Where losses are tolerated, a process that may not be lost, and the recorder's upstreams, get more: it
        may itself be waiting until the deadline for one that may.
        """
        is_indirect = self._name == RECORDER or (self._tolerated and upstream.process not in self._tolerated)
        return self._deadline_s * (_INDIRECT_DEADLINES if is_indirect else 1)

    def silence_text(self, upstream: Upstream) -> str:
        """Describe the silence of an upstream."""
        return (
            f"is silent: it runs, but sent no period end for {self.silence_limit_s(upstream):g} s "
            f"(run.deadline_s is {self._deadline_s:g})"
        )
