"""Claims of papers about metrics, expectations for a run, and verdicts.

An expectation is a rule with a verdict, written down before the run. A claim has none where the published
value depends on conditions that the paper does not give; then published and measured values stand side by
side. A claim about a setting of the deployment has no verdict either: no run can make it wrong.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from skinnet.analysis.report.units import Quantity, format_value, parse_quantity

__all__ = [
    "Between",
    "Claim",
    "ClaimComparison",
    "Equals",
    "Expectation",
    "LessThanMetrics",
    "RelativeTolerance",
    "Verdict",
    "evaluate_claim",
    "setting",
    "summarise_seeds",
]

Metrics = dict[str, Any]
_NO_BREAK = "\u00a0"
_SETTINGS = "size."
"""Prefix of metrics that are settings of the deployment (`deployment_metrics`), not results of the run."""


class Verdict(Enum):
    """Verdict on an expectation."""

    WITHIN = "within"
    OUTSIDE = "outside"
    NO_EXPECTATION = "no expectation"
    UNMEASURED = "not measured"
    SETTING = "setting"
    """Setting of the deployment, which the run did not measure."""


class Expectation(Protocol):
    """Expectation as a rule over metrics."""

    def holds(self, names: tuple[str, ...], metrics: Metrics) -> bool | None:
        """Test the metrics `names` against the rule; None if another metric that it needs is missing."""

    def text(self, unit: str, scale: float) -> str:
        """Rule in words, values in `unit` after multiplication by `scale`."""


@dataclass(frozen=True)
class Equals:
    """Equality: every metric has this value."""

    value: bool | int | str

    def holds(self, names: tuple[str, ...], metrics: Metrics) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        return all(metrics[name] == self.value for name in names)

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return _with_unit(format_value(self.value, scale), "" if isinstance(self.value, bool | str) else unit)


@dataclass(frozen=True)
class Between:
    """Closed interval that contains every metric; None leaves an end open."""

    low: float | None = None
    high: float | None = None

    def holds(self, names: tuple[str, ...], metrics: Metrics) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        values: list[float] = [metrics[name] for name in names]
        above = self.low is None or min(values) >= self.low
        return above and (self.high is None or max(values) <= self.high)

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        if self.low is None or self.high is None:
            word, end = ("at most", self.high) if self.low is None else ("at least", self.low)
            return f"{word} {_with_unit(format_value(end, scale), unit)}"
        return f"{format_value(self.low, scale)} to {_with_unit(format_value(self.high, scale), unit)}"


@dataclass(frozen=True)
class LessThanMetrics:
    """Order: every metric is less than each of `others`, named `reference_name` in the text."""

    others: tuple[str, ...]
    reference_name: str

    def holds(self, names: tuple[str, ...], metrics: Metrics) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        if any(name not in metrics for name in self.others):
            return None
        return bool(max(metrics[name] for name in names) < min(metrics[name] for name in self.others))

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return f"less than {self.reference_name}"


@dataclass(frozen=True)
class RelativeTolerance:
    """Relative tolerance: every metric is within `tolerance` of that in `others`, named `reference_name`."""

    others: tuple[str, ...]
    tolerance: float
    reference_name: str

    def holds(self, names: tuple[str, ...], metrics: Metrics) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        if any(name not in metrics for name in self.others):
            return None
        return all(
            abs(metrics[name] - metrics[other]) <= self.tolerance * abs(metrics[other])
            for name, other in zip(names, self.others, strict=True)
        )

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return f"within {100 * self.tolerance:g} % of {self.reference_name}"


@dataclass(frozen=True)
class Claim:
    """Claim of a source, and the metrics of a run to compare with it.

    Attributes:
        subject: Subject of the claim.
        published: Published value, in the source's words or numbers.
        source: Key of the source, as in `papers.SOURCES`.
        location: Section, table or figure of the source.
        metrics: Names of the metrics to compare.
        expected: Rule that the metrics must keep; None where nothing can be expected.
        note: Reason for the expectation, where needed.
        conditions: Settings of the deployment (dotted key, allowed values) to which the claim applies.
    """

    subject: str
    published: str
    source: str
    location: str
    metrics: tuple[str, ...]
    expected: Expectation | None = None
    note: str = ""
    conditions: tuple[tuple[str, tuple[Any, ...]], ...] = ()


@dataclass(frozen=True)
class ClaimComparison:
    """Claim compared with the metrics of a run."""

    claim: Claim
    values: tuple[Any, ...]
    expected: str
    verdict: Verdict

    @property
    def measured_text(self) -> str:
        """Measured values as text."""
        meant = _quantity_of(self.claim)
        if any(value is None for value in self.values):
            return "–"
        text = ", ".join(format_value(value, meant.scale) for value in self.values)
        return _with_unit(text, meant.unit if _are_numbers(self.values) else "")


def evaluate_claim(claim: Claim, metrics: Metrics, deployment: dict[str, Any]) -> ClaimComparison | None:
    """Compare `claim` with the metrics of a run of `deployment`; None if it does not apply to that."""
    if any(setting(deployment, key) not in allowed for key, allowed in claim.conditions):
        return None
    meant = _quantity_of(claim)
    expected = "–" if claim.expected is None else claim.expected.text(meant.unit, meant.scale)
    values = tuple(metrics.get(name) for name in claim.metrics)
    if any(value is None for value in values):
        return ClaimComparison(claim, values, expected, Verdict.UNMEASURED)
    if all(name.startswith(_SETTINGS) for name in claim.metrics):
        return ClaimComparison(claim, values, expected, Verdict.SETTING)
    if claim.expected is None:
        return ClaimComparison(claim, values, expected, Verdict.NO_EXPECTATION)
    try:
        holds = claim.expected.holds(claim.metrics, metrics)
    except TypeError:  # in the version that made this run, the metric was not a number
        holds = None
    verdict = Verdict.UNMEASURED if holds is None else Verdict.WITHIN if holds else Verdict.OUTSIDE
    return ClaimComparison(claim, values, expected, verdict)


def summarise_seeds(runs: Sequence[ClaimComparison]) -> str:
    """Metrics of several runs for one claim: range of numbers, or counts of other values."""
    meant = _quantity_of(runs[0].claim)
    values = [value for run in runs for value in run.values if value is not None]
    if _are_numbers(values):
        ends = dict.fromkeys((format_value(min(values), meant.scale), format_value(max(values), meant.scale)))
        return _with_unit(" to ".join(ends), meant.unit)
    counts = Counter(map(format_value, values)).most_common()
    return ", ".join(f"{value}: {count}" for value, count in counts) or "–"


def setting(deployment: dict[str, Any], key: str) -> Any:
    """Setting of a deployment by its dotted key; None if absent."""
    value: Any = deployment
    for step in key.split("."):
        value = value.get(step) if isinstance(value, dict) else None
    return value


def _quantity_of(claim: Claim) -> Quantity:
    return parse_quantity(claim.metrics[0].partition(".")[2])


def _are_numbers(values: Sequence[Any]) -> bool:
    return bool(values) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def _with_unit(text: str, unit: str) -> str:
    return f"{text}{'' if unit == '°' else _NO_BREAK}{unit}" if unit else text
