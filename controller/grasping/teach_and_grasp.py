"""Teach-and-grasp stage: a state machine driven by requests and tactile events, without I/O."""

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellRows
from controller.grasping.area_teaching import AreaTeaching, replace_area
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.low_level_control import LowLevelControl
from controller.grasping.scripted_operator import ScriptedOperator
from controller.grasping.state_machine import SENSED_EVENTS, TRANSITIONS, Event, State, next_state
from controller.grasping.state_parameters import (
    Area,
    flatten_state_parameters,
    merge_state_parameters,
    without_pre_contact,
)
from controller.grasping.touch_events import TouchEventDetector
from controller.request_queue import Reply
from controller.self_model import SelfModel
from controller.selforganisation.exploration import add_readings
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.touch.posture import PoseTarget
from controller.touch.tactile_state import TactileState
from skinnet.deployment.controller.controller import ControllerSpec

__all__ = ["TeachAndGrasp", "TransitionRecord", "parse_request", "request_arguments"]

_POSE_NAME = re.compile(r"[A-Za-z0-9_\-]{1,64}")
_GRASP_POSES = ("open", "closed", "pulled")
_ENUMERATED_REQUESTS = {
    "guide": {"force": Event.GUIDE_FORCE, "proximity": Event.GUIDE_PROXIMITY, "off": Event.GUIDE_OFF},
    "attend": {
        **{area.value: Event.ATTEND for area in Area if area is not Area.OTHER},
        "off": Event.ATTEND_OFF,
    },
}
_OTHER_REQUESTS = {
    "remember": Event.REMEMBER,
    "go": Event.GO,
    "grasp": Event.GRASP,
    "release": Event.RELEASE,
    "cancel": Event.CANCEL,
    "end": Event.END,
}


def request_arguments(poses: Iterable[str]) -> dict[str, list[str]]:
    """List the arguments of each request: [""] for none, an empty list for a free name."""
    requests = {what: list(arguments) for what, arguments in _ENUMERATED_REQUESTS.items()}
    return requests | {what: [""] for what in _OTHER_REQUESTS} | {"remember": [], "go": list(poses)}


class TransitionRecord(NamedTuple):
    """Transition log entry; `contacts` counts cells in contact on each arm, then on the chest."""

    t_ns: int
    state: str
    event: str
    next_state: str
    argument: str
    contacts: tuple[int, ...]


