"""Channel table of the middleware, with the only builder and parser of key expressions.

All keys begin with `skinnet/<robot>/`. A row gives key, message type, sender, receivers and period of a
channel; subscriptions, `skinnet check` and the documentation are derived from the rows.
"""

from dataclasses import dataclass
from enum import Enum

from skinnet.errors import ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import (
    Answer,
    Command,
    Config,
    ControllerState,
    Events,
    JointRanges,
    Joints,
    Message,
    PeriodEnd,
    Request,
    Stimulus,
    Stream,
    Topology,
)
from skinnet.protocol.recorded_messages import Counters, FaultEvent, FreeBodyPoses
from skinnet.protocol.sheet_messages import Pressures, Regions
from skinnet.protocol.telemetry_messages import LinkLoad, ProcessLoad, StateMachineDescription

__all__ = [
    "ALIVE",
    "BODY",
    "CHANNELS",
    "CONTROLLER",
    "DEPLOYMENT",
    "EXTERNAL",
    "OBSERVERS",
    "RECORDER",
    "Channel",
    "Keys",
    "Role",
    "channel",
]


class Role(Enum):
    """Roles of the processes of a run; the launcher only observes."""

    BODY = "body"
    CELLS = "cells"
    BOARDS = "boards"
    CONTROLLER = "controller"
    LAUNCHER = "launcher"
    RECORDER = "recorder"


@dataclass(frozen=True)
class Channel:
    """Channel: one row of the table.

    Attributes:
        name: Name of the channel in code.
        pattern: Key pattern below `skinnet/<robot>/`; `<field>` stands for one segment.
        message: Message type.
        sender: Role that publishes; None for external clients, which enter through the observer endpoint.
        receivers: Roles that subscribe and need every message.
        period: Publication period or condition.
        public: Observers get best-effort copies; the newest topology and state also answer queries.
        recorded: A recording of the run holds every message.
        best_effort: Published best-effort to observers, outside the loop.
    """

    name: str
    pattern: str
    message: type[Message]
    sender: Role | None
    receivers: tuple[Role, ...]
    period: str
    public: bool = True
    recorded: bool = True
    best_effort: bool = False

    @property
    def sender_name(self) -> str:
        """Sender role as text; "external" for external clients."""
        return EXTERNAL if self.sender is None else self.sender.value


