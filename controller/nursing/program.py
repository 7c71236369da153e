"""The loop of nursing care: hold, record the initial contacts, move, settle, report. No I/O.

A stop never lets go. The object stays where it was asked to be, the contacts are recorded anew where they
are, so that nothing is run after any more, and feedback goes on: it is what keeps the object from falling,
since forces drift with every error of the model whether the arms move or not. It goes on for the contacts
that are felt only. Whoever is not felt keeps its adjustment: to push without feeling may squeeze a person, to
give way would let the object fall. Before the contacts are recorded, the joints simply rest.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts import Felt, Region, Sheet
from controller.nursing.kinematics import Kinematics
from controller.nursing.manipulation import Manipulation
from controller.nursing.object_path import ObjectPath, Waypoint
from controller.nursing.report import Course
from controller.nursing.states import STOPS, TERMINAL, Event, State, after
from controller.nursing.trajectory import Step
from skinnet.deployment.nursing import NursingSpec
from skinnet.deployment.table import ns_of_s

__all__ = ["NursingCommand", "NursingProgram"]

Floats = NDArray[np.float64]


class NursingCommand(NamedTuple):
    """What one period decides."""

    velocity_rad_s: Floats
    """(N,) of the joints that take part."""
    state: State
    stopped_by: Event | None
    reason: str
    """What stopped it, with names and numbers; empty unless stopped."""


class NursingProgram:
    """The program as a pure state machine, one step per control period."""

    def __init__(
        self, spec: NursingSpec, kinematics: Kinematics, sheets: Mapping[str, Sheet], period_ns: int
    ) -> None:
        """Starts in hold.

        Args:
            spec: What to do.
            kinematics: The controller's model, with the joints of `spec` as its columns.
            sheets: Sheets that the controller knows, by name.
            period_ns: Control period, 10 ms in the paper.

        Raises:
            ValueError: the model has other joints, or a weight names neither a sheet nor its body.
        """
        if kinematics.joints != spec.joints:
            raise ValueError(f"the model moves {kinematics.joints}, the program {spec.joints}")
        known = {*sheets, *(sheet.body for sheet in sheets.values())}
        if strangers := sorted(set(spec.weights) - known):
            raise ValueError(f"weights.{strangers[0]}: no such sheet or body; there are {sorted(known)}")
        self._spec, self._kinematics, self._sheets = spec, kinematics, sheets
        self._period_s = period_ns * 1e-9
        self._path = ObjectPath(
            [
                Waypoint(ns_of_s(point.t_s), point.displacement_m, point.rotation_rad)
                for point in spec.waypoints
            ]
        )
        self.state = State.HOLD
        self.stopped_by: Event | None = None
        self.reason = ""
        self.log: list[tuple[State, int]] = []
        """States so far and when each began."""
        self.course: Course | None = None
        """What happened since the contacts were recorded."""
        self.manipulation: Manipulation | None = None
        self._since_ns = self._t_ns = -1
        self._heard_ns = -1
        self._samples: list[Felt] = []

    @property
    def progress(self) -> float:
        """Share of the present state that is over, 0 to 1."""
        spec = self._spec
        due_ns = {
            State.HOLD: spec.hold_ns,
            State.RECORD: spec.record_ns,
            State.MOVE: self._path.end_ns,
            State.SETTLE: spec.settle_ns,
        }.get(self.state, 0)
        return min(1.0, (self._t_ns - self._since_ns) / due_ns) if due_ns else 1.0

    @property
    def done(self) -> bool:
        """It has reported or stopped; it goes on holding as long as it is stepped."""
        return self.state in TERMINAL

    def step(self, t_ns: int, q: Floats, felt: Felt | None) -> NursingCommand:
        """One control period.

        Args:
            t_ns: now.
            q: (N,) joint readings [rad].
            felt: The newest that the skin felt; None before the first.
        """
        if self._since_ns < 0:
            self._since_ns = self._heard_ns = t_ns
            self.log.append((self.state, t_ns))
        self._t_ns = t_ns
        if felt is not None:
            self._heard_ns = max(self._heard_ns, felt.t_ns)
        silent = t_ns - self._heard_ns > self._spec.silent_ns or felt is None
        velocity = np.zeros(len(self._kinematics))
        match self.state:
            case State.HOLD:
                if t_ns - self._since_ns >= self._spec.hold_ns and not silent:
                    self._happen(Event.HELD)
            case State.RECORD:
                self._record(q, felt, silent)
            case _:
                if self.manipulation is not None:
                    velocity = self._manipulate(self.manipulation, None if silent else felt)
        self._watch(felt, silent)
        return NursingCommand(velocity, self.state, self.stopped_by, self.reason)

    def _record(self, q: Floats, felt: Felt | None, silent: bool) -> None:
        """Averages what is felt; at the end, turns it into the initial contacts."""
        if felt is not None and not silent and (not self._samples or felt.t_ns > self._samples[-1].t_ns):
            self._samples.append(felt)
        if self._t_ns - self._since_ns < self._spec.record_ns or not self._samples:
            return
        regions = _assumed(self._spec) or _averaged(self._samples, self._spec.contact_n)
        if not regions:
            self._happen(Event.NO_CONTACT, f"nothing presses with {self._spec.contact_n:g} N or more")
            return
        for region in regions:
            sheet = self._sheets.get(region.sheet)
            if sheet is None or not self._kinematics.knows(sheet.body):
                link = region.sheet if sheet is None else sheet.body
                self._happen(Event.UNKNOWN_LINK, f'"{link}" presses with {region.force_n:.1f} N')
                return
        try:
            self.manipulation = Manipulation(
                self._spec, self._kinematics, self._sheets, regions, self._t_ns, q, self._period_s
            )
        except ValueError as error:
            self._happen(Event.UNUSABLE_CONTACT, str(error))
            return
        self.course = Course(self.manipulation)
        self._happen(*(self._singular(self.manipulation) or (Event.RECORDED, "")))

    def _manipulate(self, manipulation: Manipulation, felt: Felt | None) -> Floats:
        """One period with the contacts recorded: feel, move or hold, judge."""
        lost = manipulation.feel(self._t_ns, None if felt is None else felt.regions)
        if self.state is State.MOVE:
            step = manipulation.move(*self._path.at(self._t_ns - self._since_ns))
        else:
            step = manipulation.hold()
        assert self.course is not None
        self.course.add(self._t_ns, step)
        if not self.done:
            self._judge(manipulation, step, lost, silent=felt is None)
        return step.velocity

    def _judge(
        self, manipulation: Manipulation, step: Step, lost: NDArray[np.bool_], *, silent: bool
    ) -> None:
        """What went wrong, or else what is completed."""
        names = manipulation.contacts.names
        if silent:
            return  # a contact that nobody can feel is not lost; `_watch` says what it is
        if lost.any() and not self._spec.assumed:
            self._happen(Event.CONTACT_LOST, ", ".join(np.array(names)[lost]))
        elif wrong := self._singular(manipulation) or self._out_of_reach(names, step):
            self._happen(*wrong)
        elif self.state is State.MOVE and self._t_ns - self._since_ns >= self._path.end_ns:
            self._happen(Event.ARRIVED)
        elif self.state is State.SETTLE and self._t_ns - self._since_ns >= self._spec.settle_ns:
            self._happen(Event.SETTLED)

    def _singular(self, manipulation: Manipulation) -> tuple[Event, str] | None:
        share = manipulation.mobility
        if share >= self._spec.mobility:
            return None
        return Event.SINGULAR_POSTURE, (
            f"the contacts can follow {share:.2f} of a shift in some direction, not {self._spec.mobility:g}"
        )

    def _out_of_reach(self, names: tuple[str, ...], step: Step) -> tuple[Event, str] | None:
        position_m, rotation_rad = step.deviations
        c = int(np.argmax(np.maximum(position_m / self._spec.reach_m, rotation_rad / self._spec.reach_rad)))
        if position_m[c] <= self._spec.reach_m and rotation_rad[c] <= self._spec.reach_rad:
            return None
        return Event.UNREACHABLE, (
            f"{names[c]} deviates by {1e3 * position_m[c]:.0f} mm and {np.degrees(rotation_rad[c]):.0f}°"
        )

    def _watch(self, felt: Felt | None, silent: bool) -> None:
        """Silence and discomfort, in every state that can still stop."""
        if self.done:
            return
        if silent and self._t_ns - self._heard_ns > self._spec.silent_ns:
            self._happen(Event.SKIN_SILENT, f"last heard at {self._heard_ns / 1e9:.3f} s")
            return
        worst = max(felt.regions, key=lambda r: r.peak_kpa, default=None) if felt is not None else None
        if worst is not None and worst.peak_kpa > self._spec.comfort_kpa:
            limit = self._spec.comfort_kpa
            self._happen(
                Event.PRESSURE_LIMIT, f"{worst.peak_kpa:.0f} kPa on {worst.sheet}, {limit:g} allowed"
            )

    def _happen(self, event: Event, detail: str = "") -> None:
        self.state = after(self.state, event)
        self.log.append((self.state, self._t_ns))
        self._since_ns = self._t_ns
        if event in STOPS:
            self.stopped_by = event
            self.reason = f"{event.value}: {detail}" if detail else event.value
            if self.manipulation is not None:
                self.manipulation.stay()


def _assumed(spec: NursingSpec) -> list[Region]:
    """Contacts that the deployment wants to be assumed, with nothing behind them."""
    return [Region(contact.surface, 0, contact.xi_m, 0.0, 0.0) for contact in spec.assumed]


def _averaged(samples: list[Felt], contact_n: float) -> list[Region]:
    """Regions of the newest sample with their means over all samples that have them; contacts only."""
    regions = []
    for newest in samples[-1].regions:
        same = [r for s in samples for r in s.regions if (r.sheet, r.number) == (newest.sheet, newest.number)]
        force_n = float(np.mean([r.force_n for r in same]))
        first, second = np.mean([r.xi_m for r in same], axis=0).tolist()
        if force_n >= contact_n:
            regions.append(newest._replace(force_n=force_n, xi_m=(first, second)))
    return sorted(regions, key=lambda r: (r.sheet, r.number))
