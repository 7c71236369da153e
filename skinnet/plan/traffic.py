"""Traffic of a deployment's cells: burst sizes and long-run rates."""

import math
from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.deployment.schema import NetworkSpec
from skinnet.messages import FORCE_CHANNELS, READING_NAMES

__all__ = ["Source", "Traffic", "send_ns", "traffic_of"]

_AT_ONCE = {"clock": 0, "levels": FORCE_CHANNELS + 1, "delta": len(READING_NAMES)}
"""Burst size [events] of one cell at one sample: all its channels; levels has force and proximity only."""
_EXPLORING = ("structure", "map")
_FOREVER_NS = 10**12
_FULL = 1.0 + 1e-9


@dataclass(frozen=True)
class Source:
    """Packet source of a cell: packets of one kind, sent at its sampling instants.

    Attributes:
        send_ns: Transmission time of one packet [ns].
        at_once: Most packets at one sample.
        per_s: Long-run packet rate [1/s].
        periodic: True for one burst at every sample; else bursts come at random.
    """

    send_ns: int
    at_once: int
    per_s: float
    periodic: bool

    def work_ns(self, within_ns: int, period_ns: int) -> float:
        """Arrival curve: most transmission time of the packets of any window of `within_ns` [ns]."""
        by_samples = self.at_once * -(-within_ns // period_ns)
        if self.periodic:
            return float(by_samples * self.send_ns)
        return min(by_samples, self.at_once + self.per_s * within_ns * 1e-9) * self.send_ns


@dataclass(frozen=True)
class Traffic:
    """Traffic of a skin: packet sources of touched and of idle cells.

    Attributes:
        encoding: Event encoding of the cells.
        why: Reason for this encoding, in words.
        period_ns: Sampling period [ns].
        stimulated: Number of cells that are touched at once, anywhere on the skin.
        share: Fraction of cells that are touched at once.
        touched: Packet sources of a touched cell.
        idle: Packet sources of any other cell.
    """

    encoding: str
    why: str
    period_ns: int
    stimulated: int
    share: float
    touched: tuple[Source, ...]
    idle: tuple[Source, ...]

    @property
    def sources(self) -> tuple[tuple[Source, float], ...]:
        """Packet sources, each with the fraction of the cells that have it."""
        return (*((s, self.share) for s in self.touched), *((s, 1.0 - self.share) for s in self.idle))

    @property
    def per_s(self) -> float:
        """Mean packet rate of a cell [1/s]."""
        return sum(source.per_s * share for source, share in self.sources)

    @property
    def load(self) -> float:
        """Mean link utilisation by one cell."""
        return sum(source.per_s * share * source.send_ns * 1e-9 for source, share in self.sources)

    def load_of(self, n_cells: int) -> float:
        """Link utilisation by `n_cells` cells, as many of them touched as possible."""
        touched, idle = self.split(n_cells)
        return touched * _load(self.touched) + idle * _load(self.idle)

    @property
    def longest_ns(self) -> int:
        """Transmission time of the largest packet [ns]."""
        return max((source.send_ns for source, _ in self.sources), default=0)

    @property
    def shortest_ns(self) -> int:
        """Transmission time of the smallest packet [ns]."""
        return min((source.send_ns for source, _ in self.sources), default=0)

    def at_once(self, n_cells: int) -> int:
        """Largest burst of `n_cells` cells in one period [packets]."""
        touched, idle = self.split(n_cells)
        return touched * sum(s.at_once for s in self.touched) + idle * sum(s.at_once for s in self.idle)

    def split(self, n_cells: int) -> tuple[int, int]:
        """Split `n_cells` cells into touched, as many as possible, and idle ones."""
        touched = min(n_cells, self.stimulated)
        return touched, n_cells - touched

    def busy_ns(self, n_cells: int, spread_ns: int = 0) -> float:
        """Longest busy period of a link that serves `n_cells` cells [ns]; inf if unbounded.

        Args:
            n_cells: Cells whose packets go over the link.
            spread_ns: Accumulated jitter, by which packets of one cell may come closer on their route [ns].
        """
        touched, idle = self.split(n_cells)

        def work_ns(within_ns: int) -> int:
            return math.ceil(
                touched
                * sum(source.work_ns(within_ns + spread_ns, self.period_ns) for source in self.touched)
                + idle * sum(source.work_ns(within_ns + spread_ns, self.period_ns) for source in self.idle)
            )

        if self.load_of(n_cells) > _FULL:
            return math.inf
        busy_ns = work_ns(1)
        while (longer_ns := work_ns(busy_ns)) > busy_ns:
            if longer_ns > _FOREVER_NS:
                return math.inf
            busy_ns = longer_ns
        return float(busy_ns)


def _load(sources: tuple[Source, ...]) -> float:
    return sum(source.per_s * source.send_ns * 1e-9 for source in sources)


def send_ns(network: NetworkSpec, size_bytes: int) -> int:
    """Transmission time of a packet [ns], rounded as in the packet kernel."""
    return -(-size_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)


def traffic_of(deployment: Deployment) -> Traffic:
    """Traffic of a deployment as its `[plan]` describes it."""
    plan, network = deployment.plan, deployment.network
    encoding, why = plan.encoding, "as plan.encoding says"
    if encoding is None:
        explores = any(
            deployment.controller.stages[n].kind in _EXPLORING for n in deployment.controller.program
        )
        encoding, why = deployment.cells.encoding.kind, "as cells.encoding.kind says"
        if explores and encoding != "clock":
            encoding, why = "clock", "all cells stream while the program explores"
    period_ns = deployment.cells.period_ns
    reading = Source(send_ns(network, network.stream_bytes), 1, 1e9 / period_ns, periodic=True)
    n_cells = sum(patch.n_cells for patch in deployment.patches)
    if encoding == "clock":
        return Traffic(encoding, why, period_ns, n_cells, 1.0, (reading,), ())
    event_ns = send_ns(network, network.event_bytes)
    touched: tuple[Source, ...] = (Source(event_ns, _AT_ONCE[encoding], plan.events_hz, periodic=False),)
    if plan.streams_when_touched:
        touched += (reading,)
    idle = (Source(event_ns, 1, plan.idle_events_hz, periodic=False),)
    return Traffic(
        encoding,
        why,
        period_ns,
        math.ceil(plan.stimulated * n_cells),
        plan.stimulated,
        tuple(source for source in touched if source.per_s),
        tuple(source for source in idle if source.per_s),
    )
