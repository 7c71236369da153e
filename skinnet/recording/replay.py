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
from skinnet.loop import Node
from skinnet.messages import Command, decode
from skinnet.recording.reader import Recording
from skinnet.transport.base import matches
from skinnet.worker import build_node

__all__ = ["Difference", "Verdict", "replay_into", "require_same_robot", "with_memory"]

_CONTROLLER = "controller"


class Difference(NamedTuple):
    """First difference between a recorded and a replayed command.

    Attributes:
        t_ns: Simulated time of the tick [ns].
        stage: Stage of the recorded command.
        what: Joint velocity or other field that differs.
        recorded: Recorded value.
        replayed: Replayed value.
    """

    t_ns: int
    stage: str
    what: str
    recorded: str
    replayed: str


class Verdict(NamedTuple):
    """Replay result.

    Attributes:
        ticks: Number of compared commands.
        t_ns: Time of the last compared command [ns].
        difference: First difference, if there is one.
        note: Reason why not all recorded commands were compared; empty if they were.
    """

    ticks: int
    t_ns: int
    difference: Difference | None
    note: str = ""


def require_same_robot(recorded: Deployment, deployment: Deployment) -> None:
    """Refuse a controller whose robot differs from the recorded one.

    Raises:
        RecordingError: robot, joints, patches, sheets or control period differ.
    """
    for what, one, other in (
        ("robot", recorded.robot, deployment.robot),
        ("joints", recorded.body.joints, deployment.body.joints),
        ("patches", _sizes(recorded), _sizes(deployment)),
        ("sheets", [s.name for s in recorded.sheets], [s.name for s in deployment.sheets]),
        ("control period", recorded.controller.period_ns, deployment.controller.period_ns),
    ):
        if one != other:
            raise RecordingError(f"the recording and the deployment differ in {what}: {one} and {other}")


def _sizes(deployment: Deployment) -> dict[str, int]:
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


def replay_into(recording: Recording, deployment: Deployment, base: Path) -> Verdict:
    """Replay a recording into the controller of `deployment`.

    Args:
        recording: Recording to replay.
        deployment: Deployment of the controller; its parameters may differ from the recorded ones.
        base: Folder that relative paths in the deployment start from.

    Raises:
        RecordingError: the recording is damaged.
        DeploymentError: the controller cannot be built.
    """
    node = build_node(_CONTROLLER, deployment, _CONTROLLER, base, None)
    return _Rehearsal(node).go(recording)


class _Rehearsal:
    """Replay driver that feeds recorded messages to a logical process."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._wanted: dict[str, bool] = {}
        self._commands: deque[bytes] = deque()
        self._over = False
        node.start(self._put)

    def go(self, recording: Recording) -> Verdict:
        ticks = t_ns = 0
        for message in recording.messages():
            if message.channel == "command":
                recorded = decode(message.payload, Command)
                if not self._commands and self._over:
                    ended = Difference(message.t_ns, recorded.stage, "program", "goes on", "has ended")
                    return Verdict(ticks + 1, t_ns, ended)
                if not self._commands:
                    return Verdict(ticks, t_ns, None, self._why_silent())
                t_ns, ticks = message.t_ns, ticks + 1
                replayed = self._commands.popleft()
                if replayed != message.payload:
                    return Verdict(ticks, t_ns, _first(recorded, decode(replayed, Command), recording))
            elif self._is_wanted(message.key):
                with contextlib.suppress(ProtocolError):  # as in the run, which counted and dropped it
                    self._node.accept(message.channel, message.fields, message.payload)
                self._tick()
        return Verdict(ticks, t_ns, None, "" if recording.complete else "the recording is cut there")

    def _tick(self) -> None:
        """Step the process as long as its inputs are complete."""
        node = self._node
        while (needs := node.needs()) is not None:
            if any(node.upstreams[name].covered_ns < t_ns for name, t_ns in needs.items()):
                return
            node.step(self._put)
            for _ in node.news():
                pass  # there are no observers
        self._over = True

    def _why_silent(self) -> str:
        needs = self._node.needs() or {}
        silent = [name for name, t_ns in needs.items() if self._node.upstreams[name].covered_ns < t_ns]
        return f"the recording has no more of {', '.join(silent)}: it was lost in the run"

    def _put(self, key: str, payload: bytes) -> None:
        if key.endswith("/body/command"):
            self._commands.append(payload)

    def _is_wanted(self, key: str) -> bool:
        wanted = self._wanted.get(key)
        if wanted is None:
            wanted = self._wanted[key] = any(matches(known, key) for known in self._node.subscriptions)
        return wanted


def _first(recorded: Command, replayed: Command, recording: Recording) -> Difference:
    """First difference of two unequal commands."""

    def difference(what: str, one: object, other: object) -> Difference:
        return Difference(recorded.t_ns, recorded.stage, what, repr(one), repr(other))

    joints = recording.raw["body"]["joints"]
    pairs = zip(joints, recorded.velocity_rad_s, replayed.velocity_rad_s, strict=True)
    for joint, one, other in pairs:
        if one != other:
            return difference(f"velocity of {joint} [rad/s]", one, other)
    for name in Command.__struct_fields__:
        if getattr(recorded, name) != getattr(replayed, name):
            return difference(name, getattr(recorded, name), getattr(replayed, name))
    return difference("bytes", "as recorded", "others")  # such as −0.0 instead of 0.0
