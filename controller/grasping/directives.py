"""What each state tells the low-level controllers: Table II of [M14], as settled in docs/grasping.md.

Table II is garbled by its scan; rows and cells that it does not have are assumptions, marked below.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from controller.grasping.state_machine import State
from skinnet.deployment.session import SessionSpec, StateSpec

__all__ = ["Area", "Directive", "Gains", "directives"]


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


@dataclass(frozen=True)
class Gains:
    """Thresholds and gains of the cells of an area; a gain of zero inhibits."""

    force_threshold: float = 0.0
    force_gain: float = 0.0
    proximity_threshold: float = 0.0
    proximity_gain: float = 0.0


@dataclass(frozen=True)
class Directive:
    """What is in force while a state lasts."""

    gains: Mapping[Area, Gains] = field(default_factory=dict)
    """By area; an area that is not there is inhibited."""
    pose: str | None = None
    """Name of the key pose that the robot goes to; None: it stays where it is pushed to."""
    speed_rad_s: float = 0.4
    accuracy_rad: float = 0.01
    patience_s: float | None = None
    """After so long the state times out; None: never."""


def _all(gains: Gains) -> dict[Area, Gains]:
    return dict.fromkeys(Area, gains)


def _toward_contact(other: Gains, contact: Gains) -> dict[Area, Gains]:
    """The chest is as little to evade as the contact area: both are where the object shall touch."""
    return {Area.OTHER: other, Area.PAT: other, Area.CONTACT: contact, Area.CHEST: Gains()}


_EVADE = Gains(proximity_threshold=0.01, proximity_gain=0.4)
_EVADE_SLOWLY = Gains(proximity_threshold=0.01, proximity_gain=0.2)
_EVADE_BARELY = Gains(proximity_threshold=0.01, proximity_gain=0.01)
_YIELD = Gains(force_threshold=0.10, force_gain=0.80)

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


def directives(spec: SessionSpec) -> dict[State, Directive]:
    """Directives of all states: Table II with what the deployment says instead."""
    table = {state: _TABLE_II.get(state, Directive()) for state in State}
    for name, own in spec.states.items():
        state = State(name)
        table[state] = _changed(table[state], own)
    table[State.SET_DOWN] = replace(table[State.SET_DOWN], patience_s=spec.set_down_s)
    return table if spec.pre_contact else _blind(table)


def _changed(directive: Directive, own: StateSpec) -> Directive:
    gains = dict(directive.gains)
    for name, area in own.areas.items():
        before = gains.get(Area(name), Gains())
        gains[Area(name)] = Gains(
            force_threshold=_given(area.force_threshold, before.force_threshold),
            force_gain=_given(area.force_gain, before.force_gain),
            proximity_threshold=_given(area.proximity_threshold, before.proximity_threshold),
            proximity_gain=_given(area.proximity_gain, before.proximity_gain),
        )
    return Directive(
        gains=gains,
        pose=directive.pose,
        speed_rad_s=_given(own.speed_rad_s, directive.speed_rad_s),
        accuracy_rad=_given(own.accuracy_rad, directive.accuracy_rad),
        patience_s=directive.patience_s if own.patience_s is None else own.patience_s,
    )


def _given(own: float | None, otherwise: float) -> float:
    return otherwise if own is None else own


def _blind(table: dict[State, Directive]) -> dict[State, Directive]:
    """Without proximity sensors."""
    return {
        state: replace(
            directive,
            gains={area: replace(gains, proximity_gain=0.0) for area, gains in directive.gains.items()},
        )
        for state, directive in table.items()
    }
