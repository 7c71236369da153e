"""Decision core of a controller: the interface between its process and the program that decides.

The process has the channels, the buffers and the log; the core has the program. There are two: a program of
stages on the events and readings of cells (`controller.stages.core`), and the nursing program on the contact
regions of boards (`controller.nursing.core`).
"""

from collections.abc import Hashable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from controller.inputs import JointMeasurement
from controller.request_queue import Reply
from skinnet.protocol.telemetry_messages import StateMachineDescription
from skinnet.runtime.upstream import Upstream

__all__ = ["Decision", "DecisionCore", "StreamRequest"]


class StreamRequest(NamedTuple):
    """Request to a cell to start or to stop its stream of full readings."""

    patch: str
    cell: int
    stream: bool


class Decision(NamedTuple):
    """Decision of a tick: joint velocities (D,) [rad/s], requests to cells, and the skin data it rests on.

    The arrays of `skin_data` are C-contiguous and in the order of delivery; they enter the log hash.
    """

    velocity_rad_s: NDArray[np.float64]
    stream_requests: list[StreamRequest]
    skin_data: tuple[NDArray[Any], ...]


class DecisionCore(Protocol):
    """Decision core, called once per control period; no I/O and no clock of its own.

    In each tick the process calls `update_skin`, then `handle_request` for each pending request, then `tick`.

    Attributes:
        result_role: Role under which the results of the run are analysed.
    """

    result_role: str

    @property
    def stage(self) -> str:
        """Name of the current stage or state, as in commands; empty before the first."""

    @property
    def state(self) -> str:
        """State as published to observers; never empty."""

    @property
    def progress(self) -> float:
        """Completed fraction of the current stage or state, 0 to 1."""

    @property
    def reason(self) -> str:
        """Event that led to the current state; empty without one."""

    @property
    def done(self) -> bool:
        """True once the program is complete and the run may end."""

    @property
    def capabilities_key(self) -> Hashable:
        """Value that changes whenever `describe` would return another description."""

    def describe(self, t_ns: int) -> StateMachineDescription:
        """Describe the states, transitions and accepted requests, as known at `t_ns`."""

    def accept(self, channel: str, upstream: Upstream, payload: bytes) -> None:
        """Accept skin data of `upstream`, and count its messages and period ends there.

        Raises:
            ProtocolError: the message is malformed or not of this skin; the state is unchanged.
        """

    def set_joint_ranges(self, range_rad: NDArray[np.float64]) -> None:
        """Set the position limits (D, 2) of the joints, infinite without a limit, before the first tick."""

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Continue safely without the skin of a lost upstream."""

    def update_skin(self, t_ns: int) -> None:
        """Apply the skin data due before the tick at `t_ns`, on which its requests may depend."""

    def handle_request(self, t_ns: int, name: str, argument: str) -> Reply:
        """Handle a request before the tick at `t_ns`, or refuse it and change nothing."""

    def tick(
        self,
        t_ns: int,
        joints: JointMeasurement,
        skin_watermark_ns: int,
        external_rad_s: NDArray[np.float64] | None,
    ) -> Decision:
        """Compute one control period.

        Args:
            t_ns: Time of the tick.
            joints: Newest joint positions (D,) and the time of their measurement, `t_ns` or earlier.
            skin_watermark_ns: Lowest watermark of the skin that is not lost.
            external_rad_s: (D,) finite velocities of an external client; None without fresh ones.
        """

    def result(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the facts and arrays of the program, after the last tick; close what is open."""
