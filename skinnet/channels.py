"""The channel table, and the only builder and parser of key expressions.

All keys begin with `skinnet/<robot>/`. The table says who sends what to whom and how often; the launcher's
subscriptions, `skinnet check` and the documentation are made from it.
"""

from dataclasses import dataclass
from enum import Enum

from skinnet.errors import ProtocolError
from skinnet.messages import (
    Answer,
    Command,
    Config,
    ControllerState,
    Events,
    Joints,
    Message,
    Request,
    SkinFrame,
    Stimulus,
    Stream,
    Topology,
)
from skinnet.outside_messages import Velocity
from skinnet.record_messages import Counters, Fault, World
from skinnet.sheet_messages import Pressures, Regions
from skinnet.watch_messages import LinkLoad, Machine, ProcessLoad

__all__ = [
    "ALIVE",
    "CHANNELS",
    "DEPLOYMENT",
    "OUTSIDE",
    "RECORDER",
    "WATCHERS",
    "Channel",
    "Keys",
    "Role",
    "channel",
]


class Role(Enum):
    """Who takes part in a run; the launcher looks on."""

    BODY = "body"
    CELLS = "cells"
    CONTROLLER = "controller"
    LAUNCHER = "launcher"
    RECORDER = "recorder"


@dataclass(frozen=True)
class Channel:
    """One row of the table.

    Attributes:
        name: Name of the channel in code.
        pattern: Key below `skinnet/<robot>/`; `<field>` stands for one segment.
        message: Type of its messages.
        sender: Role that sends; None for users, who ask through the watch endpoint.
        receivers: Roles that need every message.
        period: When a message is sent.
        public: Whether watchers get best-effort copies; the newest topology and state also answer queries.
        recorded: Whether a recording of the run holds every message.
        told: Whether watchers are told of it beside the loop, at a pace of their own.
    """

    name: str
    pattern: str
    message: type[Message]
    sender: Role | None
    receivers: tuple[Role, ...]
    period: str
    public: bool = True
    recorded: bool = True
    told: bool = False

    @property
    def origin(self) -> str:
        """The sender in words."""
        return OUTSIDE if self.sender is None else self.sender.value


_GROUND_TRUTH = {"public": False, "recorded": False}
_TOLD = {"recorded": False, "told": True}
CHANNELS = (
    Channel(
        "stimulus", "body/stimulus/<host>", Stimulus, Role.BODY, (Role.CELLS,), "stimulus", **_GROUND_TRUTH
    ),
    Channel("pressures", "body/pressures", Pressures, Role.BODY, (Role.CELLS,), "stimulus", **_GROUND_TRUTH),
    Channel("world", "body/world", World, Role.BODY, (), "joints"),
    Channel("joints", "body/joints", Joints, Role.BODY, (Role.CONTROLLER,), "joints"),
    Channel("command", "body/command", Command, Role.CONTROLLER, (Role.BODY,), "control"),
    Channel("events", "skin/<patch>/<cell>/events", Events, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel("bundle", "skin/<patch>/events", Events, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel("stream", "skin/<patch>/stream", Stream, Role.CELLS, (Role.CONTROLLER,), "on request"),
    Channel("frame", "skin/<patch>/frame", SkinFrame, Role.CELLS, (Role.CONTROLLER,), "cells"),
    Channel("regions", "skin/<network>/regions", Regions, Role.CELLS, (Role.CONTROLLER,), "boards"),
    Channel("topology", "skin/<patch>/topology", Topology, Role.CELLS, (Role.CONTROLLER,), "on change"),
    Channel("config", "skin/<patch>/<cell>/config", Config, Role.CONTROLLER, (Role.CELLS,), "on change"),
    Channel("request", "controller/request/<what>", Request, None, (Role.CONTROLLER,), "on request"),
    Channel("velocity", "controller/velocity", Velocity, None, (Role.CONTROLLER,), "at will"),
    Channel("answer", "controller/answer", Answer, Role.CONTROLLER, (), "on request", told=True),
    Channel("state", "controller/state", ControllerState, Role.CONTROLLER, (), "on change, 10 Hz", told=True),
    Channel("machine", "controller/machine", Machine, Role.CONTROLLER, (), "on change", told=True),
    Channel("links", "skin/<patch>/links", LinkLoad, Role.CELLS, (), "2 Hz, if watched", **_TOLD),
    Channel("processes", "run/processes", ProcessLoad, Role.LAUNCHER, (), "2 Hz, if watched", **_TOLD),
    Channel("counters", "host/<host>/counters", Counters, Role.CELLS, (), "1 Hz, at the end"),
    Channel("fault", "run/fault", Fault, Role.RECORDER, (), "on change", public=False),
)
"""Rows in the order of a touch on its way round."""

ALIVE = "alive"
DEPLOYMENT = "skinnet/*/deployment"
"""Asked at a watch endpoint, this tells what runs there, whatever the robot."""
OUTSIDE = "outside"
"""Sender of what strangers bring into the loop: configurations, requests to the controller, velocities."""
RECORDER = "recorder"
"""Name of the process that records a run, if one does."""
WATCHERS = "watchers"
"""Lane of what nobody in the loop receives; it is put there only if somebody listens."""
_KNOWN_KEYS = 100_000
_BY_NAME = {row.name: row for row in CHANNELS}
_BY_SHAPE: dict[tuple[str | None, ...], tuple[Channel, tuple[int, ...]]] = {}
for _row in CHANNELS:
    _parts = _row.pattern.split("/")
    _fields = tuple(i for i, part in enumerate(_parts) if part.startswith("<"))
    _BY_SHAPE[tuple(None if i in _fields else part for i, part in enumerate(_parts))] = (_row, _fields)


def channel(name: str) -> Channel:
    """Row of the table by its name."""
    return _BY_NAME[name]


class Keys:
    """Builds and parses the keys of one robot."""

    def __init__(self, robot: str) -> None:
        self.prefix = f"skinnet/{robot}/"
        self._parsed: dict[str, tuple[Channel, tuple[str, ...]]] = {}
        self._lanes: dict[str, str] = {}

    def of(self, name: str, *fields: str | int) -> str:
        """Key of channel `name` with its fields filled in; "*" and "**" make it an expression."""
        parts = _BY_NAME[name].pattern.split("/")
        values = iter(fields)
        return self.prefix + "/".join(str(next(values)) if p.startswith("<") else p for p in parts)

    def lane(self, key: str) -> str:
        """Receivers of what is put on `key`, maybe an expression: what they share travels together."""
        lane = self._lanes.get(key)
        if lane is None:
            row = self.parse(key)[0]
            lane = "-".join(role.value for role in row.receivers) or WATCHERS
            if len(self._lanes) < _KNOWN_KEYS:
                self._lanes[key] = lane
        return lane

    def alive(self, role: Role | str, name: str) -> str:
        """Key of a liveliness token; "*" stands for any."""
        return f"{self.prefix}{ALIVE}/{role.value if isinstance(role, Role) else role}/{name}"

    def claim(self, name: str, process: str) -> str:
        """Key of the token by which a process claims the name `name`; "*" stands for any process."""
        return f"{self.prefix}claim/{name}/{process}"

    @property
    def deployment(self) -> str:
        """Key at the watch endpoint that answers with what runs."""
        return f"{self.prefix}deployment"

    def parse(self, key: str) -> tuple[Channel, tuple[str, ...]]:
        """Channel and field values of `key`.

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
                    if len(self._parsed) < _KNOWN_KEYS:  # a stranger may invent keys without end
                        self._parsed[key] = parsed
                    return parsed
        raise ProtocolError(f"key {key}: no channel of this robot")
