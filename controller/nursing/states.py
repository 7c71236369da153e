"""The states of the nursing program and what leads from one to the next: a table, and nothing else."""

from enum import Enum

__all__ = ["STOPS", "TABLE", "TERMINAL", "Event", "State", "after", "diagram"]


class State(Enum):
    """What the program is doing."""

    HOLD = "hold"
    """Joints rest; the hold of the object comes to rest."""
    RECORD = "record"
    """Joints rest; forces and centres of pressure are averaged: the initial contacts, equation (3) [R11]."""
    MOVE = "move"
    """The object follows its trajectory."""
    SETTLE = "settle"
    """The object has arrived; feedback brings the contacts back to how they were."""
    REPORT = "report"
    """Done: the object is held with feedback."""
    STOPPED = "stopped"
    """The object is held where it is, with feedback on every contact that is felt; there is a reason."""


class Event(Enum):
    """What happens; all but the first four are reasons to stop."""

    HELD = "held long enough"
    RECORDED = "contacts recorded"
    ARRIVED = "object arrived"
    SETTLED = "settled"
    NO_CONTACT = "no contact at the start"
    UNKNOWN_LINK = "contact on a link that the controller does not know"
    UNUSABLE_CONTACT = "a contact that cannot be recorded"
    SINGULAR_POSTURE = "singular posture"
    UNREACHABLE = "trajectory out of reach"
    CONTACT_LOST = "contact lost"
    PRESSURE_LIMIT = "pressure above the comfort limit"
    SKIN_SILENT = "skin silent"


STOPS = tuple(
    event for event in Event if event not in (Event.HELD, Event.RECORDED, Event.ARRIVED, Event.SETTLED)
)
TERMINAL = (State.REPORT, State.STOPPED)
"""Both hold the object already, so that nothing more can lead to a stop."""
_ALWAYS = (Event.SKIN_SILENT, Event.PRESSURE_LIMIT)
_AT_THE_START = (Event.NO_CONTACT, Event.UNKNOWN_LINK, Event.UNUSABLE_CONTACT, Event.SINGULAR_POSTURE)
_UNDERWAY = (Event.CONTACT_LOST, Event.SINGULAR_POSTURE, Event.UNREACHABLE)

TABLE: dict[tuple[State, Event], State] = {
    (State.HOLD, Event.HELD): State.RECORD,
    (State.RECORD, Event.RECORDED): State.MOVE,
    (State.MOVE, Event.ARRIVED): State.SETTLE,
    (State.SETTLE, Event.SETTLED): State.REPORT,
} | {
    (state, event): State.STOPPED
    for state, reasons in (
        (State.HOLD, _ALWAYS),
        (State.RECORD, _ALWAYS + _AT_THE_START),
        (State.MOVE, _ALWAYS + _UNDERWAY),
        (State.SETTLE, _ALWAYS + _UNDERWAY),
    )
    for event in reasons
}


def after(state: State, event: Event) -> State:
    """The state that `event` leads to.

    Raises:
        ValueError: `event` cannot happen in `state`; that is a bug of whoever sent it.
    """
    if (state, event) not in TABLE:
        raise ValueError(f'"{event.value}" cannot happen in {state.name}')
    return TABLE[state, event]


def diagram() -> str:
    """The table as a Mermaid state diagram; reasons that lead to the same state share an arrow."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), target in TABLE.items():
        arrows.setdefault((state, target), []).append(event.value)
    lines = ["stateDiagram-v2", f"    [*] --> {State.HOLD.value}"]
    lines += [f"    {a.value} --> {b.value}: {', '.join(words)}" for (a, b), words in arrows.items()]
    return "\n".join([*lines, *(f"    {state.value} --> [*]" for state in TERMINAL)])
