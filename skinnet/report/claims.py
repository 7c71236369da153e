"""What a paper says of a figure, what is expected here, and whether a run keeps it.

An expectation is a small rule with a verdict. It is written down before the run, and where nothing can be
expected (the paper's number hangs on what the paper does not give) there is none, and the figures stand
side by side.
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
    """What became of an expectation."""

    WITHIN = "within"
    OUTSIDE = "outside"
    BESIDE = "no expectation"
    UNMEASURED = "not measured"


class Expectation(Protocol):
    """A rule over figures."""

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """Whether the figures `names` keep it; None if another figure that it needs is not there."""

    def text(self, unit: str, scale: float) -> str:
        """The rule in words."""


@dataclass(frozen=True)
class Equals:
    """Every figure is just this."""

    value: bool | int | str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """See `Expectation`."""
        return all(figures[name] == self.value for name in names)

    def text(self, unit: str, scale: float) -> str:
        """See `Expectation`."""
        return _with(shown(self.value, scale), "" if isinstance(self.value, bool | str) else unit)


@dataclass(frozen=True)
class Between:
    """Every figure lies within these, ends included; None is open."""

    low: float | None = None
    high: float | None = None

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """See `Expectation`."""
        values: list[float] = [figures[name] for name in names]
        above = self.low is None or min(values) >= self.low
        return above and (self.high is None or max(values) <= self.high)

    def text(self, unit: str, scale: float) -> str:
        """See `Expectation`."""
        if self.low is None or self.high is None:
            word, end = ("at most", self.high) if self.low is None else ("at least", self.low)
            return f"{word} {_with(shown(end, scale), unit)}"
        return f"{shown(self.low, scale)} to {_with(shown(self.high, scale), unit)}"


@dataclass(frozen=True)
class Below:
    """Every figure is less than each of `others`, which are `called` so."""

    others: tuple[str, ...]
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """See `Expectation`."""
        if any(name not in figures for name in self.others):
            return None
        return bool(max(figures[name] for name in names) < min(figures[name] for name in self.others))

    def text(self, unit: str, scale: float) -> str:
        """See `Expectation`."""
        return f"less than {self.called}"


@dataclass(frozen=True)
class Against:
    """Every figure is more, or less, than the value of its place, which are `called` so."""

    values: tuple[float, ...]
    more: bool
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """See `Expectation`."""
        pairs = zip((figures[name] for name in names), self.values, strict=True)
        return all((here > value) if self.more else (here < value) for here, value in pairs)

    def text(self, unit: str, scale: float) -> str:
        """See `Expectation`."""
        values = ", ".join(shown(value, scale) for value in self.values)
        return f"{'more' if self.more else 'less'} than {self.called}: {_with(values, unit)}"


@dataclass(frozen=True)
class Near:
    """Every figure is within `share` of the one of its place in `others`, which are `called` so."""

    others: tuple[str, ...]
    share: float
    called: str

    def holds(self, names: tuple[str, ...], figures: Figures) -> bool | None:
        """See `Expectation`."""
        if any(name not in figures for name in self.others):
            return None
        return all(
            abs(figures[name] - figures[other]) <= self.share * abs(figures[other])
            for name, other in zip(names, self.others, strict=True)
        )

    def text(self, unit: str, scale: float) -> str:
        """See `Expectation`."""
        return f"within {100 * self.share:g} % of {self.called}"


@dataclass(frozen=True)
class Claim:
    """What a source says, and which figures of a run stand beside it.

    Attributes:
        what: What it is about.
        says: What the source says of it, in its words or numbers.
        source: Key of the source, as in `paper.SOURCES`.
        place: Where in the source.
        figures: Names of the figures beside it.
        expected: What they must keep; None where nothing can be expected.
        note: Why the expectation is what it is, if it needs saying.
        when: Settings of the deployment (dotted key, allowed values) without which it says nothing.
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
    """A claim beside a run."""

    claim: Claim
    values: tuple[Any, ...]
    expected: str
    verdict: Verdict

    @property
    def here(self) -> str:
        """The run's figures as text."""
        meant = _meant(self.claim)
        if any(value is None for value in self.values):
            return "–"
        text = ", ".join(shown(value, meant.scale) for value in self.values)
        return _with(text, meant.unit if _are_numbers(self.values) else "")


def judge(claim: Claim, figures: Figures, deployment: dict[str, Any]) -> Compared | None:
    """Holds `claim` against the figures of a run of `deployment`; None if it says nothing of such a run."""
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
    except TypeError:  # another version of the program, in which the figure was not a number
        holds = None
    verdict = Verdict.UNMEASURED if holds is None else Verdict.WITHIN if holds else Verdict.OUTSIDE
    return Compared(claim, values, expected, verdict)


def together(runs: Sequence[Compared]) -> str:
    """The figures of several runs beside one claim: from the least to the greatest, or how often each."""
    meant = _meant(runs[0].claim)
    values = [value for run in runs for value in run.values if value is not None]
    if _are_numbers(values):
        ends = dict.fromkeys((shown(min(values), meant.scale), shown(max(values), meant.scale)))
        return _with(" to ".join(ends), meant.unit)
    counts = Counter(map(shown, values)).most_common()
    return ", ".join(f"{value}: {count}" for value, count in counts) or "–"


def setting(deployment: dict[str, Any], key: str) -> Any:
    """The setting of a dotted key; None where there is none."""
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
