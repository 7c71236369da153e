"""State parameters of the low-level controllers: Table II of [M14], as settled in docs/grasping.md.

The scan of Table II is incomplete; rows and entries that it lacks are assumptions, marked below.
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
    """Touch areas of the skin [M14, IV.C]."""

    PAT = "pat"
    """Pat area (PA): a touch starts the grasp."""
    CONTACT = "contact"
    """Contact area (CA): the expected contact with the object."""
    CHEST = "chest"
    """Chest area (CHA): the third contact."""
    OTHER = "other"
    """Non-contact area (NCA): cells in no other area."""


class Gains(NamedTuple):
    """Reaction thresholds and gains [rad/s per reading] of an area's cells; a gain of zero inhibits."""

    force_threshold: float = 0.0
    force_gain: float = 0.0
    proximity_threshold: float = 0.0
    proximity_gain: float = 0.0


@dataclass(frozen=True)
class Directive:
    """Low-level control parameters of a state."""

    gains: Mapping[Area, Gains] = field(default_factory=dict)
    """Reaction parameters by area."""
    pose: str | None = None
    """Name of the target key pose; None: no posture control, the robot stays where it is pushed."""
    speed_rad_s: float = 0.4
    accuracy_rad: float = 0.01
    patience_s: float = math.inf
    """Time [s] after which the state times out."""


def _all(gains: Gains) -> dict[Area, Gains]:
    return dict.fromkeys(Area, gains)


def _toward_contact(other: Gains, contact: Gains) -> dict[Area, Gains]:
    """Return gains by area; contact area and chest do not evade, as the object shall touch both."""
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
"""State parameters of Table II [M14].

Timeouts are assumptions; so are the rows go (as open), set_down (as hold) and safe (as release), and the pose
and speed of release, which the scan cut off: open, at the speed of the contact.
"""


def directives(spec: SessionSpec, remembered: Mapping[str, float] | None = None) -> dict[State, Directive]:
    """Merge the parameters of all states: Table II, overridden by memory, overridden by the deployment.

    Args:
        spec: Parameters of the deployment.
        remembered: Stored numbers, named as in `parameters`; other names are ignored.
    """
    numbers = parameters(_TABLE_II)
    numbers |= {name: value for name, value in (remembered or {}).items() if name in numbers}
    numbers |= _said(spec)
    return {state: _made(state, numbers) for state in State}


def parameters(table: Mapping[State, Directive]) -> dict[str, float]:
    """Flatten state parameters to numbers by name: `load.speed_rad_s`, `load.contact.force_gain`."""
    numbers: dict[str, float] = {}
    for state, directive in table.items():
        numbers |= {f"{state.value}.{name}": getattr(directive, name) for name in _NUMBERS}
        for area in Area:
            gains = directive.gains.get(area, Gains())
            for name in Gains._fields:
                numbers[f"{state.value}.{area.value}.{name}"] = getattr(gains, name)
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


def _said(spec: SessionSpec) -> dict[str, float]:
    """Return the parameters that the deployment sets, by name."""
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
    """Return the state parameters with all proximity gains zero."""
    return {
        state: replace(
            directive,
            gains={area: gains._replace(proximity_gain=0.0) for area, gains in directive.gains.items()},
        )
        for state, directive in table.items()
    }
