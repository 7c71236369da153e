"""What each state tells the low-level controllers: Table II of [M14], as settled in docs/grasping.md.

Table II is garbled by its scan; rows and cells that it does not have are assumptions, marked below.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

from controller.grasping.state_machine import State
from skinnet.deployment.session import SessionSpec

__all__ = ["Area", "Directive", "Gains", "directives", "parameters", "without_pre_contact"]


class Area(Enum):
    """Touch areas of [M14, IV.C]: what a cell is for."""

    PAT = "pat"
    """PA: a touch starts the grasp."""
    CONTACT = "contact"
    """CA: where the object is expected."""
    CHEST = "chest"
    """CHA: the third contact."""
    OTHER = "other"
    """NCA: all that is in no other area."""


class Gains(NamedTuple):
    """Thresholds and gains of the cells of an area; a gain of zero inhibits."""

    force_threshold: float = 0.0
    force_gain: float = 0.0
    proximity_threshold: float = 0.0
    proximity_gain: float = 0.0


@dataclass(frozen=True)
class Directive:
    """What is in force while a state lasts."""

    gains: Mapping[Area, Gains] = field(default_factory=dict)
    """By area."""
    pose: str | None = None
    """Name of the key pose that the robot goes to; None: it stays where it is pushed to."""
    speed_rad_s: float = 0.4
    accuracy_rad: float = 0.01
    patience_s: float = math.inf
    """After so long the state times out."""


def _all(gains: Gains) -> dict[Area, Gains]:
    return dict.fromkeys(Area, gains)


def _toward_contact(other: Gains, contact: Gains) -> dict[Area, Gains]:
    """The chest is as little to evade as the contact area: both are where the object shall touch."""
    return {Area.OTHER: other, Area.PAT: other, Area.CONTACT: contact, Area.CHEST: Gains()}


_EVADE = Gains(proximity_threshold=0.01, proximity_gain=0.4)
_EVADE_SLOWLY = Gains(proximity_threshold=0.01, proximity_gain=0.2)
_EVADE_BARELY = Gains(proximity_threshold=0.01, proximity_gain=0.01)
_YIELD = Gains(force_threshold=0.10, force_gain=0.80)

_NUMBERS = ("speed_rad_s", "accuracy_rad", "patience_s")
_TABLE_II = {
    State.GUIDE_FORCE: Directive(_all(Gains(force_threshold=0.05, force_gain=1.0))),
    State.GUIDE_PROXIMITY: Directive(_all(_EVADE)),
    State.GO: Directive(_all(_EVADE), speed_rad_s=0.4, patience_s=30.0),
    State.OPEN: Directive(_all(_EVADE), "open", 0.4, patience_s=30.0),
    State.APPROACH: Directive(_all(_EVADE), "closed", 0.4, patience_s=20.0),
    State.CONTACT: Directive(_toward_contact(_EVADE, Gains()), "closed", 0.1, patience_s=20.0),
    State.LOAD: Directive(_toward_contact(_EVADE_BARELY, Gains()), "closed", 0.05, patience_s=20.0),
    State.PULL: Directive(_toward_contact(_EVADE_BARELY, _YIELD), "pulled", 0.05, patience_s=30.0),
    State.HOLD: Directive(_toward_contact(_EVADE_BARELY, _YIELD)),
    State.SET_DOWN: Directive(_toward_contact(_EVADE_BARELY, _YIELD)),
    State.RELEASE: Directive(_all(_EVADE_SLOWLY), "open", 0.1, patience_s=60.0),
    State.SAFE: Directive(_all(_EVADE_SLOWLY), "open", 0.1),
}
"""Times to wait are assumptions; so are the rows go (as open), set_down (as hold) and safe (as release), and
the pose and speed of release, which the scan cut off: open, as slowly as the contact was made."""


def directives(spec: SessionSpec, remembered: Mapping[str, float] | None = None) -> dict[State, Directive]:
    """Directives of all states: Table II, over it what is remembered, over that what the deployment says.

    Args:
        spec: What the deployment says.
        remembered: Numbers by name as `parameters` gives them; others are not of a directive.
    """
    numbers = parameters(_TABLE_II)
    numbers |= {name: value for name, value in (remembered or {}).items() if name in numbers}
    numbers |= _said(spec)
    return {state: _made(state, numbers) for state in State}


def parameters(table: Mapping[State, Directive]) -> dict[str, float]:
    """All numbers of directives by name: `load.speed_rad_s`, `load.contact.force_gain`."""
    numbers: dict[str, float] = {}
    for state, directive in table.items():
        numbers |= {f"{state.value}.{name}": getattr(directive, name) for name in _NUMBERS}
        for area in Area:
            gains = directive.gains.get(area, Gains())
            for name in Gains._fields:
                numbers[f"{state.value}.{area.value}.{name}"] = getattr(gains, name)
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


def _said(spec: SessionSpec) -> dict[str, float]:
    """The numbers that a deployment gives."""
    said = {f"{State.SET_DOWN.value}.patience_s": spec.set_down_s}
    for state, own in spec.states.items():
        given = {name: getattr(own, name) for name in _NUMBERS}
        for area, gains in own.areas.items():
            given |= {f"{area}.{name}": getattr(gains, name) for name in Gains._fields}
        said |= {f"{state}.{name}": value for name, value in given.items() if value is not None}
    return said


def _made(state: State, numbers: Mapping[str, float]) -> Directive:
    default = _TABLE_II.get(state, Directive())

    def number(name: str, otherwise: float) -> float:
        return numbers.get(f"{state.value}.{name}", otherwise)

    gains = {area: Gains(*(number(f"{area.value}.{name}", 0.0) for name in Gains._fields)) for area in Area}
    return Directive(gains, default.pose, *(number(name, getattr(default, name)) for name in _NUMBERS))


def without_pre_contact(table: Mapping[State, Directive]) -> dict[State, Directive]:
    """The same without proximity sensors."""
    return {
        state: replace(
            directive,
            gains={area: gains._replace(proximity_gain=0.0) for area, gains in directive.gains.items()},
        )
        for state, directive in table.items()
    }
