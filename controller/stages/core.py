"""Decision core of a program of stages: the controller connected to the events and readings of the cells."""

from collections import deque
from collections.abc import Hashable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.cell_input import CellInput
from controller.controller import Controller, TickOutput
from controller.decision_core import Decision, StreamRequest
from controller.grasping.long_term_memory import LongTermMemory
from controller.grasping.stage_facts import teach_and_grasp_facts
from controller.inputs import JointMeasurement
from controller.request_queue import Reply
from controller.telemetry import PatchTrace, RunTrace, describe_program
from controller.touch.tactile_state import LevelThresholds
from skinnet.deployment import Deployment
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import STREAM_ROW, Events, PeriodEnd, Stream, Topology, decode
from skinnet.protocol.telemetry_messages import StateMachineDescription
from skinnet.runtime.upstream import Upstream

__all__ = ["StageCore", "build_stage_core"]


class StageCore:
    """Decision core of a program of stages.

    It begins the program once the network of every patch that is not lost has formed.

    Args:
        spec: Program, stages and limits.
        cell_counts: Number of cells of each patch, by name, in order.
        cells: Specification of the cells, for the thresholds of their levels; None if it is not known.
        dof_names: (D,) names of the DoFs for messages; their numbers unless given.
    """

    result_role = "controller"

    def __init__(
        self,
        spec: ControllerSpec,
        cell_counts: dict[str, int],
        cells: CellSpec | None = None,
        *,
        dof_names: Sequence[str] = (),
    ) -> None:
        self._spec = spec
        self._cells = [(patch, cell) for patch, n_cells in cell_counts.items() for cell in range(n_cells)]
        self.controller = Controller(
            spec,
            CellInput(cell_counts),
            len(self._cells),
            None if cells is None else LevelThresholds.from_spec(cells),
            dof_names=dof_names,
            cell_names=[f"{patch}/{cell}" for patch, cell in self._cells],
        )
        self._cell_input = self.controller.cell_input
        self._topologies: dict[str, deque[Topology]] = {patch: deque() for patch in cell_counts}
        self._unformed_patches = set(cell_counts)
        self._lost_patches: set[str] = set()
        self._trace = RunTrace()
        self._patch_trace = PatchTrace(cell_counts)

    @property
    def stage(self) -> str:
        """Name of the current stage, with its state if it has states; empty before the first."""
        return self.controller.stage

    @property
    def state(self) -> str:
        """State as published: the current stage, or that the network is forming."""
        return self.controller.state

    @property
    def progress(self) -> float:
        """Completed fraction of the current stage, 0 to 1."""
        return self.controller.progress

    @property
    def reason(self) -> str:
        """Event that led to the state of the current stage; empty without one."""
        return self.controller.reason

    @property
    def done(self) -> bool:
        """True once the program of stages is complete."""
        return self.controller.done

    @property
    def capabilities_key(self) -> Hashable:
        """Names of the known poses: requests may name them."""
        return tuple(self.controller.self_model.poses)

    def describe(self, t_ns: int) -> StateMachineDescription:
        """Describe the stages, their transitions, and the requests with the poses known at `t_ns`."""
        return describe_program(self._spec, self.controller.self_model.poses, t_ns)

    def accept(self, channel: str, upstream: Upstream, payload: bytes) -> None:
        """Accept events, full readings, a period end or a topology of a patch.

        Raises:
            ProtocolError: another channel, or a message that does not fit the patch.
        """
        patch = upstream.name
        match channel:
            case "events" | "bundle":
                upstream.count_arrivals(self._cell_input.add_events(patch, decode(payload, Events)))
            case "stream":
                stream = decode(payload, Stream)
                self._cell_input.add_stream(patch, stream)
                upstream.end_period(stream.watermark_ns, stream.n_events)
            case "period_end":
                period_end = decode(payload, PeriodEnd)
                upstream.end_period(period_end.watermark_ns, period_end.n_events)
            case "topology":
                topology = decode(payload, Topology)
                if len(topology.network_id) != len(self._cell_input.cells(patch)):
                    raise ProtocolError(f"topology of {len(topology.network_id)} cells of {patch}")
                self._topologies[patch].append(topology)
                upstream.count_arrivals()
            case _:
                raise ProtocolError(f"the controller does not subscribe to channel {channel}")

    def set_joint_ranges(self, range_rad: NDArray[np.float64]) -> None:
        """Set the position limits (D, 2), within which the explorations move."""
        self.controller.range_rad = range_rad

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Set the cells of a lost patch to absent; the others continue."""
        self._lost_patches.add(upstream.name)
        self.controller.tactile_state.set_present(self._cell_input.cells(upstream.name), False)

    def update_skin(self, t_ns: int) -> None:
        """Apply the topologies due by `t_ns`; a cell process that is ahead sends them early."""
        for patch, waiting in self._topologies.items():
            while waiting and waiting[0].t_ns <= t_ns:
                present = np.array(waiting.popleft().network_id) > 0
                self._unformed_patches.discard(patch)
                if patch not in self._lost_patches:
                    self.controller.update_presence(self._cell_input.cells(patch), present)

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Pass a request to the current stage, or refuse it."""
        return self.controller.handle_request(t_ns, name, argument)

    def tick(
        self,
        t_ns: int,
        joints: JointMeasurement,
        skin_watermark_ns: int,
        external_rad_s: NDArray[np.float64] | None,
    ) -> Decision:
        """Compute one control period of the current stage."""
        output, events, stream = self.controller.tick(
            t_ns,
            joints.position_rad,
            joints.t_ns,
            skin_watermark_ns,
            ready=self._unformed_patches <= self._lost_patches,
            external_rad_s=external_rad_s,
        )
        input_counts = (len(events.cell), len(stream.cell))
        self._trace.add(t_ns, output.velocity_rad_s, self.controller.tactile_input, input_counts)
        if self.controller.teach_and_grasp_stages:
            self._patch_trace.add(t_ns, self.controller.tactile_state)
        return Decision(output.velocity_rad_s, self._stream_requests(output), (*events, *stream))

    def _stream_requests(self, output: TickOutput) -> list[StreamRequest]:
        return [
            StreamRequest(patch, cell, stream)
            for cells, stream in ((output.streams_on, True), (output.streams_off, False))
            for patch, cell in (self._cells[index] for index in cells.tolist())
        ]

    def result(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the self-model, and the traces of tactile input and commands; close the memory."""
        controller = self.controller
        controller.memory.close()
        explored, arrays = controller.self_model.result()
        facts: dict[str, Any] = {
            "done": controller.done,
            "stages": controller.stage_log,
            "rejected": controller.tactile_state.rejected,
            "repeated_stream_requests": controller.repeated_stream_requests,
            "missed_level_events": controller.tactile_state.missed_level_events,
            "received_packets": self._cell_input.received,
            "missing_packets": self._cell_input.missing,
            "cells": self._cells,
            **explored,
        }
        arrays |= self._trace.arrays() | {"reaction_log": controller.reaction_log.rows}
        if controller.teach_and_grasp_stages:
            arrays |= self._patch_trace.arrays()
            facts |= teach_and_grasp_facts(controller.teach_and_grasp_stages, controller.self_model)
        if controller.safety_clamp is not None:
            facts["safety"] = asdict(controller.safety_clamp.counters)
        return facts, arrays


def build_stage_core(deployment: Deployment, base: Path, out: Path | None) -> StageCore:
    """Build the core of `deployment` with its memory; it knows the patches and their cell counts only.

    Args:
        deployment: Deployment of the run.
        base: Folder of the deployment, in which its memory is read.
        out: Run folder, in which the memory is stored; None to store nothing.

    Raises:
        MemoryFileError: the file that the deployment names is invalid or of another robot.
    """
    _warm_up(deployment)
    cell_counts = {patch.name: patch.n_cells for patch in deployment.patches}
    core = StageCore(deployment.controller, cell_counts, deployment.cells, dof_names=deployment.body.joints)
    core.controller.memory = LongTermMemory.open(deployment, base, out, core.controller.self_model)
    return core


def _warm_up(deployment: Deployment) -> None:
    """Call the compiled functions once: loading their code takes half a second."""
    cell_input = CellInput({"none": 1})
    one = [0]
    events = Events(
        patch="none", gateway=0, cell=one, t_sampled_ns=one, t_delivered_ns=one, seq=one,
        modality=one, channel=one, kind=one, level=one, value=[0.0],
    )  # fmt: skip
    cell_input.add_events("none", events)
    rows = np.zeros(1, dtype=STREAM_ROW).tobytes()
    cell_input.add_stream("none", Stream(patch="none", t_ns=0, watermark_ns=0, n_events=0, rows=rows))
    still = np.zeros(len(deployment.body.joints))
    Controller(deployment.controller, cell_input, 1).tick(1, still, 1, 1, ready=False)
