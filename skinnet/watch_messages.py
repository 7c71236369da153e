"""What is told to watchers only: loads of links and processes, and which states the controller can be in.

None of it is part of the run: it is sent by the wall clock and never logged.
"""

import msgspec
import numpy as np

from skinnet.messages import Message

__all__ = ["LINK_INWARDS", "LINK_ROW", "LINK_UP", "LinkLoad", "Machine", "ProcessLoad"]

LINK_UP, LINK_INWARDS = 1, 2
"""Bits of `state` in a `LINK_ROW`."""

LINK_ROW = np.dtype(
    [
        ("packets", "<i8"),
        ("bytes", "<i8"),
        ("busy_ns", "<i8"),
        ("dropped", "<i8"),
        ("queue_high_water", "<u4"),
        ("cell", "<u2"),
        ("port", "u1"),
        ("state", "u1"),
    ]
)
"""One link, which is one direction of a wire: 40 bytes, no padding; totals since the run began.

`state` is the sum of 1 if the link is up, and 2 if it leads from the computer into the cell; others lead out
of the cell's port. The queue's high water is the most packets that waited behind one in transmission.
"""


class LinkLoad(Message, frozen=True, kw_only=True, tag="link_load"):
    """What the links of a patch have carried up to `t_ns`, bytes of `LINK_ROW`; its cells without power."""

    patch: str
    t_ns: int
    rows: bytes
    dark: list[int]


class ProcessLoad(Message, frozen=True, kw_only=True, tag="process_load"):
    """What the processes of the run use of the machine, as columns: cores since the last message, and memory.

    A process that is gone has no memory.
    """

    t_ns: int
    name: list[str]
    pid: list[int]
    cores: list[float]
    memory_mb: list[float]


class Machine(Message, frozen=True, kw_only=True, tag="machine"):
    """The states that the controller can be in, and what leads from one to another.

    `states` are named as `ControllerState` names them; `moves` are rows of (state, event, next state).
    `requests` has the arguments that each request takes, [""] for none; an empty list stands for a name of
    the user's choice.
    """

    t_ns: int
    states: list[str]
    moves: list[list[str]] = msgspec.field(default_factory=list)
    requests: dict[str, list[str]] = msgspec.field(default_factory=dict)
