"""Rules of faults, as a deployment states them: what breaks, where, and when."""

from skinnet.deployment.table import NonNegative, PortName, Positive, Table

__all__ = ["FaultRule", "LinkCut"]


class _Rule(Table, frozen=True, kw_only=True, tag_field="kind"):
    """When a fault is there: from `at_s`, for good or for `duration_s`."""

    at_s: NonNegative = 0.0
    duration_s: Positive | None = None


class LinkCut(_Rule, frozen=True, kw_only=True, tag="link_cut"):
    """A link is cut in both directions."""

    target: PortName


FaultRule = LinkCut
