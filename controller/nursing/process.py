"""Nursing controller process: the nursing program connected to joint feedback, boards and commands."""

import hashlib
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.capabilities import describe_nursing
from controller.nursing.contacts.board_input import BoardInput, sheet_surfaces
from controller.nursing.kinematics.model_errors import build_kinematics
from controller.nursing.nursing_program import NursingCommand, NursingProgram
from controller.request_queue import Reply, RequestQueue
from controller.state_recorder import StateRecorder
from controller.touch.safety_clamp import SafetyClamp, SafetyLimits
from skinnet.body.model import load_model
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.channels import RECORDER, Keys, Role
from skinnet.protocol.messages import FOREVER_NS, Command, ControllerState, Joints, Request, decode, encode
from skinnet.protocol.sheet_messages import Regions
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["NursingProcess"]

_STATE_PERIOD_S = 0.1
_HOLD_AFTER_DONE_NS = 1_000_000_000
"""Time for which the object is still held after the program is done [ns]."""


class NursingProcess:
    """Nursing controller, stepped once per control period on joint feedback and delivered board frames."""

    role = Role.CONTROLLER.value
    follows_wall_clock = False

    def __init__(self, deployment: Deployment, name: str, base: Path) -> None:
        """Build the nursing program of `deployment` on the controller's own model of the robot.

        Raises:
            DeploymentError: the program does not match the robot.
        """
        assert deployment.nursing is not None
        self.name = name
        keys = Keys(deployment.robot)
        self.subscriptions: tuple[str, ...] = (
            keys.of("joints"),
            keys.of("regions", "*"),
            keys.of("request", "*"),
        )
        self._body = Upstream("body", "body", watermark_ns=-1)
        self._boards = Upstream(BOARD_PROCESS, BOARD_PROCESS)
        self.upstreams: Mapping[str, Upstream] = {"body": self._body, BOARD_PROCESS: self._boards}
        self.senders = frozenset({"body", BOARD_PROCESS})
        self.peers: frozenset[str] = frozenset({"body", name, *deployment.skin_processes()})
        self.tolerated_losses = frozenset(deployment.run.tolerated_losses)
        self.counters: Counter[str] = Counter()
        self._state_key, self._command_key = keys.of("state"), keys.of("command")
        self._state_machine_key = keys.of("state_machine")
        control, spec = deployment.controller, deployment.nursing
        self._period_ns, self._delay_ns = control.period_ns, control.command_delay_ns
        self._hyperperiod_ns, self._max_ns = deployment.hyperperiod_ns, deployment.max_duration_ns
        sheets = place_sheets(deployment.surfaces, deployment.sheets)
        body = load_model(deployment, base, with_environment=False)
        self._board_input = BoardInput(sheets, merge_distance_m=spec.association_distance_m)
        try:
            self._program = NursingProgram(
                spec,
                build_kinematics(spec, body.mj, deployment.seed, body.home_qpos),
                sheet_surfaces(sheets, deployment.body.foam.thickness_m),
                self._period_ns,
            )
        except ValueError as error:
            raise DeploymentError(f"nursing: {error}") from error
        joints = deployment.body.joints
        if strangers := [joint for joint in spec.joints if joint not in joints]:
            raise DeploymentError(f"nursing.joints: {strangers[0]!r} is not among body.joints")
        self._column = np.array([joints.index(joint) for joint in spec.joints])
        self._clamp = SafetyClamp(_limits(deployment), len(joints), self._period_ns)
        self._t_ns = 0
        self._done_ns: int | None = None
        self._peak_kpa = 0.0
        self._joints: dict[int, NDArray[np.float64]] = {}
        self._last_command = NursingCommand(np.zeros(len(spec.joints)), self._program.state, None, "")
        self._requests = RequestQueue(keys, self.counters)
        self._published_state_s = -1e9
        self._published_state = ""
        self._record = StateRecorder(keys)
        self._log = hashlib.sha256()

    def start(self, put: Put) -> None:
        """Publish nothing; the first control period is at time zero."""

    @property
    def _finished(self) -> bool:
        return self._done_ns is not None and self._t_ns > self._done_ns + _HOLD_AFTER_DONE_NS

    def needs(self) -> dict[str, int] | None:
        """Return the watermarks due: joint feedback of this period, and board frames delivered before it."""
        if self._finished or self._t_ns >= self._max_ns:
            return None
        return {"body": self._t_ns, BOARD_PROCESS: self._t_ns}

    def due_ns(self) -> int:
        """Return the time of the next control period [ns]."""
        return self._t_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept joint feedback, contact regions of the boards or a user's request."""
        match channel:
            case "joints":
                joints = decode(payload, Joints)
                position = np.array(joints.position_rad, dtype=np.float64)
                if len(position) != self._clamp.n_dofs or not np.isfinite(position).all():
                    raise ProtocolError(f"joint feedback {position.tolist()}: {self._clamp.n_dofs} are due")
                self._joints[joints.t_ns] = position
                self._body.end_period(joints.watermark_ns)
            case "regions":
                regions = decode(payload, Regions)
                self._board_input.add(regions)
                self._boards.end_period(regions.watermark_ns)
            case "request":
                self._requests.add(fields[0], decode(payload, Request))
            case _:
                raise ProtocolError(f"the nursing program does not read {channel}")

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Ignore lost boards here; the program stops on `Event.SKIN_SILENT`."""

    def step(self, put: Put) -> None:
        """Run one control period."""
        t_ns = self._t_ns
        position = self._joints.pop(t_ns)
        self._requests.handle(t_ns, self._refuse)
        felt = self._board_input.latest_input(t_ns)
        if felt is not None:
            self._peak_kpa = max(self._peak_kpa, *(region.peak_kpa for region in felt.regions), 0.0)
        said = self._program.step(t_ns, position[self._column], felt)
        self._last_command = said
        if self._program.done and self._done_ns is None:
            self._done_ns = t_ns
        wanted = np.zeros(len(position))
        wanted[self._column] = said.velocity_rad_s
        velocity = self._clamp.clamp(t_ns, wanted, position, t_ns, t_ns)
        self._t_ns += self._period_ns
        effect_ns = t_ns + self._delay_ns
        command = Command(
            t_ns=t_ns,
            effect_ns=effect_ns,
            watermark_ns=FOREVER_NS if self._finished else effect_ns + self._period_ns,
            velocity_rad_s=velocity.tolist(),
            stage=said.state.value,
            end_ns=next_multiple(effect_ns, self._hyperperiod_ns) if self._finished else None,
        )
        if RECORDER in self.peers:
            machine = () if t_ns else ((self._state_machine_key, encode(describe_nursing(0))),)
            news = (*self._requests.pending_answers, *machine)
            self._record.tick(put, self._state(t_ns), news, last=self._finished)
        payload = encode(command)
        put(self._command_key, payload)
        self._log.update(position.tobytes())
        self._log.update(payload)

    def _refuse(self, _t_ns: int, _kind: str, _argument: str) -> Reply:
        return Reply(False, self._last_command.state.value, "the nursing program takes no requests")

    def best_effort_messages(self) -> list[tuple[str, bytes]]:
        """Publish request replies, and the state on change or by the wall clock; never part of the log."""
        news = self._requests.take_answers()
        if not self._published_state:
            news.append((self._state_machine_key, encode(describe_nursing(self._t_ns))))
        now_s, stage = time.monotonic(), self._last_command.state.value
        if (
            stage != self._published_state
            or self._finished
            or now_s - self._published_state_s >= _STATE_PERIOD_S
        ):
            self._published_state, self._published_state_s = stage, now_s
            news.append((self._state_key, encode(self._state(self._t_ns))))
        return news

    def _state(self, t_ns: int) -> ControllerState:
        stage, text = self._last_command.state.value, self._last_command.reason
        return ControllerState(t_ns=t_ns, stage=stage, progress=self._program.progress, text=text)

    def result(self) -> ProcessResult:
        """Return the facts of the program and the time series of every contact."""
        program = self._program
        facts: dict[str, Any] = {
            "logs": {"controller": self._log.hexdigest()},
            "done": program.done,
            "states": [(state.value, t_ns) for state, t_ns in program.state_history],
            "stages": [],
            "end_ns": self._t_ns,
            "reason": program.reason,
            "stopped_by": None if program.stopped_by is None else program.stopped_by.name.lower(),
            "safety": asdict(self._clamp.counters),
            "peak_kpa": self._peak_kpa,
            "received_frames": self._board_input.received_frames,
            "contacts": []
            if program.contact_series is None
            else [r._asdict() for r in program.contact_series.summarise()],
        }
        arrays = {} if program.contact_series is None else program.contact_series.arrays()
        return ProcessResult(self.name, "nursing", facts, arrays)


def _limits(deployment: Deployment) -> SafetyLimits:
    safety = deployment.controller.safety
    stale_ns = round(safety.input_timeout_ms * 1e6)
    return SafetyLimits(
        speed_rad_s=safety.max_joint_speed_rad_s,
        joints_max_age_ns=stale_ns,
        skin_max_age_ns=stale_ns,
        ramp_ns=round(safety.ramp_ms * 1e6),
    )
