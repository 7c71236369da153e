"""State machine of the nursing program: states, events and the transition table."""

from enum import Enum

__all__ = ["STOP_EVENTS", "TERMINAL_STATES", "TRANSITIONS", "Event", "State", "diagram", "next_state"]


class State(Enum):
    """States of the nursing program."""

    HOLD = "hold"
    """Joints at rest while the contacts with the object settle."""
    RECORD = "record"
    """Joints at rest while the initial contacts are averaged, equation (3) [R11]."""
    MOVE = "move"
    """Object motion along the desired trajectory."""
    SETTLE = "settle"
    """Object at its goal while feedback restores the initial contacts."""
    REPORT = "report"
    """Terminal: done, the object is held with feedback."""
    STOPPED = "stopped"
    """Terminal: stopped for a reason, the object is held with feedback on contacts with tactile input."""


class Event(Enum):
    """Events of the nursing program; all but the first four are stops."""

    HOLD_ELAPSED = "held long enough"
    RECORDED = "contacts recorded"
    ARRIVED = "object arrived"
    SETTLED = "settled"
    NO_CONTACT = "no contact at the start"
    UNKNOWN_LINK = "contact on a link that the controller does not know"
    INVALID_CONTACT = "a contact that cannot be recorded"
    SINGULAR_POSTURE = "singular posture"
    UNREACHABLE = "trajectory out of reach"
    CONTACT_LOST = "contact lost"
    PRESSURE_LIMIT = "pressure above the comfort limit"
    SKIN_SILENT = "skin silent"
    JOINTS_SILENT = "joint sensors silent"


STOP_EVENTS = tuple(
    event
    for event in Event
    if event not in (Event.HOLD_ELAPSED, Event.RECORDED, Event.ARRIVED, Event.SETTLED)
)
TERMINAL_STATES = (State.REPORT, State.STOPPED)
"""Terminal states, without further stops; both hold the object."""
_STOPS_ALWAYS = (Event.SKIN_SILENT, Event.JOINTS_SILENT, Event.PRESSURE_LIMIT)
_STOPS_AT_RECORD = (Event.NO_CONTACT, Event.UNKNOWN_LINK, Event.INVALID_CONTACT, Event.SINGULAR_POSTURE)
_STOPS_IN_MOTION = (Event.CONTACT_LOST, Event.SINGULAR_POSTURE, Event.UNREACHABLE)

TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.HOLD, Event.HOLD_ELAPSED): State.RECORD,
    (State.RECORD, Event.RECORDED): State.MOVE,
    (State.MOVE, Event.ARRIVED): State.SETTLE,
    (State.SETTLE, Event.SETTLED): State.REPORT,
} | {
    (state, event): State.STOPPED
    for state, reasons in (
        (State.HOLD, _STOPS_ALWAYS),
        (State.RECORD, _STOPS_ALWAYS + _STOPS_AT_RECORD),
        (State.MOVE, _STOPS_ALWAYS + _STOPS_IN_MOTION),
        (State.SETTLE, _STOPS_ALWAYS + _STOPS_IN_MOTION),
    )
    for event in reasons
}


def next_state(state: State, event: Event) -> State:
    """Return the next state after `event`.

    Raises:
        ValueError: `event` is not allowed in `state`, which is a bug of the caller.
    """
    if (state, event) not in TRANSITIONS:
        raise ValueError(f'"{event.value}" is not allowed in state {state.name}')
    return TRANSITIONS[state, event]


def diagram() -> str:
    """Return the transition table as a Mermaid state diagram; parallel transitions share an arrow."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), target in TRANSITIONS.items():
        arrows.setdefault((state, target), []).append(event.value)
    lines = ["stateDiagram-v2", f"    [*] --> {State.HOLD.value}"]
    lines += [f"    {a.value} --> {b.value}: {', '.join(words)}" for (a, b), words in arrows.items()]
    return "\n".join([*lines, *(f"    {state.value} --> [*]" for state in TERMINAL_STATES)])
