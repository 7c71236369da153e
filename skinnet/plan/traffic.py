"""What the cells of a deployment send: how much at once, how much in the long run."""

import math
from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.deployment.schema import NetworkSpec
from skinnet.messages import FORCE_CHANNELS, READING_NAMES

__all__ = ["Source", "Traffic", "send_ns", "traffic_of"]

_AT_ONCE = {"clock": 0, "levels": FORCE_CHANNELS + 1, "delta": len(READING_NAMES)}
"""Events of one cell at one sample: all its channels may change at once; levels has force and proximity."""
_EXPLORING = ("structure", "map")
_FOREVER_NS = 10**12
_FULL = 1.0 + 1e-9


@dataclass(frozen=True)
class Source:
    """One kind of packets of a cell, all at the instants of its samples.

    Attributes:
        send_ns: Time on the wire of one packet [ns].
        at_once: Most packets at one sample.
        per_s: Packets a second in the long run [1/s].
        periodic: One burst every sample, whatever happens; else bursts come at random.
    """

    send_ns: int
    at_once: int
    per_s: float
    periodic: bool

    def work_ns(self, within_ns: int, period_ns: int) -> float:
        """Most time on the wire that packets of any stretch [0, `within_ns`) need [ns]."""
        by_samples = self.at_once * -(-within_ns // period_ns)
        if self.periodic:
            return float(by_samples * self.send_ns)
        return min(by_samples, self.at_once + self.per_s * within_ns * 1e-9) * self.send_ns


@dataclass(frozen=True)
class Traffic:
    """Load of a skin.

    Attributes:
        encoding: How cells send.
        why: Why that, in words.
        period_ns: Period of the samples [ns].
        stimulated: Cells that are touched at once, anywhere on the skin.
        share: The same as a share of all cells.
        touched: What a touched cell sends.
        idle: What any other sends.
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
        """Every kind of packets with the share of the cells that send it."""
        return (*((s, self.share) for s in self.touched), *((s, 1.0 - self.share) for s in self.idle))

    @property
    def per_s(self) -> float:
        """Packets a second of a cell, on average [1/s]."""
        return sum(source.per_s * share for source, share in self.sources)

    @property
    def load(self) -> float:
        """Share of its time that a link sends for one cell, on average."""
        return sum(source.per_s * share * source.send_ns * 1e-9 for source, share in self.sources)

    def load_of(self, n_cells: int) -> float:
        """Share of its time that a link sends for `n_cells` cells, as many of them touched as can be."""
        touched, idle = self.split(n_cells)
        return touched * _load(self.touched) + idle * _load(self.idle)

    @property
    def longest_ns(self) -> int:
        """Time on the wire of the largest packet [ns]."""
        return max((source.send_ns for source, _ in self.sources), default=0)

    @property
    def shortest_ns(self) -> int:
        """Time on the wire of the smallest packet [ns]."""
        return min((source.send_ns for source, _ in self.sources), default=0)

    def at_once(self, n_cells: int) -> int:
        """Most packets that `n_cells` cells send in one period."""
        touched, idle = self.split(n_cells)
        return touched * sum(s.at_once for s in self.touched) + idle * sum(s.at_once for s in self.idle)

    def split(self, n_cells: int) -> tuple[int, int]:
        """How many of `n_cells` cells are touched, at worst, and how many are not."""
        touched = min(n_cells, self.stimulated)
        return touched, n_cells - touched

    def busy_ns(self, n_cells: int, spread_ns: int = 0) -> float:
        """Longest time that a link may have to send for `n_cells` cells without a pause [ns]; inf for ever.

        Args:
            n_cells: Cells whose packets go over the link.
            spread_ns: By how much packets of one cell may come nearer to each other on their way [ns].
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
    """Time on the wire of a packet [ns]; the packet kernel rounds alike."""
    return -(-size_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)


def traffic_of(deployment: Deployment) -> Traffic:
    """The load that `[plan]` describes."""
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
