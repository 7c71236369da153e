"""Body process: steps the plant between commands received and stimuli and joints published."""

import hashlib
import math
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.body.plant import Plant as BodyWorld
from skinnet.body.scripted.scripted_body import ScriptedBody
from skinnet.body.simulation import BodySimulation
from skinnet.clock import next_multiple
from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError
from skinnet.pinned_loading import load_pinned_functions
from skinnet.protocol.channels import CONTROLLER, Keys
from skinnet.protocol.messages import Command, JointRanges, Joints, Stimulus, decode, encode
from skinnet.protocol.recorded_messages import FreeBodyPoses
from skinnet.protocol.sheet_messages import Pressures
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of

__all__ = ["BodyProcess", "build"]


class BodyProcess(WiredProcess):
    """Logical process of the body: steps the plant from event to event (publications, command effects).

    A command is in effect from its `effect_ns` until the next one's. In lockstep the body waits for every
    command; in real time it continues with the newest one, and the loop counts a deadline miss.
    """

    follows_wall_clock = True

    def __init__(
        self, deployment: Deployment, name: str, plant: BodyWorld, *, recorded: bool = False
    ) -> None:
        super().__init__(wiring_of(deployment, name, recorded=recorded))
        keys = Keys(deployment.robot)
        control = deployment.controller
        self._controller = self.upstreams[CONTROLLER]
        hosts = deployment.patches_by_process()
        self._plant = plant
        self._stimulus_ns, self._joints_ns = (
            deployment.body.stimulus_period_ns,
            deployment.body.joint_state_period_ns,
        )
        self._control_ns, self._delay_ns = control.period_ns, control.command_delay_ns
        self._end_ns = deployment.max_duration_ns
        self._pending: deque[Command] = deque()
        self._config_counts: Counter[str] = Counter()
        self._end_commanded = False
        self._patches = hosts
        self._stage = ""
        self._joint_ranges_key = keys.of("joint_ranges")
        self._joints_key = keys.of("joints")
        self._free_bodies_key = keys.of("free_bodies")
        self._has_subscribers: Callable[[str], bool] = _no_subscribers
        self._pressures_key = keys.of("pressures") if deployment.sheets else None
        self._stimulus_outputs = [
            (host, keys.of("stimulus", host), np.concatenate([self._rows(patch) for patch in patches]))
            for host, patches in hosts.items()
        ]
        self._start_s = 0.0
        self._digest = hashlib.sha256()
        self._trace_t_ns: list[int] = []
        self._trace_rad: list[NDArray[np.float64]] = []
        self._commands_ns: list[tuple[int, int]] = []

    def _rows(self, patch: str) -> NDArray[np.int64]:
        cells = self._plant.cells[patch]
        return np.arange(cells.start, cells.stop, dtype=np.int64)

    def use_subscriber_check(self, has_subscribers: Callable[[str], bool]) -> None:
        """Set the subscriber query: free-body poses are published while they have subscribers."""
        self._has_subscribers = has_subscribers

    def start(self, put: Put) -> None:
        """Publish joint ranges, and stimuli and joint positions of time zero."""
        self._start_s = time.monotonic()
        lowest_rad, highest_rad = self._plant.range_rad.T.tolist()
        ranges = JointRanges(lowest_rad=lowest_rad, highest_rad=highest_rad)
        put(self._joint_ranges_key, encode(ranges))
        self._publish(put)

    def needs(self) -> dict[str, int] | None:
        """Required watermark [ns] of the controller for the next step; None at the end of the run."""
        if self._plant.t_ns >= self._end_ns:
            return None
        return {CONTROLLER: self.due_ns()}

    def due_ns(self) -> int:
        """Time [ns] of the next event: a publication, a command's effect, or the end of the run."""
        t_ns = self._plant.t_ns
        return min(
            next_multiple(t_ns, self._stimulus_ns),
            next_multiple(t_ns, self._joints_ns),
            next_multiple(t_ns, self._control_ns, self._delay_ns),
            self._end_ns,
        )

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept a command.

        Raises:
            ProtocolError: another channel, a command of the wrong size, or non-finite velocities.
        """
        if channel != "command":
            raise ProtocolError(f"the body does not subscribe to {channel}")
        command = decode(payload, Command)
        n_dofs = self._plant.n_dofs
        if len(command.velocity_rad_s) != n_dofs:
            raise ProtocolError(
                f"command has {len(command.velocity_rad_s)} velocities, must have {n_dofs}, one per joint "
                "of body.joints"
            )
        if not all(map(math.isfinite, command.velocity_rad_s)):
            raise ProtocolError(f"command with velocities {command.velocity_rad_s}: must be finite")
        self._pending.append(command)
        self._controller.end_period(command.watermark_ns)

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Handle loss of the controller: command zero velocity."""
        self._pending.clear()
        self._plant.set_command(np.zeros(self._plant.n_dofs))

    def step(self, put: Put) -> None:
        """Advance the plant to the next event and publish what is due there."""
        t_end_ns = self.due_ns()
        self._apply_commands()
        self._plant.advance(t_end_ns)
        self._publish(put)

    def _apply_commands(self) -> None:
        t_ns = self._plant.t_ns
        while self._pending and self._pending[0].effect_ns <= t_ns:
            command = self._pending.popleft()
            self._plant.set_command(np.array(command.velocity_rad_s))
            self._commands_ns.append((command.t_ns, t_ns))
            if command.stage != self._stage:
                self._stage = command.stage
                self._plant.begin_stage(command.stage)
            self._config_counts.update(command.config_counts)
            if command.end_ns is not None:
                self._end_ns, self._end_commanded = min(self._end_ns, command.end_ns), True

    def _publish(self, put: Put) -> None:
        t_ns = self._plant.t_ns
        if t_ns % self._stimulus_ns == 0:
            stimulus = self._plant.stimulus()
            felt = stimulus.astype("<f4")
            end_ns = self._end_ns if self._end_commanded else None
            for host, key, rows in self._stimulus_outputs:
                values = felt[rows].tobytes()
                configs = self._pop_config_count(host) if self._config_counts else 0
                frame = Stimulus(
                    process=host,
                    t_ns=t_ns,
                    watermark_ns=t_ns,
                    values=values,
                    n_configs=configs,
                    end_ns=end_ns,
                )
                put(key, encode(frame))
            self._digest.update(felt.tobytes())
            if self._pressures_key is not None:
                values = self._plant.pressures().astype("<f4").tobytes()
                pressures = Pressures(t_ns=t_ns, watermark_ns=t_ns, values=values, end_ns=end_ns)
                put(self._pressures_key, encode(pressures))
                self._digest.update(values)
        if t_ns % self._joints_ns == 0:
            if self.recorded or self._has_subscribers(self._free_bodies_key):
                poses = self._plant.free_bodies()
                if poses:
                    put(
                        self._free_bodies_key,
                        encode(FreeBodyPoses(t_ns=t_ns, watermark_ns=t_ns, poses=poses)),
                    )
            position = self._plant.joints()
            joints = Joints(t_ns=t_ns, watermark_ns=t_ns, position_rad=position.tolist())
            put(self._joints_key, encode(joints))
            self._trace_t_ns.append(t_ns)
            self._trace_rad.append(position)
            self._digest.update(position.tobytes())

    def _pop_config_count(self, process: str) -> int:
        """Pop the count of configurations sent to the patches of `process` since its last period end."""
        return sum(self._config_counts.pop(patch, 0) for patch in self._patches[process])

    def best_effort_messages(self) -> tuple[()]:
        """Best-effort publications: none."""
        return ()

    def result(self) -> ProcessResult:
        """Process result: ground truth and joint trace, for metrics."""
        truth = self._plant.ground_truth()
        facts: dict[str, Any] = {
            "logs": {"body": self._digest.hexdigest()},
            "end_ns": self._plant.t_ns,
            "deadline_misses": self.counters["deadline_misses"],
            "loop_s": time.monotonic() - self._start_s,
            **truth.facts,
        }
        arrays: dict[str, NDArray[Any]] = {
            "joint_t_ns": np.array(self._trace_t_ns, dtype=np.int64),
            "joint_rad": np.array(self._trace_rad, dtype=np.float32).reshape(-1, self._plant.n_dofs),
            # time of the control tick and time at which the body put its command into effect, (n, 2)
            "command_ns": np.array(self._commands_ns, dtype=np.int64).reshape(-1, 2),
            **truth.arrays,
        }
        return ProcessResult(self.name, self.role, facts, arrays)


def _no_subscribers(_key: str) -> bool:
    """Subscriber query that reports no subscribers."""
    return False


def build(
    deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
) -> BodyProcess:
    """Build the body process of `deployment`: scripted if it has a script, else simulated."""
    load_pinned_functions()
    body = (
        BodySimulation(deployment, base)
        if deployment.scripted_stimuli is None
        else ScriptedBody(deployment, base)
    )
    body.stimulus()  # warm-up: compiles before others wait; no side effect on the state
    return BodyProcess(deployment, name, body, recorded=recorded)
