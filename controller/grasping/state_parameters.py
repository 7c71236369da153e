"""State parameters of the low-level controllers: Table II of [M14], as settled in docs/grasping.md.

The scan of Table II is incomplete; rows and entries that it lacks are assumptions, marked below.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

from controller.grasping.state_machine import State
from skinnet.deployment.controller.teach_and_grasp import TeachAndGraspSpec

__all__ = [
    "Area",
    "ReactionParameters",
    "StateParameters",
    "flatten_state_parameters",
    "merge_state_parameters",
    "without_pre_contact",
]


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


class ReactionParameters(NamedTuple):
    """Reaction thresholds and gains [rad/s per reading] of an area's cells; a gain of zero inhibits."""

    force_threshold: float = 0.0
    force_gain: float = 0.0
    proximity_threshold: float = 0.0
    proximity_gain: float = 0.0


@dataclass(frozen=True)
class StateParameters:
    """Low-level control parameters of a state."""

    reactions: Mapping[Area, ReactionParameters] = field(default_factory=dict)
    """Reaction parameters by area."""
    pose: str | None = None
    """Name of the target key pose; None: no posture control, the robot stays where it is pushed."""
    speed_rad_s: float = 0.4
    tolerance_rad: float = 0.01
    timeout_s: float = math.inf
    """Time [s] after which the state times out."""


def _for_all_areas(gains: ReactionParameters) -> dict[Area, ReactionParameters]:
    return dict.fromkeys(Area, gains)


def _toward_contact(other: ReactionParameters, contact: ReactionParameters) -> dict[Area, ReactionParameters]:
    """Return gains by area; contact area and chest do not evade, as the object shall touch both."""
    return {Area.OTHER: other, Area.PAT: other, Area.CONTACT: contact, Area.CHEST: ReactionParameters()}


_EVADE = ReactionParameters(proximity_threshold=0.01, proximity_gain=0.4)
_EVADE_SLOWLY = ReactionParameters(proximity_threshold=0.01, proximity_gain=0.2)
_EVADE_WEAKLY = ReactionParameters(proximity_threshold=0.01, proximity_gain=0.01)
_YIELD = ReactionParameters(force_threshold=0.10, force_gain=0.80)

_SCALAR_FIELDS = ("speed_rad_s", "tolerance_rad", "timeout_s")
_TABLE_II = {
    State.GUIDE_FORCE: StateParameters(
        _for_all_areas(ReactionParameters(force_threshold=0.05, force_gain=1.0))
    ),
    State.GUIDE_PROXIMITY: StateParameters(_for_all_areas(_EVADE)),
    State.GO: StateParameters(_for_all_areas(_EVADE), speed_rad_s=0.4, timeout_s=30.0),
    State.OPEN: StateParameters(_for_all_areas(_EVADE), "open", 0.4, timeout_s=30.0),
    State.APPROACH: StateParameters(_for_all_areas(_EVADE), "closed", 0.4, timeout_s=20.0),
    State.CONTACT: StateParameters(
        _toward_contact(_EVADE, ReactionParameters()), "closed", 0.1, timeout_s=20.0
    ),
    State.LOAD: StateParameters(
        _toward_contact(_EVADE_WEAKLY, ReactionParameters()), "closed", 0.05, timeout_s=20.0
    ),
    State.PULL: StateParameters(_toward_contact(_EVADE_WEAKLY, _YIELD), "pulled", 0.05, timeout_s=30.0),
    State.HOLD: StateParameters(_toward_contact(_EVADE_WEAKLY, _YIELD)),
    State.SET_DOWN: StateParameters(_toward_contact(_EVADE_WEAKLY, _YIELD)),
    State.RELEASE: StateParameters(_for_all_areas(_EVADE_SLOWLY), "open", 0.1, timeout_s=60.0),
    State.SAFE: StateParameters(_for_all_areas(_EVADE_SLOWLY), "open", 0.1),
}
"""State parameters of Table II [M14].

Timeouts are assumptions; so are the rows go (as open), set_down (as hold) and safe (as release), and the pose
and speed of release, which the scan cut off: open, at the speed of the contact.
"""


def merge_state_parameters(
    spec: TeachAndGraspSpec, stored: Mapping[str, float] | None = None
) -> dict[State, StateParameters]:
    """Merge the parameters of all states: Table II, overridden by memory, overridden by the deployment.

    Args:
        spec: Parameters of the deployment.
        stored: Stored numbers, named as in `flatten_state_parameters`; other names are ignored.
    """
    numbers = flatten_state_parameters(_TABLE_II)
    numbers |= {name: value for name, value in (stored or {}).items() if name in numbers}
    numbers |= _deployment_parameters(spec)
    return {state: _build(state, numbers) for state in State}


def flatten_state_parameters(states: Mapping[State, StateParameters]) -> dict[str, float]:
    """Flatten state parameters to numbers by name: `load.speed_rad_s`, `load.contact.force_gain`."""
    numbers: dict[str, float] = {}
    for state, directive in states.items():
        numbers |= {f"{state.value}.{name}": getattr(directive, name) for name in _SCALAR_FIELDS}
        for area in Area:
            gains = directive.reactions.get(area, ReactionParameters())
            for name in ReactionParameters._fields:
                numbers[f"{state.value}.{area.value}.{name}"] = getattr(gains, name)
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


def _deployment_parameters(spec: TeachAndGraspSpec) -> dict[str, float]:
    """Return the parameters that the deployment sets, by name."""
    said = {f"{State.SET_DOWN.value}.timeout_s": spec.set_down_delay_s}
    for state, own in spec.states.items():
        given = {name: getattr(own, name) for name in _SCALAR_FIELDS}
        for area, gains in own.areas.items():
            given |= {f"{area}.{name}": getattr(gains, name) for name in ReactionParameters._fields}
        said |= {f"{state}.{name}": value for name, value in given.items() if value is not None}
    return said


def _build(state: State, values: Mapping[str, float]) -> StateParameters:
    default = _TABLE_II.get(state, StateParameters())

    def number(name: str, otherwise: float) -> float:
        return values.get(f"{state.value}.{name}", otherwise)

    gains = {
        area: ReactionParameters(
            *(number(f"{area.value}.{name}", 0.0) for name in ReactionParameters._fields)
        )
        for area in Area
    }
    return StateParameters(
        gains, default.pose, *(number(name, getattr(default, name)) for name in _SCALAR_FIELDS)
    )


def without_pre_contact(states: Mapping[State, StateParameters]) -> dict[State, StateParameters]:
    """Return the state parameters with all proximity gains zero."""
    return {
        state: replace(
            directive,
            reactions={
                area: gains._replace(proximity_gain=0.0) for area, gains in directive.reactions.items()
            },
        )
        for state, directive in states.items()
    }
