"""Boards of one network: each scans its sheet, tracks contact regions, and sends them to the main PC.

In each scan frame a board sends one message with its regions, even if there are none, as a heartbeat. On
request it also sends the raw pattern every n frames. Messages may be delayed or lost, never truncated.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.networking.packet_counters import PacketCounters
from cells.sheets.board_network import BoardNetwork
from cells.sheets.pressure_transducers import PressureTransducers
from cells.sheets.region_quantisation import FORCE_STEP_N, MAX_ROWS, PEAK_STEPS, XI_STEP_M
from cells.sheets.regions import RegionTracker
from skinnet.deployment.network import BoardNetworkSpec
from skinnet.deployment.skin.sheets import MAX_SIDE, BoardSpec
from skinnet.network.packet_ids import PacketSlots
from skinnet.network.records import Outcome
from skinnet.protocol.sheet_messages import PATTERN_ROW, REGION_ROW, SCAN_FRAME_ROW
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["Boards", "DeliveredMessages", "MessageKind"]

Ints = NDArray[np.int64]

_MESSAGE_ROW = np.dtype(
    [
        ("kind", np.uint8),
        ("scan_index", np.int64),
        ("count", np.int64),  # rows of regions, elements of a pattern, or the frame interval of a request
        ("rows", REGION_ROW, MAX_ROWS),
        ("pressure_kpa", np.float32, MAX_SIDE * MAX_SIDE),
    ]
)


class MessageKind(IntEnum):
    """Kind of a message on the board network."""

    REGIONS = 0
    PATTERN = 1
    REQUEST = 2


class DeliveredMessages(NamedTuple):
    """Messages delivered to the PC: `SCAN_FRAME_ROW`, `REGION_ROW`, `PATTERN_ROW`, in order of delivery."""

    frames: NDArray[Any]
    rows: NDArray[Any]
    patterns: NDArray[Any]


class Boards:
    """Boards of the sheets on one network.

    Boards are indexed as their sheets are given, elements consecutively through all boards. A board's regions
    depend only on its own name, sheet and pressures; their time of arrival also on other traffic.

    Attributes:
        readings_kpa: (n,) readings of the last frame [kPa].
        tracker: Region tracker, with the regions of the last frame.
        network: Board network, which carries the messages.
    """

    def __init__(
        self,
        sheets: Sequence[PlacedSheet],
        spec: BoardSpec,
        network: BoardNetworkSpec,
        seed: int,
    ) -> None:
        """Create boards without contact.

        Raises:
            DeploymentError: as `PressureTransducers` and `RegionTracker`.
        """
        self._spec, self._network_spec = spec, network
        self._transducers = PressureTransducers(sheets, spec, seed)
        self.tracker = RegionTracker(sheets, spec.regions)
        self.network = BoardNetwork(network, len(sheets), seed)
        self._n_elements = np.array([sheet.n_elements for sheet in sheets])
        self._board_of_element = np.repeat(np.arange(len(sheets)), self._n_elements)
        self._element_of_board = np.concatenate([np.arange(size) for size in self._n_elements])
        self.readings_kpa = np.zeros(len(self._board_of_element))
        self._pattern_interval = np.full(len(sheets), spec.pattern_interval_scans, dtype=np.int64)
        self._ready_ns = self._transducers.scan_end_ns + round(spec.processing_delay_us * 1e3)
        self._packet_ids = PacketSlots()
        self._messages: NDArray[Any] = np.zeros(0, dtype=_MESSAGE_ROW)
        self._counters = PacketCounters(MessageKind)

    def step(
        self, frame: int, before_kpa: NDArray[np.floating], after_kpa: NDArray[np.floating]
    ) -> DeliveredMessages:
        """Simulate scan frame `frame`, which spans [frame, frame + 1) periods; return what was delivered.

        Args:
            frame: Index of the frame.
            before_kpa: (n,) pressures of the elements at its start [kPa].
            after_kpa: (n,) pressures at its end [kPa].
        """
        self._transducers.scan(frame, before_kpa, after_kpa, self.readings_kpa)
        self.tracker.update(self.readings_kpa)
        begin_ns = frame * self._spec.period_ns
        self._send_regions(begin_ns, frame)
        every = np.maximum(self._pattern_interval, 1)
        asked = np.flatnonzero((self._pattern_interval > 0) & (frame % every == 0))
        if len(asked):
            self._send_patterns(begin_ns, frame, asked)
        return self._receive(begin_ns + self._spec.period_ns)

    def request_pattern(self, t_ns: int, board: int, pattern_every: int) -> None:
        """Request the raw pattern of a board every `pattern_interval_scans` frames, 0 to stop, at `t_ns`.

        The request takes effect with the first frame that begins after it has been delivered.

        Raises:
            ValueError: no such board, or a negative interval.
        """
        if not 0 <= board < len(self._n_elements) or pattern_every < 0:
            raise ValueError(
                f"pattern_every = {pattern_every} for board {board}: there are boards 0 to "
                f"{len(self._n_elements) - 1}, and frames count from 0"
            )
        number = self._register(MessageKind.REQUEST, 0, np.array([board]), np.array([t_ns]))
        self._messages["count"][number] = pattern_every
        self.network.send_to_board(t_ns, board, self._network_spec.header_bytes, int(number[0]))

    def counters(self) -> dict[str, dict[str, int]]:
        """Count messages by kind: offered, delivered, dropped by cause, in flight."""
        return self._counters.as_dict(self._messages["kind"][self.network.kernel.pending_packet_id])

    def _send_regions(self, begin_ns: int, frame: int) -> None:
        boards = np.arange(len(self._n_elements))
        sampled_ns = begin_ns + self._transducers.scan_end_ns
        numbers = self._register(MessageKind.REGIONS, frame, boards, sampled_ns)
        count = self.tracker.n_rows
        self._messages["count"][numbers] = count
        self._messages["rows"][numbers] = self.tracker.rows
        size = self._network_spec.header_bytes + count * self._network_spec.region_bytes
        self.network.send_to_pc(begin_ns + self._ready_ns, boards, size, numbers)

    def _send_patterns(self, begin_ns: int, frame: int, boards: Ints) -> None:
        sampled_ns = begin_ns + self._transducers.scan_end_ns[boards]
        numbers = self._register(MessageKind.PATTERN, frame, boards, sampled_ns)
        self._messages["count"][numbers] = self._n_elements[boards]
        pattern = np.zeros((len(self._n_elements), MAX_SIDE * MAX_SIDE), dtype=np.float32)
        pattern[self._board_of_element, self._element_of_board] = self.readings_kpa
        self._messages["pressure_kpa"][numbers] = pattern[boards]
        size = self._network_spec.header_bytes + -(-self._n_elements[boards] * self._spec.pressure.bits // 8)
        self.network.send_to_pc(begin_ns + self._ready_ns[boards], boards, size, numbers)

    def _register(self, kind: MessageKind, frame: int, boards: Ints, sampled_ns: Ints) -> Ints:
        """Register new messages; return their numbers."""
        numbers = self._packet_ids.allocate(boards, sampled_ns)
        if (missing := int(numbers.max(initial=-1)) + 1 - len(self._messages)) > 0:
            self._messages = np.concatenate([self._messages, np.zeros(2 * missing, dtype=_MESSAGE_ROW)])
        self._messages["kind"][numbers] = kind
        self._messages["scan_index"][numbers] = frame
        self._counters.count_offered(kind, len(numbers))
        return numbers

    def _receive(self, until_ns: int) -> DeliveredMessages:
        finished = self.network.advance(until_ns)
        numbers = finished.packet_id
        board, sampled_ns = self._packet_ids.release(numbers)
        kind = self._messages["kind"][numbers]
        self._counters.count_ended(kind, finished.outcome)
        arrived = finished.outcome == Outcome.DELIVERED
        asked = np.flatnonzero(arrived & (kind == MessageKind.REQUEST))
        for i in asked.tolist():
            self._pattern_interval[board[i]] = self._messages["count"][numbers[i]]
        heads = []
        for wanted, dtype, count in (
            (MessageKind.REGIONS, SCAN_FRAME_ROW, "n_regions"),
            (MessageKind.PATTERN, PATTERN_ROW, "n_elements"),
        ):
            mine = np.flatnonzero(arrived & (kind == wanted))
            head = np.zeros(len(mine), dtype=dtype)
            head["t_sampled_ns"], head["t_delivered_ns"] = sampled_ns[mine], finished.t_ns[mine]
            head["scan_index"] = self._messages["scan_index"][numbers[mine]]
            head["board"], head[count] = board[mine], self._messages["count"][numbers[mine]]
            heads.append((head, numbers[mine]))
        (frames, with_rows), (patterns, with_patterns) = heads
        patterns["pressure_kpa"] = self._messages["pressure_kpa"][with_patterns]
        return DeliveredMessages(frames, self._quantised_regions(frames, with_rows), patterns)

    def _quantised_regions(self, frames: NDArray[Any], numbers: Ints) -> NDArray[Any]:
        """Return the region rows of delivered messages, quantised as on the wire."""
        filled = np.arange(MAX_ROWS) < frames["n_regions"][:, None]
        rows: NDArray[Any] = self._messages["rows"][numbers][filled]
        for name in ("t_sampled_ns", "t_delivered_ns"):
            rows[name] = np.repeat(frames[name], frames["n_regions"])
        for name, step in (
            ("force_n", FORCE_STEP_N),
            ("xi1_m", XI_STEP_M),
            ("xi2_m", XI_STEP_M),
            ("peak_kpa", self._spec.pressure.range_kpa / PEAK_STEPS),
        ):
            rows[name] = np.rint(rows[name] / step) * step
        return rows
