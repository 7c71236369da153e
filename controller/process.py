"""Controller process: a decision core between the channels of the loop."""

import hashlib
from collections import Counter
from pathlib import Path

from controller.decision_core import DecisionCore, StreamRequest
from controller.inputs import ExternalVelocityInput, JointInput, decode_joint_ranges
from controller.request_queue import RequestQueue
from controller.stages.core import build_stage_core
from controller.telemetry import StatePublisher, simulated_clock_ns, wall_clock_ns
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.pinned_loading import load_pinned_functions
from skinnet.protocol.channels import BODY, Keys
from skinnet.protocol.messages import FOREVER_NS, Command, Config, Request, decode, encode
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of

__all__ = ["ControllerProcess", "build"]


class ControllerProcess(WiredProcess):
    """Controller process, ticked by joint feedback on the skin data delivered before it.

    Args:
        deployment: Deployment of the run.
        name: Process name.
        core: Decision core.
        recorded: A recorder takes part in the run.
    """

    def __init__(
        self, deployment: Deployment, name: str, core: DecisionCore, *, recorded: bool = False
    ) -> None:
        super().__init__(wiring_of(deployment, name, recorded=recorded))
        self._core = core
        self._skin = dict(self.upstreams)
        self._body = self._skin.pop(BODY)
        control, n_dofs = deployment.controller, len(deployment.body.joints)
        self._period_ns, self._delay_ns = control.period_ns, control.command_delay_ns
        self._hyperperiod_ns, self._max_ns = deployment.hyperperiod_ns, deployment.max_duration_ns
        self._t_ns = 0
        self._finished = False
        self._keys = keys = Keys(deployment.robot)
        self._command_key = keys.of("command")
        self._n_dofs = n_dofs
        self._joint_input = JointInput(n_dofs)
        self._request_queue = RequestQueue(keys, self.counters)
        self._external_velocity = ExternalVelocityInput(control.external_velocity, n_dofs, self.counters)
        self._observed_state = StatePublisher(keys, core, wall_clock_ns)
        self._recorded_state = StatePublisher(keys, core, simulated_clock_ns)
        self._log_hash = hashlib.sha256()

    def start(self, put: Put) -> None:
        """Send nothing: the first tick is at time zero."""

    def needs(self) -> dict[str, int] | None:
        """Require joint feedback of this tick, and the watermark of all skin at its time."""
        if self._finished or self._t_ns >= self._max_ns:
            return None
        return dict.fromkeys(self.upstreams, self._t_ns)

    def due_ns(self) -> int:
        """Return the time of the next tick [ns]."""
        return self._t_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept joint ranges, joint feedback, skin data, a request or an external velocity.

        Raises:
            ProtocolError: the message does not fit this run.
        """
        match channel:
            case "joints":
                self._body.end_period(self._joint_input.accept(payload))
            case "joint_ranges":
                self._core.set_joint_ranges(decode_joint_ranges(payload, self._n_dofs))
            case "request":
                self._request_queue.add(fields[0], decode(payload, Request))
            case "velocity":
                self._external_velocity.accept(self._t_ns, payload)
            case _:
                source = fields[0] if fields else "?"
                upstream = self._skin.get(source)
                if upstream is None:
                    raise ProtocolError(f"{channel} of {source}, whose skin the controller does not read")
                self._core.accept(channel, upstream, payload)

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Pass the loss to the decision core."""
        self._core.on_upstream_lost(upstream)

    def step(self, put: Put) -> None:
        """Compute one tick: send stream configurations, the recorded state and the command."""
        t_ns, core, log = self._t_ns, self._core, self._log_hash
        joints = self._joint_input.latest(t_ns)
        core.update_skin(t_ns)
        log.update(self._request_queue.handle(t_ns, core.handle_request))
        external = self._external_velocity.at(t_ns)
        if external is not None:
            log.update(external.tobytes())
        watermark_ns = min((up.watermark_ns for up in self._skin.values() if not up.lost), default=t_ns)
        decision = core.tick(t_ns, joints, watermark_ns, external)
        self._finished = core.done
        config_counts = self._send_configs(put, decision.stream_requests, t_ns + self._delay_ns)
        if self.recorded:
            state = self._recorded_state.messages(t_ns, last=self._finished)
            for key, payload in (*self._request_queue.pending_answers, *state):
                put(key, payload)
        command = encode(self._command(decision.velocity_rad_s.tolist(), config_counts))
        put(self._command_key, command)
        log.update(joints.position_rad.tobytes())
        for column in decision.skin_data:
            log.update(column.data)
        log.update(command)
        self._t_ns += self._period_ns

    def _command(self, velocity_rad_s: list[float], config_counts: dict[str, int]) -> Command:
        effect_ns = self._t_ns + self._delay_ns
        # not at once: a process already past this tick would wait for period ends that are never sent
        end_ns = next_multiple(effect_ns, self._hyperperiod_ns) if self._finished else None
        return Command(
            t_ns=self._t_ns,
            effect_ns=effect_ns,
            watermark_ns=FOREVER_NS if self._finished else effect_ns + self._period_ns,
            velocity_rad_s=velocity_rad_s,
            stage=self._core.stage,
            config_counts=config_counts,
            end_ns=end_ns,
        )

    def _send_configs(self, put: Put, requests: list[StreamRequest], effect_ns: int) -> dict[str, int]:
        """Send the stream requests of a tick; return their number by patch."""
        counts: Counter[str] = Counter()
        for patch, cell, stream in requests:
            config = Config(patch=patch, cell=cell, t_ns=effect_ns, stream=stream)
            put(self._keys.of("config", patch, cell), encode(config))
            counts[patch] += 1
        return dict(counts)

    def best_effort_messages(self) -> list[tuple[str, bytes]]:
        """Return answers, capabilities, and the state on change or by wall clock; never in the log."""
        state = self._observed_state.messages(self._t_ns, last=self._finished)
        return self._request_queue.take_answers() + state

    def result(self) -> ProcessResult:
        """Return the result of the decision core, with the log hash and the handled requests."""
        facts, arrays = self._core.result()
        facts |= {
            "logs": {"controller": self._log_hash.hexdigest()},
            "end_ns": self._t_ns,
            "command_delay_ns": self._delay_ns,
            "requests": self._request_queue.log,
        }
        return ProcessResult(self.name, self._core.result_role, facts, arrays)


def build(
    deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
) -> ControllerProcess:
    """Build the controller process of `deployment`, with the decision core of its program."""
    load_pinned_functions()
    core: DecisionCore
    if deployment.nursing is None:
        core = build_stage_core(deployment, base, out)
    else:
        from controller.nursing.core import build_nursing_core  # brings MuJoCo with it

        core = build_nursing_core(deployment, deployment.nursing, base)
    return ControllerProcess(deployment, name, core, recorded=recorded)
