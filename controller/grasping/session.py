"""Teach-and-grasp stage: a state machine driven by requests and tactile events, without I/O."""

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.grasping.directives import Area, directives, parameters, without_pre_contact
from controller.grasping.execution import Execution
from controller.grasping.memory import LongTermMemory
from controller.grasping.operator import Operator
from controller.grasping.state_machine import SENSED, TABLE, Event, State, after
from controller.grasping.teaching import Attention, learn_area
from controller.grasping.touch_events import TouchEvents
from controller.knowledge import Knowledge
from controller.requests import Reply
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.skin_input import SkinRows
from controller.touch.fusion import TactilePicture
from controller.touch.posture import PoseTarget
from skinnet.deployment.schema import ControllerSpec

__all__ = ["Session", "Transition", "requests_of"]

_ACCELERATION = slice(4, 7)
_POSE_NAME = re.compile(r"[A-Za-z0-9_\-]{1,64}")
_GRASP_POSES = ("open", "closed", "pulled")
_ARGUMENTS = {
    "guide": {"force": Event.GUIDE_FORCE, "proximity": Event.GUIDE_PROXIMITY, "off": Event.GUIDE_OFF},
    "attend": {
        **{area.value: Event.ATTEND for area in Area if area is not Area.OTHER},
        "off": Event.ATTEND_OFF,
    },
}
_PLAIN = {
    "remember": Event.REMEMBER,
    "go": Event.GO,
    "grasp": Event.GRASP,
    "release": Event.RELEASE,
    "cancel": Event.CANCEL,
    "end": Event.END,
}


def requests_of(poses: Iterable[str]) -> dict[str, list[str]]:
    """List the arguments of each request: [""] for none, an empty list for a free name."""
    requests = {what: list(arguments) for what, arguments in _ARGUMENTS.items()}
    return requests | {what: [""] for what in _PLAIN} | {"remember": [], "go": list(poses)}


class Transition(NamedTuple):
    """Transition log entry; `contacts` counts cells in contact on each arm, then on the chest."""

    t_ns: int
    state: str
    event: str
    to: str
    argument: str
    contacts: tuple[int, ...]


