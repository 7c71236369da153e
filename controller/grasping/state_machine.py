"""State machine of teaching and grasping, as one table: Fig. 7 of [M14] with teaching states added.

Events have three sources: completion of the low-level controllers, touch, and requests of users. An event
that a state's row does not list causes no transition: it is ignored or, if it is a request, refused.
"""

from enum import Enum

from skinnet.protocol.states import TeachAndGraspState as State

__all__ = [
    "CARRYING_STATES",
    "GRASPING_STATES",
    "RESTING_STATES",
    "SENSED_EVENTS",
    "TRANSITIONS",
    "Event",
    "State",
    "mermaid_diagram",
    "next_state",
]


class Event(Enum):
    """Events of the state machine, by source."""

    # completion events of the low-level controllers
    POSE_REACHED = "pose reached"
    EXPLORED = "pose explored"
    STALLED = "stalled"
    TIMED_OUT = "timed out"
    # tactile events
    PATTED = "patted"
    OBJECT_NEAR = "object near both arms"
    OBJECT_TOUCHED = "object touches both arms"
    OBJECT_LOADED = "both arms press"
    CHEST_TOUCHED = "object touches the chest"
    OBJECT_LOST = "an arm lost the object"
    PAIN = "pain"
    SKIN_LOST = "skin lost"
    # requests
    GUIDE_FORCE = "guide force"
    GUIDE_PROXIMITY = "guide proximity"
    GUIDE_OFF = "guide off"
    ATTEND = "attend"
    ATTEND_OFF = "attend off"
    REMEMBER = "remember"
    GO = "go"
    GRASP = "grasp"
    RELEASE = "release"
    CANCEL = "cancel"
    END = "end"


SENSED_EVENTS = (
    Event.SKIN_LOST,
    Event.PAIN,
    Event.OBJECT_LOST,
    Event.PATTED,
    Event.CHEST_TOUCHED,
    Event.OBJECT_LOADED,
    Event.OBJECT_TOUCHED,
    Event.OBJECT_NEAR,
    Event.POSE_REACHED,
    Event.EXPLORED,
    Event.STALLED,
    Event.TIMED_OUT,
)
"""Sensed events in order of priority within a tick; all others are requests."""

_AT_REST = {
    Event.GUIDE_FORCE: State.GUIDE_FORCE,
    Event.GUIDE_PROXIMITY: State.GUIDE_PROXIMITY,
    Event.ATTEND: State.ATTEND,
    Event.REMEMBER: State.REMEMBER,
    Event.GO: State.GO,
    Event.GRASP: State.OPEN,
    Event.PATTED: State.OPEN,
    Event.CANCEL: State.SAFE,
    Event.END: State.ENDED,
}
_GUIDED = {
    Event.GUIDE_FORCE: State.GUIDE_FORCE,
    Event.GUIDE_PROXIMITY: State.GUIDE_PROXIMITY,
    Event.GUIDE_OFF: State.IDLE,
    Event.CANCEL: State.SAFE,
}
_FAILURES = {
    Event.CANCEL: State.SAFE,
    Event.STALLED: State.SAFE,
    Event.TIMED_OUT: State.SAFE,
    Event.PAIN: State.SAFE,
    Event.SKIN_LOST: State.SAFE,
}
_CONTACT_FAILURES = {**_FAILURES, Event.POSE_REACHED: State.SAFE}
"""Failures of a state that expects contact: also the pose reached without it (no or unfit object)."""

TRANSITIONS: dict[State, dict[Event, State]] = {
    State.IDLE: _AT_REST,
    State.GUIDE_FORCE: _GUIDED,
    State.GUIDE_PROXIMITY: _GUIDED,
    State.ATTEND: {Event.ATTEND_OFF: State.IDLE, Event.CANCEL: State.SAFE},
    State.REMEMBER: {Event.EXPLORED: State.IDLE, Event.CANCEL: State.SAFE},
    State.GO: {
        Event.POSE_REACHED: State.IDLE,
        Event.STALLED: State.SAFE,
        Event.TIMED_OUT: State.SAFE,
        Event.PAIN: State.SAFE,
        Event.CANCEL: State.SAFE,
    },
    State.OPEN: {**_FAILURES, Event.POSE_REACHED: State.APPROACH},
    State.APPROACH: {**_CONTACT_FAILURES, Event.OBJECT_NEAR: State.CONTACT},
    State.CONTACT: {**_CONTACT_FAILURES, Event.OBJECT_TOUCHED: State.LOAD},
    State.LOAD: {**_CONTACT_FAILURES, Event.OBJECT_LOADED: State.PULL},
    State.PULL: {**_CONTACT_FAILURES, Event.OBJECT_LOST: State.SAFE, Event.CHEST_TOUCHED: State.HOLD},
    State.HOLD: {
        Event.RELEASE: State.RELEASE,
        Event.CANCEL: State.SET_DOWN,
        Event.OBJECT_LOST: State.SET_DOWN,
        Event.PAIN: State.SET_DOWN,
        Event.SKIN_LOST: State.SET_DOWN,
    },
    State.SET_DOWN: {Event.RELEASE: State.RELEASE, Event.CANCEL: State.SET_DOWN, Event.TIMED_OUT: State.SAFE},
    State.RELEASE: {
        Event.POSE_REACHED: State.IDLE,
        Event.STALLED: State.SAFE,
        Event.TIMED_OUT: State.SAFE,
        Event.CANCEL: State.SAFE,
    },
    State.SAFE: _AT_REST,
    State.ENDED: {},
}
"""Transition table: next state by state and event."""

GRASPING_STATES = (State.OPEN, State.APPROACH, State.CONTACT, State.LOAD, State.PULL, State.HOLD)
"""Superstate 'execute grasp' of [M14, Fig. 7]."""
CARRYING_STATES = (State.HOLD, State.SET_DOWN)
"""States that may carry the object: the arms open only after a delay for a person to take it."""
RESTING_STATES = (State.IDLE, State.SAFE)


def next_state(state: State, event: Event) -> State | None:
    """Return the next state after `event` in `state`; None without a transition."""
    return TRANSITIONS[state].get(event)


def mermaid_diagram() -> str:
    """Draw the table as a Mermaid state diagram; transitions between the same states share an arrow."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.IDLE.value}"]
    for state, row in TRANSITIONS.items():
        reasons: dict[State, list[str]] = {}
        for event, target in row.items():
            reasons.setdefault(target, []).append(event.value)
        for target, events in reasons.items():
            end = "[*]" if target is State.ENDED else target.value
            lines.append(f"    {state.value} --> {end}: {', '.join(events)}")
    return "\n".join(lines) + "\n"