class TeachAndGrasp:
    """Teach-and-grasp stage, which lasts until a request ends it.

    Attributes:
        log: All transitions.
        refused: Refused requests: time [ns], request, argument, state, reason.
    """

    thresholds = None

    def __init__(
        self,
        control: ControllerSpec,
        self_model: SelfModel,
        memory: LongTermMemory,
        map_config: MapExplorationConfig,
        tactile_state: TactileState,
        n_dofs: int,
        n_cells: int,
        t_ns: int,
    ) -> None:
        self._spec = control.teach_and_grasp
        self._self_model, self._memory = self_model, memory
        self._map_config, self._n_dofs, self._n_cells = map_config, n_dofs, n_cells
        self._reactions_enabled = control.reactions.enabled
        table = merge_state_parameters(control.teach_and_grasp, self_model.parameters)
        memory.store_parameters(flatten_state_parameters(table))
        self._state_parameters = table if control.teach_and_grasp.pre_contact else without_pre_contact(table)
        stale_ns = round(control.safety.input_timeout_ms * 1e6)
        self._low_level_control = LowLevelControl(
            self_model, n_cells, stale_ns, control.teach_and_grasp.stall_timeout_ns
        )
        self._operator = ScriptedOperator(
            control.teach_and_grasp.operator_requests, control.teach_and_grasp.operator_timeout_ns, t_ns
        )
        self._tactile_state = tactile_state
        self._touch_events = self._new_touch_events(t_ns)
        self._area_teaching: AreaTeaching | None = None
        self._exploration: MapExploration | None = None
        self._argument = ""
        self._requested_argument = ""
        self.state = State.IDLE
        self.log: list[TransitionRecord] = []
        self.refused: list[tuple[int, str, str, str, str]] = []

    @property
    def done(self) -> bool:
        """True once the stage is ended."""
        return self.state is State.ENDED

    @property
    def state_name(self) -> str:
        """Current state."""
        return self.state.value

    @property
    def reason(self) -> str:
        """Event that led to the current state; empty in the initial state."""
        return self.log[-1].event if self.log else ""

    @property
    def progress(self) -> float:
        """Completed fraction: 1 once ended, else 0, as the duration is open."""
        return float(self.done)

    @property
    def needs_stream(self) -> bool:
        """True while a pose is explored, which needs all accelerations."""
        return self._exploration is not None and self._exploration.needs_stream

    @property
    def gains(self) -> NDArray[np.float64]:
        """Reaction gains (S, 4) [rad/s per reading]."""
        return self._low_level_control.gains

    @property
    def tactile_input(self) -> NDArray[np.float64] | None:
        """Tactile input (S, 4) of the last tick's reaction; None while all gains are zero."""
        return self._low_level_control.tactile_input

    def add_readings(self, stream: CellRows) -> None:
        """Add readings to the exploration of a pose."""
        if self._exploration is not None:
            add_readings(self._exploration, stream)

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Handle a request, or refuse it and change nothing."""
        event, why = parse_request(name, argument)
        if event is not None and not why:
            why = self._guard(event, argument)
        if event is None or why:
            self.refused.append((t_ns, name, argument, self.state.value, why))
            return Reply(False, self.state.value, why)
        self._requested_argument = argument
        self._transition(t_ns, event)
        return Reply(True, self.state.value)

    def step(
        self, t_ns: int, position_rad: NDArray[np.float64], tactile_state: TactileState
    ) -> NDArray[np.float64]:
        """Compute the joint velocities (D,) [rad/s] at `t_ns`."""
        brushed = self._area_teaching is not None and self._area_teaching.in_contact
        request = self._operator.next_request(
            t_ns, self.state, touched=self._low_level_control.reacting or brushed
        )
        if request is not None:
            self.handle_request(t_ns, *request)
        if self._operator.timed_out(t_ns, self.state):
            self._transition(t_ns, Event.END)
        if self._area_teaching is not None:
            self._area_teaching.update(tactile_state)
        velocity, events = self._low_level_control.step(t_ns, position_rad, tactile_state)
        if self._exploration is not None:
            self._exploration.add_positions(t_ns, position_rad)
            velocity = self._exploration.step(t_ns, position_rad)
            if self._exploration.done:
                events.add(Event.EXPLORED)
        events |= self._touch_events.detect(t_ns, tactile_state)
        for event in SENSED_EVENTS:
            if event in events and next_state(self.state, event) is not None and not self._guard(event, ""):
                self._transition(t_ns, event)
                break
        return velocity

    def finish(self, t_ns: int) -> None:
        """Store nothing: the memory is written at each transition."""

    def _guard(self, event: Event, argument: str) -> str:
        """Return the reason why an event is not possible now; empty if it is."""
        poses = self._self_model.poses
        if next_state(self.state, event) is None:
            possible = ", ".join(
                known.value for known in TRANSITIONS[self.state] if known not in SENSED_EVENTS
            )
            return f"not possible in state {self.state.value}; possible requests: {possible or 'none'}"
        match event:
            case Event.GUIDE_FORCE | Event.GUIDE_PROXIMITY if not len(self._self_model.sensory_motor_map):
                return "no sensory-motor map yet; remember a pose first"
            case Event.GO if argument not in poses:
                return f"unknown pose {argument!r}; known poses: {', '.join(poses) or 'none'}"
            case Event.GRASP | Event.PATTED:
                missing = [name for name in _GRASP_POSES if name not in poses]
                if missing:
                    return f"cannot grasp: teach the poses {', '.join(missing)} first"
                return (
                    f"cannot grasp: {self._touch_events.unmet_requirement}"
                    if self._touch_events.unmet_requirement
                    else ""
                )
            case Event.ATTEND_OFF if self._area_teaching is None or not len(self._area_teaching.cells):
                return "no cell was touched; brush over the area first, or cancel"
        return ""

    def _transition(self, t_ns: int, event: Event) -> None:
        """Leave the current state, log the transition and enter the next state."""
        state = next_state(self.state, event)
        assert state is not None
        self._leave(event)
        contacts = self._touch_events.contact_counts(self._tactile_state)
        argument = self._requested_argument
        self.log.append(
            TransitionRecord(t_ns, self.state.value, event.value, state.value, argument, contacts)
        )
        self._argument, self._requested_argument = self._requested_argument, ""
        again = state is self.state
        self.state = state
        if not again:
            self._enter(t_ns)

    def _leave(self, event: Event) -> None:
        if event is Event.ATTEND_OFF and self._area_teaching is not None:
            label = self._area_teaching.area
            self._self_model.areas = replace_area(self._self_model.areas, label, self._area_teaching.cells)
            self._memory.store_areas()
        if event is Event.EXPLORED and self._exploration is not None:
            self._self_model.add_pose(self._argument, self._exploration.result)
            self._memory.store_structure()
            self._memory.store_pose(self._argument)
        self._area_teaching = self._exploration = None

    def _enter(self, t_ns: int) -> None:
        directive = self._state_parameters[self.state]
        name = self._argument if self.state is State.GO else directive.pose
        pose_rad = None if name is None else self._self_model.poses.get(name)
        target = None
        if name is not None and pose_rad is not None:
            target = PoseTarget(name, pose_rad, directive.speed_rad_s, directive.tolerance_rad)
        self._low_level_control.apply(t_ns, directive, target, reactions_enabled=self._reactions_enabled)
        if self.state is State.ATTEND:
            self._area_teaching = AreaTeaching(self._argument, self._tactile_state, self._spec.contact_level)
        if self.state is State.REMEMBER:
            self._exploration = MapExploration(
                self._map_config,
                self._n_dofs,
                self._n_cells,
                t_ns,
                dof_names=self._self_model.dof_names,
                cell_names=self._self_model.cell_names,
            )
        self._touch_events = self._new_touch_events(t_ns)

    def _new_touch_events(self, t_ns: int) -> TouchEventDetector:
        areas = {Area(name): cells for name, cells in self._self_model.areas.items()}
        activity = self._self_model.activity(self._n_cells, self._n_dofs)
        return TouchEventDetector(self._spec, areas, activity, self._tactile_state, t_ns)


def parse_request(name: str, argument: str) -> tuple[Event | None, str]:
    """Return the event of a request, or None and the reason of a refusal."""
    if name in _ENUMERATED_REQUESTS:
        allowed = _ENUMERATED_REQUESTS[name]
        if argument in allowed:
            return allowed[argument], ""
        return None, f"{name} {argument!r}: the argument is one of {', '.join(allowed)}"
    if name not in _OTHER_REQUESTS:
        known = ", ".join([*_ENUMERATED_REQUESTS, *_OTHER_REQUESTS])
        return None, f"unknown request {name!r}; there are {known}"
    if name in ("remember", "go"):
        if not _POSE_NAME.fullmatch(argument):
            return None, f"{name} {argument!r}: name a pose, of letters, digits, _ and -"
    elif argument:
        return None, f"{name} takes no argument"
    return _OTHER_REQUESTS[name], ""