class Session:
    """Teach-and-grasp stage, which lasts until a request ends it.

    Attributes:
        log: All transitions.
        refused: Refused requests: time [ns], request, argument, state, reason.
    """

    thresholds = None

    def __init__(
        self,
        control: ControllerSpec,
        knowledge: Knowledge,
        memory: LongTermMemory,
        map_config: MapExplorationConfig,
        picture: TactilePicture,
        n_dofs: int,
        n_cells: int,
        t_ns: int,
    ) -> None:
        self._spec = control.session
        self._knowledge, self._memory = knowledge, memory
        self._map_config, self._n_dofs, self._n_cells = map_config, n_dofs, n_cells
        self._reacts = control.reactions.enabled
        table = directives(control.session, knowledge.parameters)
        memory.remember_parameters(parameters(table))
        self._directives = table if control.session.pre_contact else without_pre_contact(table)
        stale_ns = round(control.safety.stale_ms * 1e6)
        self._execution = Execution(knowledge, n_cells, stale_ns, control.session.stall_ns)
        self._operator = Operator(control.session.operator, control.session.patience_ns, t_ns)
        self._picture = picture
        self._senses = self._new_senses(t_ns)
        self._attention: Attention | None = None
        self._exploration: MapExploration | None = None
        self._argument = ""
        self._asked_argument = ""
        self.state = State.IDLE
        self.log: list[Transition] = []
        self.refused: list[tuple[int, str, str, str, str]] = []

    @property
    def done(self) -> bool:
        """True once the stage is ended."""
        return self.state is State.ENDED

    @property
    def label(self) -> str:
        """Current state."""
        return self.state.value

    @property
    def why(self) -> str:
        """Event that led to the current state; empty in the initial state."""
        return self.log[-1].event if self.log else ""

    @property
    def progress(self) -> float:
        """Completed fraction: 1 once ended, else 0, as the duration is open."""
        return float(self.done)

    @property
    def wants_stream(self) -> bool:
        """True while a pose is explored, which needs all accelerations."""
        return self._exploration is not None and self._exploration.wants_stream

    @property
    def gains(self) -> NDArray[np.float64]:
        """Reaction gains (S, 4) [rad/s per reading]."""
        return self._execution.gains

    @property
    def felt(self) -> NDArray[np.float64] | None:
        """Tactile input (S, 4) of the last tick's reaction; None while all gains are zero."""
        return self._execution.felt

    def take(self, stream: SkinRows) -> None:
        """Add accelerations to the exploration of a pose."""
        if self._exploration is not None:
            acceleration_g = stream.rows["values"][:, _ACCELERATION].astype(np.float64)
            self._exploration.add_samples(stream.cell, stream.rows["t_sampled_ns"], acceleration_g)

    def ask(self, t_ns: int, what: str, argument: str) -> Reply:
        """Handle a request, or refuse it and change nothing."""
        event, why = self._understand(what, argument)
        if event is not None and not why:
            why = self._hindrance(event, argument)
        if event is None or why:
            self.refused.append((t_ns, what, argument, self.state.value, why))
            return Reply(False, self.state.value, why)
        self._asked_argument = argument
        self._happen(t_ns, event)
        return Reply(True, self.state.value)

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], picture: TactilePicture
    ) -> NDArray[np.float64]:
        """Compute the joint velocities (D,) [rad/s] at `t_ns`."""
        brushed = self._attention is not None and self._attention.brushed
        request = self._operator.due(t_ns, self.state, touched=self._execution.touched or brushed)
        if request is not None:
            self.ask(t_ns, *request)
        if self._operator.gives_up(t_ns, self.state):
            self._happen(t_ns, Event.END)
        if self._attention is not None:
            self._attention.see(picture)
        velocity, events = self._execution.step(t_ns, position_rad, picture)
        if self._exploration is not None:
            self._exploration.add_positions(t_ns, position_rad)
            velocity = self._exploration.step(t_ns, position_rad)
            if self._exploration.done:
                events.add(Event.EXPLORED)
        events |= self._senses.sense(t_ns, picture)
        for event in SENSED:
            if event in events and after(self.state, event) is not None and not self._hindrance(event, ""):
                self._happen(t_ns, event)
                break
        return velocity

    def finish(self, t_ns: int) -> None:
        """Store nothing: the memory is written at each transition."""

    def _understand(self, what: str, argument: str) -> tuple[Event | None, str]:
        """Return the event of a request, or the reason of a refusal."""
        if what in _ARGUMENTS:
            allowed = _ARGUMENTS[what]
            if argument in allowed:
                return allowed[argument], ""
            return None, f"{what} {argument!r}: the argument is one of {', '.join(allowed)}"
        if what not in _PLAIN:
            known = ", ".join([*_ARGUMENTS, *_PLAIN])
            return None, f"unknown request {what!r}; there are {known}"
        if what in ("remember", "go"):
            if not _POSE_NAME.fullmatch(argument):
                return None, f"{what} {argument!r}: name a pose, of letters, digits, _ and -"
        elif argument:
            return None, f"{what} takes no argument"
        return _PLAIN[what], ""

    def _hindrance(self, event: Event, argument: str) -> str:
        """Return the reason why an event is not possible now; empty if it is."""
        poses = self._knowledge.poses
        if after(self.state, event) is None:
            possible = ", ".join(known.value for known in TABLE[self.state] if known not in SENSED)
            return f"not while {self.state.value}; possible are {possible or 'no requests'}"
        match event:
            case Event.GUIDE_FORCE | Event.GUIDE_PROXIMITY if not len(self._knowledge.map):
                return "no sensory-motor map yet; remember a pose first"
            case Event.GO if argument not in poses:
                return f"unknown pose {argument!r}; there are {', '.join(poses) or 'none'}"
            case Event.GRASP | Event.PATTED:
                missing = [name for name in _GRASP_POSES if name not in poses]
                if missing:
                    return f"cannot grasp: teach the poses {', '.join(missing)} first"
                return f"cannot grasp: {self._senses.missing}" if self._senses.missing else ""
            case Event.ATTEND_OFF if self._attention is None or not len(self._attention.cells):
                return "no cell was touched; brush over the area first, or cancel"
        return ""

    def _happen(self, t_ns: int, event: Event) -> None:
        """Leave the current state, log the transition and enter the next state."""
        state = after(self.state, event)
        assert state is not None
        self._leave(event)
        contacts = self._senses.contacts(self._picture)
        argument = self._asked_argument
        self.log.append(Transition(t_ns, self.state.value, event.value, state.value, argument, contacts))
        self._argument, self._asked_argument = self._asked_argument, ""
        again = state is self.state
        self.state = state
        if not again:
            self._enter(t_ns)

    def _leave(self, event: Event) -> None:
        if event is Event.ATTEND_OFF and self._attention is not None:
            label = self._attention.label
            self._knowledge.areas = learn_area(self._knowledge.areas, label, self._attention.cells)
            self._memory.remember_areas()
        if event is Event.EXPLORED and self._exploration is not None:
            self._knowledge.learn_pose(self._argument, self._exploration.result)
            self._memory.remember_pose(self._argument)
        self._attention = self._exploration = None

    def _enter(self, t_ns: int) -> None:
        directive = self._directives[self.state]
        name = self._argument if self.state is State.GO else directive.pose
        pose_rad = None if name is None else self._knowledge.poses.get(name)
        target = None
        if name is not None and pose_rad is not None:
            target = PoseTarget(name, pose_rad, directive.speed_rad_s, directive.accuracy_rad)
        self._execution.obey(t_ns, directive, target, reacts=self._reacts)
        if self.state is State.ATTEND:
            self._attention = Attention(self._argument, self._picture, self._spec.contact_level)
        if self.state is State.REMEMBER:
            self._exploration = MapExploration(self._map_config, self._n_dofs, self._n_cells, t_ns)
        self._senses = self._new_senses(t_ns)

    def _new_senses(self, t_ns: int) -> TouchEvents:
        areas = {Area(name): cells for name, cells in self._knowledge.areas.items()}
        activity = self._knowledge.activity(self._n_cells, self._n_dofs)
        return TouchEvents(self._spec, areas, activity, self._picture, t_ns)
