"""Claims of papers about metrics, expectations for a run, and verdicts.

An expectation is a rule with a verdict, written down before the run. A claim has none where the published
value depends on conditions that the paper does not give; then published and measured values stand side by
side.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from skinnet.report.units import Quantity, quantity, shown

__all__ = [
    "Against",
    "Below",
    "Between",
    "Claim",
    "Compared",
    "Equals",
    "Expectation",
    "Near",
    "Verdict",
    "judge",
    "setting",
    "together",
]

Figures = dict[str, Any]
_NO_BREAK = "\u00a0"


class Verdict(Enum):
    """Verdict on an expectation."""

    WITHIN = "within"
    OUTSIDE = "outside"
    BESIDE = "no expectation"
    UNMEASURED = "not measured"


class Expectation(Protocol):
    """Expectation as a rule over metrics."""

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the metrics `names` against the rule; None if another metric that it needs is missing."""

    def text(self, unit: str, scale: float) -> str:
        """Rule in words, values in `unit` after multiplication by `scale`."""


@dataclass(frozen=True)
class Equals:
    """Equality: every metric has this value."""

    value: bool | int | str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        return all(figures[name] == self.value for name in names)

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return _with(shown(self.value, scale), "" if isinstance(self.value, bool | str) else unit)


@dataclass(frozen=True)
class Between:
    """Closed interval that contains every metric; None leaves an end open."""

    low: float | None = None
    high: float | None = None

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        values: list[float] = [figures[name] for name in names]
        above = self.low is None or min(values) >= self.low
        return above and (self.high is None or max(values) <= self.high)

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        if self.low is None or self.high is None:
            word, end = ("at most", self.high) if self.low is None else ("at least", self.low)
            return f"{word} {_with(shown(end, scale), unit)}"
        return f"{shown(self.low, scale)} to {_with(shown(self.high, scale), unit)}"


@dataclass(frozen=True)
class Below:
    """Order: every metric is less than each of `others`, named `called` in the text."""

    others: tuple[str, ...]
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        if any(name not in figures for name in self.others):
            return None
        return bool(max(figures[name] for name in names) < min(figures[name] for name in self.others))

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return f"less than {self.called}"


@dataclass(frozen=True)
class Against:
    """Order against values: every metric is more (or less) than its entry of `values`, named `called`."""

    values: tuple[float, ...]
    more: bool
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        pairs = zip((figures[name] for name in names), self.values, strict=True)
        return all((here > value) if self.more else (here < value) for here, value in pairs)

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        values = ", ".join(shown(value, scale) for value in self.values)
        return f"{'more' if self.more else 'less'} than {self.called}: {_with(values, unit)}"


@dataclass(frozen=True)
class Near:
    """Relative tolerance: every metric is within `share` of its counterpart in `others`, named `called`."""

    others: tuple[str, ...]
    share: float
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Test the rule; see `Expectation.holds`."""
        if any(name not in figures for name in self.others):
            return None
        return all(
            abs(figures[name] - figures[other]) <= self.share * abs(figures[other])
            for name, other in zip(names, self.others, strict=True)
        )

    def text(self, unit: str, scale: float) -> str:
        """Rule in words; see `Expectation.text`."""
        return f"within {100 * self.share:g} % of {self.called}"


@dataclass(frozen=True)
class Claim:
    """Claim of a source, and the metrics of a run to compare with it.

    Attributes:
        what: Subject of the claim.
        says: Published value, in the source's words or numbers.
        source: Key of the source, as in `papers.SOURCES`.
        place: Section, table or figure of the source.
        figures: Names of the metrics to compare.
        expected: Rule that the metrics must keep; None where nothing can be expected.
        note: Reason for the expectation, where needed.
        when: Settings of the deployment (dotted key, allowed values) to which the claim applies.
    """

    what: str
    says: str
    source: str
    place: str
    figures: tuple[str, ...]
    expected: Expectation | None = None
    note: str = ""
    when: tuple[tuple[str, tuple[Any, ...]], ...] = ()


@dataclass(frozen=True)
class Compared:
    """Claim compared with the metrics of a run."""

    claim: Claim
    values: tuple[Any, ...]
    expected: str
    verdict: Verdict

    @property
    def here(self) -> str:
        """Measured values as text."""
        meant = _meant(self.claim)
        if any(value is None for value in self.values):
            return "–"
        text = ", ".join(shown(value, meant.scale) for value in self.values)
        return _with(text, meant.unit if _are_numbers(self.values) else "")


def judge(claim: Claim, figures: Figures, deployment: dict[str, Any]) -> Compared | None:
    """Compare `claim` with the metrics of a run of `deployment`; None if it does not apply to that."""
    if any(setting(deployment, key) not in allowed for key, allowed in claim.when):
        return None
    meant = _meant(claim)
    expected = "–" if claim.expected is None else claim.expected.text(meant.unit, meant.scale)
    values = tuple(figures.get(name) for name in claim.figures)
    if any(value is None for value in values):
        return Compared(claim, values, expected, Verdict.UNMEASURED)
    if claim.expected is None:
        return Compared(claim, values, expected, Verdict.BESIDE)
    try:
        holds = claim.expected.holds(claim.figures, figures)
    except TypeError:  # in the version that made this run, the metric was not a number
        holds = None
    verdict = Verdict.UNMEASURED if holds is None else Verdict.WITHIN if holds else Verdict.OUTSIDE
    return Compared(claim, values, expected, verdict)


def together(runs: Sequence[Compared]) -> str:
    """Metrics of several runs for one claim: range of numbers, or counts of other values."""
    meant = _meant(runs[0].claim)
    values = [value for run in runs for value in run.values if value is not None]
    if _are_numbers(values):
        ends = dict.fromkeys((shown(min(values), meant.scale), shown(max(values), meant.scale)))
        return _with(" to ".join(ends), meant.unit)
    counts = Counter(map(shown, values)).most_common()
    return ", ".join(f"{value}: {count}" for value, count in counts) or "–"


def setting(deployment: dict[str, Any], key: str) -> Any:
    """Setting of a deployment by its dotted key; None if absent."""
    value: Any = deployment
    for step in key.split("."):
        value = value.get(step) if isinstance(value, dict) else None
    return value


def _meant(claim: Claim) -> Quantity:
    return quantity(claim.figures[0].partition(".")[2])


def _are_numbers(values: Sequence[Any]) -> bool:
    return bool(values) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)


def _with(text: str, unit: str) -> str:
    return f"{text}{'' if unit == '°' else _NO_BREAK}{unit}" if unit else text
