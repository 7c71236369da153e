"""Decision core of the nursing program: the program connected to the boards of the tactile sheets."""

from collections.abc import Hashable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.decision_core import Decision
from controller.inputs import JointMeasurement
from controller.nursing.contacts.board_input import BoardInput, sheet_surfaces
from controller.nursing.contacts.contact_frames import TactileInput
from controller.nursing.kinematics.model_errors import build_kinematics
from controller.nursing.nursing_program import NursingCommand, NursingProgram
from controller.request_queue import Reply
from controller.telemetry import describe_nursing
from controller.touch.safety_clamp import SafetyClamp, SafetyLimits
from skinnet.body.model import load_model
from skinnet.deployment import Deployment
from skinnet.deployment.controller.nursing import NursingSpec
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.messages import decode
from skinnet.protocol.sheet_messages import Regions
from skinnet.protocol.telemetry_messages import StateMachineDescription
from skinnet.runtime.upstream import Upstream
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["NursingCore", "build_nursing_core"]

_HOLD_AFTER_DONE_NS = 1_000_000_000
"""Time for which the object is still held after the program is done [ns]."""


class NursingCore:
    """Decision core of the nursing program, on the contact regions that the boards deliver.

    Args:
        program: Nursing program.
        board_input: Input of the regions of all boards.
        clamp: Safety clamp of all joints of the robot.
        columns: (N,) index of each joint of the program among the joints of the robot.
        period_ns: Control period [ns].
    """

    result_role = "nursing"
    capabilities_key: Hashable = ()
    """The states of the program, which takes no requests, never change."""

    def __init__(
        self,
        program: NursingProgram,
        board_input: BoardInput,
        clamp: SafetyClamp,
        columns: NDArray[np.int64],
        period_ns: int,
    ) -> None:
        self._program, self._board_input = program, board_input
        self._clamp, self._columns, self._period_ns = clamp, columns, period_ns
        self._last_command = NursingCommand(np.zeros(len(columns)), program.state, None, "")
        self._tactile_input: TactileInput | None = None
        self._peak_kpa = 0.0
        self._t_ns = 0
        self._done_ns: int | None = None

    @property
    def stage(self) -> str:
        """State of the program."""
        return self._last_command.state.value

    @property
    def state(self) -> str:
        """State of the program."""
        return self._last_command.state.value

    @property
    def progress(self) -> float:
        """Completed fraction of the state, 0 to 1."""
        return self._program.progress

    @property
    def reason(self) -> str:
        """Reason of a stop; empty unless stopped."""
        return self._last_command.reason

    @property
    def done(self) -> bool:
        """True once the object has been held long enough after the program."""
        next_ns = self._t_ns + self._period_ns
        return self._done_ns is not None and next_ns > self._done_ns + _HOLD_AFTER_DONE_NS

    def describe(self, t_ns: int) -> StateMachineDescription:
        """Describe the states of the program."""
        return describe_nursing(t_ns)

    def accept(self, channel: str, upstream: Upstream, payload: bytes) -> None:
        """Accept the contact regions of a period.

        Raises:
            ProtocolError: another channel, incomplete records, or an unknown board.
        """
        if channel != "regions":
            raise ProtocolError(f"the nursing controller does not subscribe to {channel}")
        regions = decode(payload, Regions)
        self._board_input.add(regions)
        upstream.end_period(regions.watermark_ns)

    def set_joint_ranges(self, range_rad: NDArray[np.float64]) -> None:
        """Ignore the limits: the controller's own model has them."""

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Ignore lost boards here; the program stops on `Event.SKIN_SILENT`."""

    def update_skin(self, t_ns: int) -> None:
        """Take the latest contact regions delivered before `t_ns`."""
        self._tactile_input = self._board_input.latest_input(t_ns)
        if self._tactile_input is not None:
            peaks_kpa = (region.peak_kpa for region in self._tactile_input.regions)
            self._peak_kpa = max(self._peak_kpa, *peaks_kpa, 0.0)

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Refuse any request."""
        return Reply(False, self.state, "the nursing controller accepts no requests")

    def tick(
        self,
        t_ns: int,
        joints: JointMeasurement,
        skin_watermark_ns: int,
        external_rad_s: NDArray[np.float64] | None,
    ) -> Decision:
        """Compute one control period; a deployment with this program allows no external velocities."""
        position_rad, program = joints.position_rad, self._program
        command = program.step(t_ns, position_rad[self._columns], joints.t_ns, self._tactile_input)
        self._last_command, self._t_ns = command, t_ns
        if program.done and self._done_ns is None:
            self._done_ns = t_ns
        wanted = np.zeros(len(position_rad))
        wanted[self._columns] = command.velocity_rad_s
        # at rest, the servos go on holding the object
        velocity = self._clamp.clamp(t_ns, wanted, position_rad, joints.t_ns, program.last_input_ns)
        return Decision(velocity, [], ())

    def result(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the facts of the program and the time series of every contact."""
        program, series = self._program, self._program.contact_series
        facts: dict[str, Any] = {
            "done": program.done,
            "states": [(state.value, t_ns) for state, t_ns in program.state_history],
            "stages": [],
            "reason": program.reason,
            "stopped_by": None if program.stopped_by is None else program.stopped_by.name.lower(),
            "safety": asdict(self._clamp.counters),
            "peak_kpa": self._peak_kpa,
            "received_frames": self._board_input.received_frames,
            "contacts": [] if series is None else [contact._asdict() for contact in series.summarise()],
        }
        return facts, {} if series is None else series.arrays()


def build_nursing_core(deployment: Deployment, spec: NursingSpec, base: Path) -> NursingCore:
    """Build the nursing program `spec` of `deployment` on the controller's own model of the robot.

    Raises:
        DeploymentError: the program does not match the robot.
    """
    sheets = place_sheets(deployment.surfaces, deployment.sheets)
    body = load_model(deployment, base, with_environment=False)
    period_ns, joints = deployment.controller.period_ns, deployment.body.joints
    limits = SafetyLimits.from_spec(deployment.controller.safety)
    try:
        program = NursingProgram(
            spec,
            build_kinematics(spec, body.mj, deployment.seed, body.home_qpos),
            sheet_surfaces(sheets, deployment.body.foam.thickness_m),
            period_ns,
            joints_timeout_ns=limits.joints_max_age_ns,
        )
    except ValueError as error:
        raise DeploymentError(f"nursing: {error}") from error
    if strangers := [joint for joint in spec.joints if joint not in joints]:
        raise DeploymentError(f"nursing.joints: {strangers[0]!r} is not in body.joints")
    return NursingCore(
        program,
        BoardInput(sheets, merge_distance_m=spec.association_distance_m),
        SafetyClamp(limits, len(joints), period_ns),
        np.array([joints.index(joint) for joint in spec.joints]),
        period_ns,
    )
