"""Nursing program: hold, record the initial contacts, move, settle, report. No I/O.

A stop never releases the object. The commanded object pose is frozen, the contacts are recorded again at
their present poses, so that earlier tracking errors are dropped, and tactile feedback continues: contact
forces drift with model errors even at rest, and feedback keeps the object from falling. It continues only for
contacts with tactile input. A contact without it keeps its adjustment: pushing blindly could squeeze a
person, yielding could let the object fall. Before the contacts are recorded, and while the joint measurements
are too old, the joints rest.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import Region, Sheet, TactileInput
from controller.nursing.contacts.contact_time_series import ContactTimeSeries
from controller.nursing.kinematics.robot_model import Kinematics
from controller.nursing.manipulation import Manipulation
from controller.nursing.object_trajectory import ObjectTrajectory, Waypoint
from controller.nursing.state_machine import STOP_EVENTS, TERMINAL_STATES, Event, State, next_state
from controller.nursing.trajectory_generation import TrajectoryStep
from skinnet.deployment.controller.nursing import NursingSpec
from skinnet.deployment.types import ns_of_s

__all__ = ["NursingCommand", "NursingProgram"]

Floats = NDArray[np.float64]


class NursingCommand(NamedTuple):
    """Joint command and state of one control period."""

    velocity_rad_s: Floats
    """Joint velocities (N,) of the controlled joints [rad/s]."""
    state: State
    stopped_by: Event | None
    reason: str
    """Reason of the stop with names and numbers; empty unless stopped."""


class NursingProgram:
    """Nursing program as a pure state machine, one step per control period."""

    def __init__(
        self,
        spec: NursingSpec,
        kinematics: Kinematics,
        sheets: Mapping[str, Sheet],
        period_ns: int,
        *,
        joints_timeout_ns: int,
    ) -> None:
        """Start in `State.HOLD`.

        Args:
            spec: Nursing section of the deployment.
            kinematics: Kinematic model of the controller, with the joints of `spec` as its columns.
            sheets: Sheets known to the controller, by name.
            period_ns: Control period [ns], 10 ms in [R11].
            joints_timeout_ns: Age [ns] of a joint measurement beyond which the program stops.

        Raises:
            ValueError: the model has other joints, or a weight names neither a sheet nor its body.
        """
        if kinematics.joints != spec.joints:
            raise ValueError(f"the model moves {kinematics.joints}, the program {spec.joints}")
        known = {*sheets, *(sheet.body for sheet in sheets.values())}
        if strangers := sorted(set(spec.weights) - known):
            raise ValueError(f"weights.{strangers[0]}: unknown sheet or body; allowed are {sorted(known)}")
        self._spec, self._kinematics, self._sheets = spec, kinematics, sheets
        self._period_s, self._joints_timeout_ns = period_ns * 1e-9, joints_timeout_ns
        self._object_trajectory = ObjectTrajectory(
            [
                Waypoint(ns_of_s(point.t_s), point.displacement_m, point.rotation_rad)
                for point in spec.waypoints
            ]
        )
        self.state = State.HOLD
        self.stopped_by: Event | None = None
        self.reason = ""
        self.state_history: list[tuple[State, int]] = []
        """History of states, each with its start time [ns]."""
        self.contact_series: ContactTimeSeries | None = None
        """Time series since the contacts were recorded; None before."""
        self.manipulation: Manipulation | None = None
        self.last_input_ns = -1
        """Sampling time [ns] of the newest tactile input; the start of the program before the first."""
        self._state_start_ns = self._t_ns = -1
        self._samples: list[TactileInput] = []

    @property
    def progress(self) -> float:
        """Progress of the present state, 0 to 1."""
        spec = self._spec
        due_ns = {
            State.HOLD: spec.hold_ns,
            State.RECORD: spec.record_ns,
            State.MOVE: self._object_trajectory.end_ns,
            State.SETTLE: spec.settle_ns,
        }.get(self.state, 0)
        return min(1.0, (self._t_ns - self._state_start_ns) / due_ns) if due_ns else 1.0

    @property
    def done(self) -> bool:
        """True in a terminal state; the object is still held while `step` is called."""
        return self.state in TERMINAL_STATES

    def step(
        self, t_ns: int, q: Floats, t_joints_ns: int, tactile_input: TactileInput | None
    ) -> NursingCommand:
        """Run one control period.

        Args:
            t_ns: Current time [ns].
            q: (N,) measured joint positions [rad].
            t_joints_ns: Time of their measurement [ns].
            tactile_input: Latest tactile input; None before the first.
        """
        if self._state_start_ns < 0:
            self._state_start_ns = self.last_input_ns = t_ns
            self.state_history.append((self.state, t_ns))
        self._t_ns = t_ns
        if tactile_input is not None:
            self.last_input_ns = max(self.last_input_ns, tactile_input.t_ns)
        if t_ns - t_joints_ns > self._joints_timeout_ns:
            return self._rest(t_joints_ns)
        silent = t_ns - self.last_input_ns > self._spec.skin_timeout_ns or tactile_input is None
        velocity = np.zeros(len(self._kinematics))
        match self.state:
            case State.HOLD:
                if t_ns - self._state_start_ns >= self._spec.hold_ns and not silent:
                    self._transition(Event.HOLD_ELAPSED)
            case State.RECORD:
                self._record(q, tactile_input, silent)
            case _:
                if self.manipulation is not None:
                    velocity = self._manipulate(self.manipulation, None if silent else tactile_input)
        self._check_safety(tactile_input, silent)
        return NursingCommand(velocity, self.state, self.stopped_by, self.reason)

    def _rest(self, t_joints_ns: int) -> NursingCommand:
        """Rest while the joint measurements are too old for kinematics and feedback; stop if not stopped."""
        if not self.done:
            self._transition(Event.JOINTS_SILENT, f"last measured at {t_joints_ns / 1e9:.3f} s")
        return NursingCommand(np.zeros(len(self._kinematics)), self.state, self.stopped_by, self.reason)

    def _record(self, q: Floats, tactile_input: TactileInput | None, silent: bool) -> None:
        """Average the tactile input; at the end of the state, record the initial contacts."""
        if (
            tactile_input is not None
            and not silent
            and (not self._samples or tactile_input.t_ns > self._samples[-1].t_ns)
        ):
            self._samples.append(tactile_input)
        if self._t_ns - self._state_start_ns < self._spec.record_ns or not self._samples:
            return
        regions = _assumed_regions(self._spec) or _average_regions(
            self._samples, self._spec.contact_threshold_n
        )
        if not regions:
            self._transition(
                Event.NO_CONTACT, f"no region has a force of {self._spec.contact_threshold_n:g} N or more"
            )
            return
        for region in regions:
            sheet = self._sheets.get(region.sheet)
            if sheet is None or not self._kinematics.has_body(sheet.body):
                link = region.sheet if sheet is None else sheet.body
                self._transition(Event.UNKNOWN_LINK, f'"{link}" presses with {region.force_n:.1f} N')
                return
        try:
            self.manipulation = Manipulation(
                self._spec, self._kinematics, self._sheets, regions, self._t_ns, q, self._period_s
            )
        except ValueError as error:
            self._transition(Event.INVALID_CONTACT, str(error))
            return
        self.contact_series = ContactTimeSeries(self.manipulation)
        self._transition(*(self._check_singular(self.manipulation) or (Event.RECORDED, "")))

    def _manipulate(self, manipulation: Manipulation, tactile_input: TactileInput | None) -> Floats:
        """Run one period with recorded contacts: update feedback, move or hold, check for transitions."""
        lost = manipulation.update_feedback(
            self._t_ns, None if tactile_input is None else tactile_input.regions
        )
        if self.state is State.MOVE:
            step = manipulation.move(*self._object_trajectory.pose_at(self._t_ns - self._state_start_ns))
        else:
            step = manipulation.hold()
        assert self.contact_series is not None
        self.contact_series.add(self._t_ns, step)
        if not self.done:
            self._check_transitions(manipulation, step, lost, silent=tactile_input is None)
        return step.velocity

    def _check_transitions(
        self, manipulation: Manipulation, step: TrajectoryStep, lost: NDArray[np.bool_], *, silent: bool
    ) -> None:
        """Trigger the stop event of a failed check, or else the event of a completed state."""
        names = manipulation.contacts.names
        if silent:
            return  # no tactile input is not a lost contact; `_check_safety` triggers SKIN_SILENT
        if lost.any() and not self._spec.assumed_contacts:
            self._transition(Event.CONTACT_LOST, ", ".join(np.array(names)[lost]))
        elif wrong := self._check_singular(manipulation) or self._check_reachable(names, step):
            self._transition(*wrong)
        elif self.state is State.MOVE and self._t_ns - self._state_start_ns >= self._object_trajectory.end_ns:
            self._transition(Event.ARRIVED)
        elif self.state is State.SETTLE and self._t_ns - self._state_start_ns >= self._spec.settle_ns:
            self._transition(Event.SETTLED)

    def _check_singular(self, manipulation: Manipulation) -> tuple[Event, str] | None:
        share = manipulation.mobility
        if share >= self._spec.min_mobility:
            return None
        return Event.SINGULAR_POSTURE, (
            f"the contacts can follow {share:.2f} of a shift in some direction, "
            f"not {self._spec.min_mobility:g}"
        )

    def _check_reachable(self, names: tuple[str, ...], step: TrajectoryStep) -> tuple[Event, str] | None:
        position_m, rotation_rad = step.deviations
        c = int(
            np.argmax(
                np.maximum(
                    position_m / self._spec.position_tolerance_m,
                    rotation_rad / self._spec.rotation_tolerance_rad,
                )
            )
        )
        if (
            position_m[c] <= self._spec.position_tolerance_m
            and rotation_rad[c] <= self._spec.rotation_tolerance_rad
        ):
            return None
        return Event.UNREACHABLE, (
            f"{names[c]} deviates by {1e3 * position_m[c]:.0f} mm and {np.degrees(rotation_rad[c]):.0f}°"
        )

    def _check_safety(self, tactile_input: TactileInput | None, silent: bool) -> None:
        """Trigger SKIN_SILENT or PRESSURE_LIMIT in every state that is not terminal."""
        if self.done:
            return
        if silent and self._t_ns - self.last_input_ns > self._spec.skin_timeout_ns:
            self._transition(Event.SKIN_SILENT, f"last heard at {self.last_input_ns / 1e9:.3f} s")
            return
        worst = (
            max(tactile_input.regions, key=lambda r: r.peak_kpa, default=None)
            if tactile_input is not None
            else None
        )
        if worst is not None and worst.peak_kpa > self._spec.max_pressure_kpa:
            limit = self._spec.max_pressure_kpa
            self._transition(
                Event.PRESSURE_LIMIT, f"{worst.peak_kpa:.0f} kPa on {worst.sheet}, {limit:g} allowed"
            )

    def _transition(self, event: Event, detail: str = "") -> None:
        self.state = next_state(self.state, event)
        self.state_history.append((self.state, self._t_ns))
        self._state_start_ns = self._t_ns
        if event in STOP_EVENTS:
            self.stopped_by = event
            self.reason = f"{event.value}: {detail}" if detail else event.value
            if self.manipulation is not None:
                self.manipulation.rebase_contacts()


def _assumed_regions(spec: NursingSpec) -> list[Region]:
    """Return the assumed contacts of the deployment, which have no tactile input."""
    return [Region(contact.surface, 0, contact.xi_m, 0.0, 0.0) for contact in spec.assumed_contacts]


def _average_regions(samples: list[TactileInput], contact_threshold_n: float) -> list[Region]:
    """Average the newest sample's regions over all samples; drop regions below the contact threshold."""
    regions = []
    for newest in samples[-1].regions:
        same = [
            r
            for s in samples
            for r in s.regions
            if (r.sheet, r.region_id) == (newest.sheet, newest.region_id)
        ]
        force_n = float(np.mean([r.force_n for r in same]))
        first, second = np.mean([r.xi_m for r in same], axis=0).tolist()
        if force_n >= contact_threshold_n:
            regions.append(newest._replace(force_n=force_n, xi_m=(first, second)))
    return sorted(regions, key=lambda r: (r.sheet, r.region_id))
