"""Fault schedule: the fault rules of a deployment expanded into time spans at fault locations.

The schedule depends only on the deployment and its seed. Every draw belongs to a rule and a target name, so
that neither the distribution over cell processes nor other rules shift it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from skinnet import pinned_math
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.experiment.faults import BurstLoss, FaultRule
from skinnet.deployment.types import ns_of_s
from skinnet.network.faults.fault_targets import FaultInventory, FaultLocation, PatchLayout, select_targets
from skinnet.protocol.messages import FOREVER_NS
from skinnet.random_streams import StreamName, stream_key, uniform

__all__ = ["FaultLocation", "FaultSpan", "check_targets", "fault_schedule", "gilbert_elliott_phases"]


@dataclass(frozen=True)
class FaultSpan:
    """Fault span: one fault at one location, from `t_ns` until `until_ns`.

    Attributes:
        index: Index of its rule.
        rule: Fault rule.
        t_ns: First instant of the fault [ns].
        until_ns: First instant after it [ns]; `FOREVER_NS` if it is permanent.
        location: Cell, gateway or cell process; for link rules the directed link that leaves by a port, so
            that a cut in both directions is two spans of the same time.
    """

    index: int
    rule: FaultRule
    t_ns: int
    until_ns: int
    location: FaultLocation

    @property
    def kind(self) -> str:
        """Kind of the rule."""
        return self.rule.kind

    @property
    def target(self) -> str:
        """Name of the fault location."""
        return self.location.target_names[-1]

    def stream_key(self, seed: int, *names: str | int) -> np.uint64:
        """Return the key of a random stream of this fault alone."""
        return stream_key(seed, StreamName.FAULT, self.index, self.target, self.t_ns, *names)


def check_targets(deployment: Deployment, placed: Sequence[PatchLayout]) -> None:
    """Refuse fault rules whose targets the placed patches do not have.

    Raises:
        DeploymentError: an unknown patch, cell, port, gateway or cell process, a pattern without matches, or
            fewer matches than `pick`.
    """
    inventory = FaultInventory(deployment, placed)
    for index, rule in enumerate(deployment.faults):
        select_targets(inventory, rule, index, deployment.seed)


def fault_schedule(deployment: Deployment, placed: Sequence[PatchLayout]) -> tuple[FaultSpan, ...]:
    """Return all fault spans of a run in the order of time, then rule, then deployment.

    Faults of one rule at one location do not overlap: the next failure is drawn after the repair.

    Raises:
        DeploymentError: as `check_targets`.
    """
    if not deployment.faults:
        return ()
    inventory = FaultInventory(deployment, placed)
    spans = [
        FaultSpan(index, rule, t_ns, until_ns, place)
        for index, rule in enumerate(deployment.faults)
        for one in select_targets(inventory, rule, index, deployment.seed)
        for t_ns, until_ns in _failure_times_ns(
            rule, stream_key(deployment.seed, StreamName.FAULT, index, one.name), deployment.max_duration_ns
        )
        for place in one.locations
    ]
    return tuple(sorted(spans, key=lambda span: span.t_ns))  # sorting keeps the order of rules and places


def gilbert_elliott_phases(span: FaultSpan, seed: int) -> Iterator[tuple[int, float]]:
    """Yield the phases of Gilbert-Elliott burst loss: start time [ns] and loss probability.

    The first phase begins with the span, and its state is drawn from the stationary distribution; every
    directed link has its own sequence. The phases of a permanent span are endless.
    """
    rule = span.rule
    assert isinstance(rule, BurstLoss)
    key = span.stream_key(seed, StreamName.FAULT_BURST)
    bad = _draw(key, 0) < rule.mean_bad_s / (rule.mean_good_s + rule.mean_bad_s)
    t_ns, number = span.t_ns, 1
    while t_ns < span.until_ns:
        yield t_ns, rule.loss_bad if bad else rule.loss_good
        t_ns += _exponential_ns(rule.mean_bad_s if bad else rule.mean_good_s, _draw(key, number))
        bad, number = not bad, number + 1


def _failure_times_ns(rule: FaultRule, key: np.uint64, end_ns: int) -> Iterator[tuple[int, int]]:
    """Yield failure and repair times [ns] of one target before the run ends."""
    duration_ns = None if rule.duration_s is None else max(ns_of_s(rule.duration_s), 1)
    if rule.mean_interval_s is None:
        t_ns = ns_of_s(rule.at_s or 0.0)
        if rule.between_s is not None:
            first_s, last_s = rule.between_s
            t_ns = ns_of_s(first_s + _draw(key, 0) * (last_s - first_s))
        yield t_ns, FOREVER_NS if duration_ns is None else t_ns + duration_ns
        return
    t_ns, number = _exponential_ns(rule.mean_interval_s, _draw(key, 0)), 1
    while t_ns < end_ns:
        until_ns = FOREVER_NS if duration_ns is None else t_ns + duration_ns
        yield t_ns, until_ns
        t_ns, number = until_ns + _exponential_ns(rule.mean_interval_s, _draw(key, number)), number + 1


def _draw(key: np.uint64, number: int) -> float:
    return uniform(key, np.uint64(number))


def _exponential_ns(mean_s: float, draw: float) -> int:
    """Return an exponentially distributed time [ns], at least 1, from a uniform draw."""
    return max(round(-pinned_math.log(draw) * mean_s * 1e9), 1)
