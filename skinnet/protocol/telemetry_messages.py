"""Telemetry messages for observers: load of links and processes, state machine of the controller.

They are not part of the run: published by the wall clock and never logged.
"""

import msgspec
import numpy as np

from skinnet.protocol.messages import Message

__all__ = ["LINK_INTO_CELL", "LINK_ROW", "LINK_UP", "LinkLoad", "ProcessLoad", "StateMachineDescription"]

LINK_UP, LINK_INTO_CELL = 1, 2
"""Bits of `state` in a `LINK_ROW`: link up, link from the computer into the cell."""

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
"""Link (one direction of a wire): 40 bytes, no padding; totals since the start of the run.

`state` is the sum of 1 if the link is up, and 2 if it leads from the computer into the cell; other links lead
out of the cell's port. `queue_high_water` is the largest number of packets queued behind one in transmission.
"""


class LinkLoad(Message, frozen=True, kw_only=True, tag="link_load"):
    """Link load of a patch up to `t_ns`: bytes of `LINK_ROW`, and its cells without power."""

    patch: str
    t_ns: int
    rows: bytes
    unpowered_cells: list[int]


class ProcessLoad(Message, frozen=True, kw_only=True, tag="process_load"):
    """Process load as columns: mean cores since the last message, and resident memory [MB].

    A process that is gone has 0 MB.
    """

    t_ns: int
    name: list[str]
    pid: list[int]
    cores: list[float]
    memory_mb: list[float]


class StateMachineDescription(Message, frozen=True, kw_only=True, tag="state_machine_description"):
    """State machine of the controller: states, transitions, accepted requests.

    `states` are the stages of `ControllerState`; `transitions` are transitions (state, event, next state).
    `requests` lists the arguments that each request takes, [""] for none; an empty list stands for a free
    name.
    """

    t_ns: int
    states: list[str]
    transitions: list[list[str]] = msgspec.field(default_factory=list)
    requests: dict[str, list[str]] = msgspec.field(default_factory=dict)