_GROUND_TRUTH = {"public": False, "recorded": False}
_TELEMETRY = {"recorded": False, "best_effort": True}
CHANNELS = (
    Channel(
        "stimulus", "body/stimulus/<process>", Stimulus, Role.BODY, (Role.CELLS,), "stimulus", **_GROUND_TRUTH
    ),
    Channel("pressures", "body/pressures", Pressures, Role.BODY, (Role.BOARDS,), "stimulus", **_GROUND_TRUTH),
    Channel("free_bodies", "body/free_bodies", FreeBodyPoses, Role.BODY, (), "joints"),
    Channel(
        "joint_ranges",
        "body/joint_ranges",
        JointRanges,
        Role.BODY,
        (Role.CONTROLLER,),
        "once",
        public=False,
        recorded=False,
    ),
    Channel("joints", "body/joints", Joints, Role.BODY, (Role.CONTROLLER,), "joints"),
    Channel("command", "body/command", Command, Role.CONTROLLER, (Role.BODY,), "control"),
    Channel("events", "skin/<patch>/<cell>/events", Events, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel("bundle", "skin/<patch>/events", Events, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel("stream", "skin/<patch>/stream", Stream, Role.CELLS, (Role.CONTROLLER,), "on request"),
    Channel("period_end", "skin/<patch>/period_end", PeriodEnd, Role.CELLS, (Role.CONTROLLER,), "cells"),
    Channel("regions", "skin/<network>/regions", Regions, Role.BOARDS, (Role.CONTROLLER,), "boards"),
    Channel("topology", "skin/<patch>/topology", Topology, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel(
        "config",
        "skin/<patch>/<cell>/config",
        Config,
        Role.CONTROLLER,
        (Role.CELLS, Role.BOARDS),
        "on change",
    ),
    Channel("request", "controller/request/<name>", Request, None, (Role.CONTROLLER,), "on request"),
    Channel("velocity", "controller/velocity", ExternalVelocity, None, (Role.CONTROLLER,), "aperiodic"),
    Channel("answer", "controller/answer", Answer, Role.CONTROLLER, (), "on request", best_effort=True),
    Channel(
        "state",
        "controller/state",
        ControllerState,
        Role.CONTROLLER,
        (),
        "on change, 10 Hz",
        best_effort=True,
    ),
    Channel(
        "state_machine",
        "controller/state_machine",
        StateMachineDescription,
        Role.CONTROLLER,
        (),
        "on change",
        best_effort=True,
    ),
    Channel("links", "skin/<patch>/links", LinkLoad, Role.CELLS, (), "2 Hz, if subscribed", **_TELEMETRY),
    Channel(
        "processes", "run/processes", ProcessLoad, Role.LAUNCHER, (), "2 Hz, if subscribed", **_TELEMETRY
    ),
    Channel("counters", "process/<process>/counters", Counters, Role.CELLS, (), "1 Hz, at the end"),
    Channel("fault", "run/fault", FaultEvent, Role.RECORDER, (), "on change", public=False),
)
"""Channels in the order of the sensorimotor loop."""

ALIVE = "alive"
DEPLOYMENT = "skinnet/*/deployment"
"""Key expression that an observer endpoint answers with its deployment, for any robot."""
EXTERNAL = "external"
"""Sender name of external clients in the loop: configurations, requests to the controller, velocities."""
BODY, CONTROLLER, RECORDER = "body", "controller", "recorder"
"""Process names of the body, the controller and the recorder; those of the skin are the deployment's."""
OBSERVERS = "observers"
"""Route group of channels without receivers in the loop; put only if an observer subscribes."""
_MAX_CACHED_KEYS = 100_000
_BY_NAME = {row.name: row for row in CHANNELS}
_BY_SHAPE: dict[tuple[str | None, ...], tuple[Channel, tuple[int, ...]]] = {}
for _row in CHANNELS:
    _parts = _row.pattern.split("/")
    _fields = tuple(i for i, part in enumerate(_parts) if part.startswith("<"))
    _BY_SHAPE[tuple(None if i in _fields else part for i, part in enumerate(_parts))] = (_row, _fields)


def channel(name: str) -> Channel:
    """Return the channel `name` of the table."""
    return _BY_NAME[name]


class Keys:
    """Key builder and parser of one robot.

    Attributes:
        prefix: `skinnet/<robot>/`.
    """

    def __init__(self, robot: str) -> None:
        self.prefix = f"skinnet/{robot}/"
        self._parsed: dict[str, tuple[Channel, tuple[str, ...]]] = {}
        self._route_groups: dict[str, str] = {}

    def of(self, name: str, *fields: str | int) -> str:
        """Build the key of channel `name` from its fields; "*" and "**" make it a key expression."""
        parts = _BY_NAME[name].pattern.split("/")
        values = iter(fields)
        return self.prefix + "/".join(str(next(values)) if p.startswith("<") else p for p in parts)

    def route_group(self, key: str) -> str:
        """Return the route group of a key or expression: its receivers, whose messages share a batch."""
        group = self._route_groups.get(key)
        if group is None:
            row = self.parse(key)[0]
            group = "-".join(role.value for role in row.receivers) or OBSERVERS
            if len(self._route_groups) < _MAX_CACHED_KEYS:
                self._route_groups[key] = group
        return group

    def liveliness(self, role: Role | str, name: str) -> str:
        """Build the key of a liveliness token; "*" stands for any."""
        return f"{self.prefix}{ALIVE}/{role.value if isinstance(role, Role) else role}/{name}"

    def name_claim(self, name: str, process: str) -> str:
        """Build the token key by which `process` claims the name `name`; "*" stands for any process."""
        return f"{self.prefix}claim/{name}/{process}"

    def silent(self, process: str) -> str:
        """Build the key on which a process reports the tolerated silence of `process`; "*" stands for any."""
        return f"{self.prefix}silent/{process}"

    @property
    def deployment(self) -> str:
        """Key under which the observer endpoint serves the deployment."""
        return f"{self.prefix}deployment"

    def parse(self, key: str) -> tuple[Channel, tuple[str, ...]]:
        """Parse `key` into its channel and field values.

        Raises:
            ProtocolError: no channel has this key.
        """
        known = self._parsed.get(key)
        if known is not None:
            return known
        parts = key.removeprefix(self.prefix).split("/")
        if key.startswith(self.prefix):
            for shape, (row, fields) in _BY_SHAPE.items():
                if len(shape) == len(parts) and all(
                    s in (None, p) for s, p in zip(shape, parts, strict=True)
                ):
                    parsed = row, tuple(parts[i] for i in fields)
                    if len(self._parsed) < _MAX_CACHED_KEYS:  # external clients may send any number of keys
                        self._parsed[key] = parsed
                    return parsed
        raise ProtocolError(f"key {key}: matches no channel of this robot")
