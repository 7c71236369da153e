"""Traffic of a deployment's cells: burst sizes and long-run rates."""

import math
from dataclasses import dataclass

from skinnet.deployment import Deployment
from skinnet.deployment.network import NetworkSpec
from skinnet.protocol.messages import N_FORCE_CHANNELS, READING_NAMES

__all__ = ["PacketSource", "Traffic", "traffic_of", "transmission_ns"]

_BURST_EVENTS = {"periodic": 0, "level_crossing": N_FORCE_CHANNELS + 1, "send_on_delta": len(READING_NAMES)}
"""Burst size [events] of one cell at one sample: all its channels; levels has force and proximity only."""
_STREAMING_STAGE_KINDS = ("structure", "map")
_MAX_BUSY_NS = 10**12
_FULL = 1.0 + 1e-9


@dataclass(frozen=True)
class PacketSource:
    """Packet source of a cell: packets of one kind, sent at its sampling instants.

    Attributes:
        transmission_ns: Transmission time of one packet [ns].
        burst_packets: Most packets at one sample.
        packets_per_s: Long-run packet rate [1/s].
        periodic: True for one burst at every sample; else bursts come at random.
    """

    transmission_ns: int
    burst_packets: int
    packets_per_s: float
    periodic: bool

    def arrival_curve_ns(self, window_ns: int, period_ns: int) -> float:
        """Arrival curve: most transmission time of the packets of any window of `window_ns` [ns]."""
        by_samples = self.burst_packets * -(-window_ns // period_ns)
        if self.periodic:
            return float(by_samples * self.transmission_ns)
        return (
            min(by_samples, self.burst_packets + self.packets_per_s * window_ns * 1e-9) * self.transmission_ns
        )


@dataclass(frozen=True)
class Traffic:
    """Traffic of a skin: packet sources of touched and of idle cells.

    Attributes:
        encoding: Event encoding of the cells.
        reason: Reason for this encoding, in words.
        period_ns: Sampling period [ns].
        touched_cells: Number of cells that are touched at once, anywhere on the skin.
        touched_fraction: Fraction of cells that are touched at once.
        touched_sources: Packet sources of a touched cell.
        idle_sources: Packet sources of any other cell.
    """

    encoding: str
    reason: str
    period_ns: int
    touched_cells: int
    touched_fraction: float
    touched_sources: tuple[PacketSource, ...]
    idle_sources: tuple[PacketSource, ...]

    @property
    def sources(self) -> tuple[tuple[PacketSource, float], ...]:
        """Packet sources, each with the fraction of the cells that have it."""
        return (
            *((s, self.touched_fraction) for s in self.touched_sources),
            *((s, 1.0 - self.touched_fraction) for s in self.idle_sources),
        )

    @property
    def packets_per_s(self) -> float:
        """Mean packet rate of a cell [1/s]."""
        return sum(source.packets_per_s * share for source, share in self.sources)

    @property
    def utilisation_per_cell(self) -> float:
        """Mean link utilisation by one cell."""
        return sum(
            source.packets_per_s * share * source.transmission_ns * 1e-9 for source, share in self.sources
        )

    def utilisation_of(self, n_cells: int) -> float:
        """Link utilisation by `n_cells` cells, as many of them touched as possible."""
        touched, idle = self.split_touched(n_cells)
        return touched * _utilisation(self.touched_sources) + idle * _utilisation(self.idle_sources)

    @property
    def max_transmission_ns(self) -> int:
        """Transmission time of the largest packet [ns]."""
        return max((source.transmission_ns for source, _ in self.sources), default=0)

    @property
    def min_transmission_ns(self) -> int:
        """Transmission time of the smallest packet [ns]."""
        return min((source.transmission_ns for source, _ in self.sources), default=0)

    def burst_packets(self, n_cells: int) -> int:
        """Largest burst of `n_cells` cells in one period [packets]."""
        touched, idle = self.split_touched(n_cells)
        return touched * sum(s.burst_packets for s in self.touched_sources) + idle * sum(
            s.burst_packets for s in self.idle_sources
        )

    def split_touched(self, n_cells: int) -> tuple[int, int]:
        """Split `n_cells` cells into touched, as many as possible, and idle ones."""
        touched = min(n_cells, self.touched_cells)
        return touched, n_cells - touched

    def busy_period_ns(self, n_cells: int, accumulated_jitter_ns: int = 0) -> float:
        """Longest busy period of a link that serves `n_cells` cells [ns]; inf if unbounded.

        Args:
            n_cells: Cells whose packets go over the link.
            accumulated_jitter_ns: Accumulated jitter, by which packets of one cell may come closer on their
                route [ns].
        """
        touched, idle = self.split_touched(n_cells)

        def work_ns(within_ns: int) -> int:
            return math.ceil(
                touched
                * sum(
                    source.arrival_curve_ns(within_ns + accumulated_jitter_ns, self.period_ns)
                    for source in self.touched_sources
                )
                + idle
                * sum(
                    source.arrival_curve_ns(within_ns + accumulated_jitter_ns, self.period_ns)
                    for source in self.idle_sources
                )
            )

        if self.utilisation_of(n_cells) > _FULL:
            return math.inf
        busy_ns = work_ns(1)
        while (longer_ns := work_ns(busy_ns)) > busy_ns:
            if longer_ns > _MAX_BUSY_NS:
                return math.inf
            busy_ns = longer_ns
        return float(busy_ns)


def _utilisation(sources: tuple[PacketSource, ...]) -> float:
    return sum(source.packets_per_s * source.transmission_ns * 1e-9 for source in sources)


def transmission_ns(network: NetworkSpec, size_bytes: int) -> int:
    """Transmission time of a packet [ns], rounded as in the packet kernel."""
    return -(-size_bytes * network.bits_per_byte * 1_000_000_000 // network.bits_per_s)


def traffic_of(deployment: Deployment) -> Traffic:
    """Traffic of a deployment as its `[plan]` describes it."""
    plan, network = deployment.plan, deployment.network
    encoding, why = plan.encoding, "as plan.encoding says"
    if encoding is None:
        explores = any(
            deployment.controller.stages[n].kind in _STREAMING_STAGE_KINDS
            for n in deployment.controller.program
        )
        encoding, why = deployment.cells.encoding.kind, "set by cells.encoding.kind"
        if explores and encoding != "periodic":
            encoding, why = "periodic", "all cells stream while the program explores"
    period_ns = deployment.cells.period_ns
    reading = PacketSource(transmission_ns(network, network.stream_bytes), 1, 1e9 / period_ns, periodic=True)
    n_cells = sum(patch.n_cells for patch in deployment.patches)
    if encoding == "periodic":
        return Traffic(encoding, why, period_ns, n_cells, 1.0, (reading,), ())
    event_ns = transmission_ns(network, network.event_bytes)
    touched: tuple[PacketSource, ...] = (
        PacketSource(event_ns, _BURST_EVENTS[encoding], plan.event_rate_hz, periodic=False),
    )
    if plan.stream_when_touched:
        touched += (reading,)
    idle = (PacketSource(event_ns, 1, plan.idle_event_rate_hz, periodic=False),)
    return Traffic(
        encoding,
        why,
        period_ns,
        math.ceil(plan.stimulated_fraction * n_cells),
        plan.stimulated_fraction,
        tuple(source for source in touched if source.packets_per_s),
        tuple(source for source in idle if source.packets_per_s),
    )
