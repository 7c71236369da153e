"""Controller process: the controller core connected to the channels of the loop."""

import hashlib
import time
from collections import Counter, deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.capabilities import Capabilities
from controller.cell_input import CellInput, CellRows
from controller.controller import Controller, TickOutput
from controller.external_velocity import ExternalVelocityInput
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.stage_facts import teach_and_grasp_facts
from controller.patch_trace import PatchTrace
from controller.request_queue import RequestQueue
from controller.run_trace import RunTrace
from controller.state_recorder import StateRecorder
from controller.warm_up import warm_up
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import BODY, Keys
from skinnet.protocol.messages import (
    FOREVER_NS,
    Command,
    Config,
    ControllerState,
    Events,
    Joints,
    PeriodEnd,
    Request,
    Stream,
    Topology,
    decode,
    encode,
)
from skinnet.runtime.loop import LogicalProcess, Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of

__all__ = ["ControllerProcess", "build"]

_STATE_PERIOD_S = 0.1


class ControllerProcess(WiredProcess):
    """Controller process, ticked by joint feedback on the skin data delivered before it."""

    def __init__(
        self, deployment: Deployment, name: str, cell_counts: dict[str, int], *, recorded: bool = False
    ) -> None:
        super().__init__(wiring_of(deployment, name, recorded=recorded))
        self._deployment = deployment
        keys = Keys(deployment.robot)
        self._body_upstream = self.upstreams[BODY]
        self._patch_upstreams = {patch: self.upstreams[patch] for patch in cell_counts}
        self._keys = keys
        self._command_key = keys.of("command")
        self._period_ns = deployment.controller.period_ns
        self._delay_ns = deployment.controller.command_delay_ns
        self._skin_period_ns = deployment.hyperperiod_ns
        self._max_ns = deployment.max_duration_ns
        self._patch_of_cell = [(patch, cell) for patch, n in cell_counts.items() for cell in range(n)]
        self._topologies: dict[str, deque[Topology]] = {patch: deque() for patch in cell_counts}
        self._formed_patches: set[str] = set()
        self._controller = Controller(deployment.controller, CellInput(cell_counts), len(self._patch_of_cell))
        self._n_dofs = len(deployment.body.joints)
        self._t_ns = 0
        self._finished = False
        self._joints: dict[int, NDArray[np.float64]] = {}
        self._request_queue = RequestQueue(keys, self.counters)
        self._capabilities, self._recorded_capabilities = (
            Capabilities(keys, deployment.controller) for _ in range(2)
        )
        allowed = deployment.controller.external_velocity
        self._external_velocity = ExternalVelocityInput(allowed, self._n_dofs, self.counters)
        self._last_state_s = -1e9
        self._published_state = ""
        self._state_recorder = StateRecorder(keys)
        self._log_hash = hashlib.sha256()
        self._trace = RunTrace()
        self._patch_trace = PatchTrace(cell_counts)

    def load_memory(self, base: Path, out: Path | None) -> None:
        """Load the deployment's memory from folder `base`, and store what is learnt in run folder `out`."""
        self._controller.memory = LongTermMemory.open(
            self._deployment, base, out, self._controller.self_model
        )

    def start(self, put: Put) -> None:
        """Send nothing: the first tick is at time zero."""

    def needs(self) -> dict[str, int] | None:
        """Require joint feedback of this tick, and every patch's watermark at its time."""
        if self._finished or self._t_ns >= self._max_ns:
            return None
        return {BODY: self._t_ns} | dict.fromkeys(self._patch_upstreams, self._t_ns)

    def due_ns(self) -> int:
        """Return the time of the next tick."""
        return self._t_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept joint feedback, skin data, a request or an external velocity.

        Raises:
            ProtocolError: the message does not fit this run.
        """
        if channel == "joints":
            joints = decode(payload, Joints)
            position = np.array(joints.position_rad, dtype=np.float64)
            if len(position) != self._n_dofs:
                raise ProtocolError(f"positions of {len(position)} joints; this run has {self._n_dofs}")
            if not np.isfinite(position).all():
                raise ProtocolError("joint positions that are not finite")
            self._joints[joints.t_ns] = position
            self._body_upstream.end_period(joints.watermark_ns)
            return
        if channel == "request":
            self._request_queue.add(fields[0], decode(payload, Request))
            return
        if channel == "velocity":
            self._external_velocity.accept(self._t_ns, payload)
            return
        patch = self._patch_upstreams.get(fields[0]) if fields else None
        if patch is None:
            raise ProtocolError(
                f"{channel} of patch {fields[0] if fields else '?'}, which is not in this run"
            )
        match channel:
            case "events" | "bundle":
                patch.count_arrivals(
                    self._controller.cell_input.add_events(patch.name, decode(payload, Events))
                )
            case "stream":
                stream = decode(payload, Stream)
                self._controller.cell_input.add_stream(patch.name, stream)
                patch.end_period(stream.watermark_ns, stream.n_events)
            case "period_end":
                frame = decode(payload, PeriodEnd)
                patch.end_period(frame.watermark_ns, frame.n_events)
            case "topology":
                topology = decode(payload, Topology)
                if len(topology.network_id) != len(self._controller.cell_input.cells(patch.name)):
                    raise ProtocolError(f"topology of {len(topology.network_id)} cells of {patch.name}")
                self._topologies[patch.name].append(topology)
                patch.count_arrivals()
            case _:
                raise ProtocolError(f"the controller does not read {channel}")

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Set the cells of a lost patch to absent; the others continue."""
        self._controller.tactile_state.set_present(self._controller.cell_input.cells(upstream.name), False)

    def step(self, put: Put) -> None:
        """Compute one tick: send stream configurations, the command and the recorded state."""
        t_ns = self._t_ns
        position = self._joints.pop(t_ns)
        self._apply_topologies()
        self._log_hash.update(self._request_queue.handle(t_ns, self._controller.handle_request))
        alive = [patch for patch in self._patch_upstreams.values() if not patch.lost]
        ready = all(patch.name in self._formed_patches for patch in alive)
        t_skin_ns = min((patch.watermark_ns for patch in alive), default=t_ns)
        outside = self._external_velocity.at(t_ns)
        if outside is not None:
            self._log_hash.update(outside.tobytes())
        tick, events, stream = self._controller.tick(
            t_ns, position, t_ns, t_skin_ns, ready=ready, external_rad_s=outside
        )
        self._finished = self._controller.done
        effect_ns = t_ns + self._delay_ns
        # not at once: a process already past this tick would wait for period ends that are never sent
        end_ns = next_multiple(effect_ns, self._skin_period_ns)
        configs = self._send_configs(put, tick, effect_ns)
        command = Command(
            t_ns=t_ns,
            effect_ns=effect_ns,
            watermark_ns=FOREVER_NS if self._finished else effect_ns + self._period_ns,
            velocity_rad_s=tick.velocity_rad_s.tolist(),
            stage=self._controller.stage,
            config_counts=configs,
            end_ns=end_ns if self._finished else None,
        )
        if self.recorded:
            offers = self._recorded_capabilities.publish_if_changed(self._controller.self_model.poses, t_ns)
            news = (*self._request_queue.pending_answers, *offers)
            self._state_recorder.tick(put, self._state(t_ns), news, last=self._finished)
        payload = encode(command)
        put(self._command_key, payload)
        self._update_log_hash(position, events, stream, payload)
        self._trace.add(
            t_ns, tick.velocity_rad_s, self._controller.tactile_input, (len(events.cell), len(stream.cell))
        )
        if self._controller.teach_and_grasp_stages:
            self._patch_trace.add(t_ns, self._controller.tactile_state)
        self._t_ns += self._period_ns

    def _apply_topologies(self) -> None:
        """Apply the topologies due by this tick; a cell process that is ahead sends them early."""
        for patch, waiting in self._topologies.items():
            while waiting and waiting[0].t_ns <= self._t_ns:
                present = np.array(waiting.popleft().network_id) > 0
                self._formed_patches.add(patch)
                if not self._patch_upstreams[patch].lost:
                    self._controller.update_presence(self._controller.cell_input.cells(patch), present)

    def _send_configs(self, put: Put, tick: TickOutput, effect_ns: int) -> dict[str, int]:
        counts: Counter[str] = Counter()
        for cells, stream in ((tick.streams_on, True), (tick.streams_off, False)):
            for index in cells.tolist():
                patch, cell = self._patch_of_cell[index]
                config = Config(patch=patch, cell=cell, t_ns=effect_ns, stream=stream)
                put(self._keys.of("config", patch, cell), encode(config))
                counts[patch] += 1
        return dict(counts)

    def _update_log_hash(
        self, position: NDArray[np.float64], events: CellRows, stream: CellRows, command: bytes
    ) -> None:
        """Add the tick's ordered inputs and its command to the log hash."""
        log = self._log_hash
        log.update(position.tobytes())
        for column in (*events, *stream):
            log.update(column.data)
        log.update(command)

    def best_effort_messages(self) -> list[tuple[str, bytes]]:
        """Return answers, capabilities, and the state on change or by wall clock; never in the log."""
        brain, now_s = self._controller, time.monotonic()
        news = self._request_queue.take_answers()
        news += self._capabilities.publish_if_changed(brain.self_model.poses, self._t_ns)
        if (
            brain.state != self._published_state
            or self._finished
            or now_s - self._last_state_s >= _STATE_PERIOD_S
        ):
            self._published_state, self._last_state_s = brain.state, now_s
            news.append((self._keys.of("state"), encode(self._state(self._t_ns))))
        return news

    def _state(self, t_ns: int) -> ControllerState:
        brain = self._controller
        return ControllerState(t_ns=t_ns, stage=brain.state, progress=brain.progress, text=brain.reason)

    def result(self) -> ProcessResult:
        """Return the self-model, and the traces of tactile input and commands."""
        brain, knowledge = self._controller, self._controller.self_model
        brain.memory.close()
        facts: dict[str, Any] = {
            "logs": {"controller": self._log_hash.hexdigest()},
            "done": brain.done,
            "stages": brain.stage_log,
            "end_ns": self._t_ns,
            "rejected": brain.tactile_state.rejected,
            "repeated_stream_requests": brain.repeated_stream_requests,
            "received_packets": brain.cell_input.received,
            "missing_packets": brain.cell_input.missing,
            "cells": self._patch_of_cell,
            "command_delay_ns": self._delay_ns,
            "requests": self._request_queue.log,
        }
        explored, arrays = knowledge.result()
        facts |= explored
        arrays |= self._trace.arrays() | {"reaction_log": brain.reaction_log.rows}
        if brain.teach_and_grasp_stages:
            arrays |= self._patch_trace.arrays()
            facts |= teach_and_grasp_facts(brain.teach_and_grasp_stages, knowledge)
        if brain.safety_clamp is not None:
            facts["safety"] = asdict(brain.safety_clamp.counters)
        return ProcessResult(self.name, self.role, facts, arrays)


def build(
    deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
) -> LogicalProcess:
    """Build the controller process of `deployment`; it knows the patches and their cell counts only."""
    if deployment.nursing is not None:
        from controller.nursing.process import NursingProcess  # brings MuJoCo with it

        return NursingProcess(deployment, name, base, recorded=recorded)
    warm_up(deployment)
    sizes = {patch.name: patch.n_cells for patch in deployment.patches}
    node = ControllerProcess(deployment, name, sizes, recorded=recorded)
    node.load_memory(base, out)
    return node
