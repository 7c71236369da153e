"""Controller process: the controller core connected to the channels of the loop."""

import hashlib
import time
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.brain import Brain, Tick
from controller.grasping.memory import LongTermMemory
from controller.grasping.report import session_facts
from controller.offers import Offers
from controller.outside import OutsideVelocity
from controller.patch_trace import PatchTrace
from controller.rehearsal import rehearse
from controller.requests import Requests
from controller.skin_input import SkinInput, SkinRows
from controller.state_record import StateRecord
from controller.trace import Trace
from skinnet.channels import RECORDER, Keys, Role
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.loop import Node, Put
from skinnet.messages import (
    FOREVER_NS,
    Command,
    Config,
    ControllerState,
    Events,
    Joints,
    Request,
    SkinFrame,
    Stream,
    Topology,
    decode,
    encode,
)
from skinnet.part import Part
from skinnet.upstream import Upstream

__all__ = ["ControllerNode", "build"]

_STATE_EVERY_S = 0.1


class ControllerNode:
    """Controller process, ticked by joint feedback on the skin data delivered before it."""

    role = Role.CONTROLLER.value
    paced = False

    def __init__(self, deployment: Deployment, name: str, sizes: dict[str, int]) -> None:
        self.name = name
        self._deployment = deployment
        keys = Keys(deployment.robot)
        self.subscriptions = (
            keys.of("joints"),
            *(keys.of(channel, "*") for channel in ("frame", "stream", "topology", "bundle")),
            keys.of("events", "*", "*"),
            keys.of("request", "*"),
            keys.of("velocity"),
        )
        hosts = deployment.host_patches()
        host_of = {patch: host for host, patches in hosts.items() for patch in patches}
        self._body = Upstream("body", "body", covered_ns=-1)
        self._patches = {patch: Upstream(patch, host_of[patch]) for patch in sizes}
        self.upstreams: Mapping[str, Upstream] = {"body": self._body, **self._patches}
        self.senders = frozenset({"body", *hosts})
        self.peers: frozenset[str] = frozenset({"body", name, *deployment.hosts_of_skin()})
        self.tolerated = frozenset(deployment.run.may_be_lost)
        if "cells" in self.tolerated:
            self.tolerated |= frozenset(hosts)
        self.counters: Counter[str] = Counter()
        self._keys = keys
        self._command_key = keys.of("command")
        self._period_ns = deployment.controller.period_ns
        self._delay_ns = deployment.controller.command_delay_ns
        self._frame_ns = deployment.frame_ns
        self._max_ns = deployment.max_ns
        self._patch_of_cell = [(patch, cell) for patch, n in sizes.items() for cell in range(n)]
        self._topologies: dict[str, deque[Topology]] = {patch: deque() for patch in sizes}
        self._formed: set[str] = set()
        self._brain = Brain(deployment.controller, SkinInput(sizes), len(self._patch_of_cell))
        self._n_dofs = len(deployment.body.joints)
        self._t_ns = 0
        self._finished = False
        self._joints: dict[int, NDArray[np.float64]] = {}
        self._requests = Requests(keys, self.counters)
        self._offers, self._offers_for_record = (Offers(keys, deployment.controller) for _ in range(2))
        allowed = deployment.controller.outside_velocity
        self._outside = OutsideVelocity(allowed, self._n_dofs, self.counters)
        self._state_s = -1e9
        self._told = ""
        self._record = StateRecord(keys)
        self._log = hashlib.sha256()
        self._trace = Trace()
        self._patch_trace = PatchTrace(sizes)

    def keep(self, base: Path, out: Path | None) -> None:
        """Load the deployment's memory from folder `base`, and store what is learnt in run folder `out`."""
        self._brain.memory = LongTermMemory.begin(self._deployment, base, out, self._brain.knowledge)

    def start(self, put: Put) -> None:
        """Send nothing: the first tick is at time zero."""

    def needs(self) -> dict[str, int] | None:
        """Require joint feedback of this tick, and every patch's watermark at its time."""
        if self._finished or self._t_ns >= self._max_ns:
            return None
        return {"body": self._t_ns} | dict.fromkeys(self._patches, self._t_ns)

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
            self._body.close(joints.covered_ns)
            return
        if channel == "request":
            self._requests.add(fields[0], decode(payload, Request))
            return
        if channel == "velocity":
            self._outside.take(self._t_ns, payload)
            return
        patch = self._patches.get(fields[0]) if fields else None
        if patch is None:
            raise ProtocolError(
                f"{channel} of patch {fields[0] if fields else '?'}, which is not in this run"
            )
        match channel:
            case "events" | "bundle":
                patch.arrive(self._brain.skin.add_events(patch.name, decode(payload, Events)))
            case "stream":
                stream = decode(payload, Stream)
                self._brain.skin.add_stream(patch.name, stream)
                patch.close(stream.covered_ns, stream.events)
            case "frame":
                frame = decode(payload, SkinFrame)
                patch.close(frame.covered_ns, frame.events)
            case "topology":
                topology = decode(payload, Topology)
                if len(topology.network_id) != len(self._brain.skin.cells(patch.name)):
                    raise ProtocolError(f"topology of {len(topology.network_id)} cells of {patch.name}")
                self._topologies[patch.name].append(topology)
                patch.arrive()
            case _:
                raise ProtocolError(f"the controller does not read {channel}")

    def lose(self, upstream: Upstream) -> None:
        """Set the cells of a lost patch to absent; the others continue."""
        self._brain.picture.set_found(self._brain.skin.cells(upstream.name), False)

    def step(self, put: Put) -> None:
        """Compute one tick: send stream configurations, the command and the recorded state."""
        t_ns = self._t_ns
        position = self._joints.pop(t_ns)
        self._see_topologies()
        self._log.update(self._requests.handle(t_ns, self._brain.ask))
        alive = [patch for patch in self._patches.values() if not patch.lost]
        ready = all(patch.name in self._formed for patch in alive)
        t_skin_ns = min((patch.covered_ns for patch in alive), default=t_ns)
        outside = self._outside.at(t_ns)
        if outside is not None:
            self._log.update(outside.tobytes())
        tick, events, stream = self._brain.tick(
            t_ns, position, t_ns, t_skin_ns, ready=ready, outside_rad_s=outside
        )
        self._finished = self._brain.done
        effect_ns = t_ns + self._delay_ns
        # not at once: a process already past this tick would wait for period ends that are never sent
        end_ns = next_multiple(effect_ns, self._frame_ns)
        configs = self._send_configs(put, tick, effect_ns)
        command = Command(
            t_ns=t_ns,
            effect_ns=effect_ns,
            covered_ns=FOREVER_NS if self._finished else effect_ns + self._period_ns,
            velocity_rad_s=tick.velocity_rad_s.tolist(),
            stage=self._brain.stage,
            configs=configs,
            end_ns=end_ns if self._finished else None,
        )
        if RECORDER in self.peers:
            offers = self._offers_for_record.news(self._brain.knowledge.poses, t_ns)
            news = (*self._requests.answers, *offers)
            self._record.tick(put, self._state(t_ns), news, last=self._finished)
        payload = encode(command)
        put(self._command_key, payload)
        self._note(position, events, stream, payload)
        self._trace.add(t_ns, tick.velocity_rad_s, self._brain.felt, (len(events.cell), len(stream.cell)))
        if self._brain.sessions:
            self._patch_trace.add(t_ns, self._brain.picture)
        self._t_ns += self._period_ns

    def _see_topologies(self) -> None:
        """Apply the topologies due by this tick; a cell process that is ahead sends them early."""
        for patch, waiting in self._topologies.items():
            while waiting and waiting[0].t_ns <= self._t_ns:
                present = np.array(waiting.popleft().network_id) > 0
                self._formed.add(patch)
                if not self._patches[patch].lost:
                    self._brain.see_cells(self._brain.skin.cells(patch), present)

    def _send_configs(self, put: Put, tick: Tick, effect_ns: int) -> dict[str, int]:
        counts: Counter[str] = Counter()
        for cells, stream in ((tick.streams_on, True), (tick.streams_off, False)):
            for index in cells.tolist():
                patch, cell = self._patch_of_cell[index]
                config = Config(patch=patch, cell=cell, t_ns=effect_ns, stream=stream)
                put(self._keys.of("config", patch, cell), encode(config))
                counts[patch] += 1
        return dict(counts)

    def _note(
        self, position: NDArray[np.float64], events: SkinRows, stream: SkinRows, command: bytes
    ) -> None:
        """Add the tick's ordered inputs and its command to the log hash."""
        log = self._log
        log.update(position.tobytes())
        for column in (*events, *stream):
            log.update(column.data)
        log.update(command)

    def news(self) -> list[tuple[str, bytes]]:
        """Return answers, capabilities, and the state on change or by wall clock; never in the log."""
        brain, now_s = self._brain, time.monotonic()
        news = self._requests.news()
        news += self._offers.news(brain.knowledge.poses, self._t_ns)
        if brain.state != self._told or self._finished or now_s - self._state_s >= _STATE_EVERY_S:
            self._told, self._state_s = brain.state, now_s
            news.append((self._keys.of("state"), encode(self._state(self._t_ns))))
        return news

    def _state(self, t_ns: int) -> ControllerState:
        brain = self._brain
        return ControllerState(t_ns=t_ns, stage=brain.state, progress=brain.progress, text=brain.why)

    def result(self) -> Part:
        """Return the self-model, and the traces of tactile input and commands."""
        brain, knowledge = self._brain, self._brain.knowledge
        brain.memory.close()
        facts: dict[str, Any] = {
            "logs": {"controller": self._log.hexdigest()},
            "done": brain.done,
            "stages": brain.stage_log,
            "end_ns": self._t_ns,
            "rejected": brain.picture.rejected,
            "asked_again": brain.asked_again,
            "received_packets": brain.skin.received,
            "missing_packets": brain.skin.gaps,
            "cells": self._patch_of_cell,
            "command_delay_ns": self._delay_ns,
            "requests": self._requests.log,
        }
        explored, arrays = knowledge.result()
        facts |= explored
        arrays |= self._trace.arrays() | {"drives": brain.drives.rows}
        if brain.sessions:
            arrays |= self._patch_trace.arrays()
            facts |= session_facts(brain.sessions, knowledge)
        if brain.safety is not None:
            facts["safety"] = asdict(brain.safety.counters)
        return Part(self.name, self.role, facts, arrays)


def build(deployment: Deployment, name: str, base: Path, out: Path | None) -> Node:
    """Build the controller process of `deployment`; it knows the patches and their cell counts only."""
    if deployment.nursing is not None:
        from controller.nursing.process import NursingNode  # brings MuJoCo with it

        return NursingNode(deployment, name, base)
    rehearse(deployment)
    sizes = {patch.name: patch.n_cells for patch in deployment.patches}
    node = ControllerNode(deployment, name, sizes)
    node.keep(base, out)
    return node
