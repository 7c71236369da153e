"""Replay of a recording into a controller, up to the first command that differs from the recorded one.

The controller gets its recorded inputs: joints, skin and requests, in the order of the file, each request at
the tick that handled it. Its commands move nothing; they are compared bit by bit with the recorded ones.
"""

import contextlib
import tempfile
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from skinnet.deployment import Deployment
from skinnet.errors import ProtocolError, RecordingError
from skinnet.protocol.messages import Command, decode
from skinnet.recording.reader import Recording
from skinnet.runtime.loop import LogicalProcess
from skinnet.runtime.worker import build_process
from skinnet.transport.key_expressions import key_matches

__all__ = ["CommandDifference", "ReplayResult", "replay_into", "require_same_robot", "with_memory"]

_CONTROLLER = "controller"


class CommandDifference(NamedTuple):
    """First difference between a recorded and a replayed command.

    Attributes:
        t_ns: Simulated time of the tick [ns].
        stage: Stage of the recorded command.
        field: Joint velocity or other field that differs.
        recorded: Recorded value.
        replayed: Replayed value.
    """

    t_ns: int
    stage: str
    field: str
    recorded: str
    replayed: str


class ReplayResult(NamedTuple):
    """Replay result.

    Attributes:
        ticks: Number of compared commands.
        t_ns: Time of the last compared command [ns].
        difference: First difference, if there is one.
        note: Reason why not all recorded commands were compared; empty if they were.
    """

    ticks: int
    t_ns: int
    difference: CommandDifference | None
    note: str = ""


def require_same_robot(recorded: Deployment, deployment: Deployment) -> None:
    """Refuse a controller whose robot differs from the recorded one.

    Raises:
        RecordingError: robot, joints, patches, sheets or control period differ.
    """
    for what, one, other in (
        ("robot", recorded.robot, deployment.robot),
        ("joints", recorded.body.joints, deployment.body.joints),
        ("patches", _patch_sizes(recorded), _patch_sizes(deployment)),
        ("sheets", [s.name for s in recorded.sheets], [s.name for s in deployment.sheets]),
        ("control period", recorded.controller.period_ns, deployment.controller.period_ns),
    ):
        if one != other:
            raise RecordingError(
                f"the recording and the deployment differ in {what}: recorded {one}, deployed {other}"
            )


def _patch_sizes(deployment: Deployment) -> dict[str, int]:
    return {patch.name: patch.n_cells for patch in deployment.patches}


@contextlib.contextmanager
def with_memory(recording: Recording, deployment: Deployment) -> Iterator[Deployment]:
    """Deployment with the long-term memory that the recorded controller started with, if it had one."""
    if recording.memory is None or deployment.memory.read is None:
        yield deployment
        return
    name, content = recording.memory
    with tempfile.TemporaryDirectory(prefix="skinnet-") as folder:
        path = Path(folder) / Path(name).name
        path.write_bytes(content)
        memory = msgspec.structs.replace(deployment.memory, read=str(path))
        yield msgspec.structs.replace(deployment, memory=memory)


def replay_into(recording: Recording, deployment: Deployment, base: Path) -> ReplayResult:
    """Replay a recording into the controller of `deployment`.

    Args:
        recording: Recording to replay.
        deployment: Deployment of the controller; its parameters may differ from the recorded ones.
        base: Folder that relative paths in the deployment start from.

    Raises:
        RecordingError: the recording is damaged.
        DeploymentError: the controller cannot be built.
    """
    node = build_process(_CONTROLLER, deployment, _CONTROLLER, base, None)
    return _ReplayDriver(node).run(recording)


class _ReplayDriver:
    """Replay driver that feeds recorded messages to a logical process."""

    def __init__(self, node: LogicalProcess) -> None:
        self._node = node
        self._subscribed: dict[str, bool] = {}
        self._commands: deque[bytes] = deque()
        self._finished = False
        node.start(self._collect_command)

    def run(self, recording: Recording) -> ReplayResult:
        ticks = t_ns = 0
        for message in recording.messages():
            if message.channel == "command":
                recorded = decode(message.payload, Command)
                if not self._commands and self._finished:
                    ended = CommandDifference(message.t_ns, recorded.stage, "program", "goes on", "has ended")
                    return ReplayResult(ticks + 1, t_ns, ended)
                if not self._commands:
                    return ReplayResult(ticks, t_ns, None, self._missing_input())
                t_ns, ticks = message.t_ns, ticks + 1
                replayed = self._commands.popleft()
                if replayed != message.payload:
                    return ReplayResult(
                        ticks, t_ns, _first_difference(recorded, decode(replayed, Command), recording)
                    )
            elif self._is_subscribed(message.key):
                with contextlib.suppress(ProtocolError):  # as in the run, which counted and dropped it
                    self._node.accept(message.channel, message.fields, message.payload)
                self._step()
        return ReplayResult(
            ticks, t_ns, None, "" if recording.complete else "the recording is truncated there"
        )

    def _step(self) -> None:
        """Step the process as long as its inputs are complete."""
        node = self._node
        while (needs := node.needs()) is not None:
            if any(node.upstreams[name].watermark_ns < t_ns for name, t_ns in needs.items()):
                return
            node.step(self._collect_command)
            for _ in node.best_effort_messages():
                pass  # there are no observers
        self._finished = True

    def _missing_input(self) -> str:
        needs = self._node.needs() or {}
        silent = [name for name, t_ns in needs.items() if self._node.upstreams[name].watermark_ns < t_ns]
        return f"the recording has no further messages of {', '.join(silent)}: lost during the run"

    def _collect_command(self, key: str, payload: bytes) -> None:
        if key.endswith("/body/command"):
            self._commands.append(payload)

    def _is_subscribed(self, key: str) -> bool:
        wanted = self._subscribed.get(key)
        if wanted is None:
            wanted = self._subscribed[key] = any(
                key_matches(known, key) for known in self._node.subscriptions
            )
        return wanted


def _first_difference(recorded: Command, replayed: Command, recording: Recording) -> CommandDifference:
    """First difference of two unequal commands."""

    def difference(what: str, one: object, other: object) -> CommandDifference:
        return CommandDifference(recorded.t_ns, recorded.stage, what, repr(one), repr(other))

    joints = recording.deployment_dict["body"]["joints"]
    pairs = zip(joints, recorded.velocity_rad_s, replayed.velocity_rad_s, strict=True)
    for joint, one, other in pairs:
        if one != other:
            return difference(f"velocity of {joint} [rad/s; m/s if it slides]", one, other)
    for name in Command.__struct_fields__:
        if getattr(recorded, name) != getattr(replayed, name):
            return difference(name, getattr(recorded, name), getattr(replayed, name))
    return difference("bytes", "as recorded", "others")  # such as −0.0 instead of 0.0
