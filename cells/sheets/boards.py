"""Boards of one network: each scans its sheet, tracks contact regions, and sends them to the main PC.

In each scan frame a board sends one message with its regions, even if there are none, as a heartbeat. On
request it also sends the raw pattern every n frames. Messages may be delayed or lost, never truncated.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sheets.network import BoardNetwork
from cells.sheets.regions import RegionTracker
from cells.sheets.transducers import PressureTransducers
from cells.sheets.wire import FORCE_STEP_N, MAX_ROWS, PEAK_STEPS, XI_STEP_M
from skinnet.deployment.sheets import MAX_SIDE, BoardNetworkSpec, BoardSpec
from skinnet.network.ledger import Ledger
from skinnet.network.records import Outcome
from skinnet.sheet_messages import BOARD_FRAME, PATTERN_ROW, REGION_ROW
from skinnet.skin.sheet import PlacedSheet

__all__ = ["Boards", "Delivered", "MessageKind"]

Ints = NDArray[np.int64]

_CONTENT = np.dtype(
    [
        ("kind", np.uint8),
        ("frame", np.int64),
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


class Delivered(NamedTuple):
    """Messages delivered to the PC: `BOARD_FRAME`, `REGION_ROW` and `PATTERN_ROW`, in order of delivery."""

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
        name: str = "boards",
    ) -> None:
        """Create boards without contact.

        Raises:
            DeploymentError: as `PressureTransducers` and `RegionTracker`.
        """
        self._spec, self._network_spec = spec, network
        self._transducers = PressureTransducers(sheets, spec, seed)
        self.tracker = RegionTracker(sheets, spec.regions)
        self.network = BoardNetwork(network, name, len(sheets), seed)
        self._size = np.array([sheet.n_elements for sheet in sheets])
        self._board = np.repeat(np.arange(len(sheets)), self._size)
        self._place = np.concatenate([np.arange(size) for size in self._size])
        self.readings_kpa = np.zeros(len(self._board))
        self._every = np.full(len(sheets), spec.pattern_every, dtype=np.int64)
        self._on = np.ones(len(sheets), dtype=np.bool_)
        self._ready_ns = self._transducers.complete_ns + round(spec.compute_us * 1e3)
        self._ledger = Ledger()
        self._content: NDArray[Any] = np.zeros(0, dtype=_CONTENT)
        self._offered = np.zeros(len(MessageKind), dtype=np.int64)
        self._ended = np.zeros((len(MessageKind), len(Outcome)), dtype=np.int64)

    def step(
        self, frame: int, before_kpa: NDArray[np.floating], after_kpa: NDArray[np.floating]
    ) -> Delivered:
        """Simulate scan frame `frame`, which spans [frame, frame + 1) periods; return what was delivered.

        Args:
            frame: Index of the frame.
            before_kpa: (n,) pressures of the elements at its start [kPa].
            after_kpa: (n,) pressures at its end [kPa].
        """
        self._transducers.scan(frame, before_kpa, after_kpa, self.readings_kpa)
        if not self._on.all():
            self.readings_kpa[~self._on[self._board]] = 0.0
        self.tracker.track(self.readings_kpa)
        begin_ns = frame * self._spec.period_ns
        self._send_regions(begin_ns, frame, np.flatnonzero(self._on))
        every = np.maximum(self._every, 1)
        asked = np.flatnonzero(self._on & (self._every > 0) & (frame % every == 0))
        if len(asked):
            self._send_patterns(begin_ns, frame, asked)
        return self._receive(begin_ns + self._spec.period_ns)

    def request(self, t_ns: int, board: int, pattern_every: int) -> None:
        """Request the raw pattern of a board every `pattern_every` frames, 0 to stop, at `t_ns`.

        The request takes effect with the first frame that begins after it has been delivered.

        Raises:
            ValueError: no such board, or a negative interval.
        """
        if not 0 <= board < len(self._on) or pattern_every < 0:
            raise ValueError(
                f"pattern of board {board} every {pattern_every} frames: there are boards 0 to "
                f"{len(self._on) - 1}, and frames count from 0"
            )
        number = self._enter(MessageKind.REQUEST, 0, np.array([board]), np.array([t_ns]))
        self._content["count"][number] = pattern_every
        self.network.ask(t_ns, board, self._network_spec.head_bytes, int(number[0]))

    def switch(self, board: int, on: bool) -> None:
        """Switch a board's power from the next frame on; a board that is switched on is reset."""
        self._on[board] = on
        self.tracker.reset(board)
        self._every[board] = self._spec.pattern_every

    def counters(self) -> dict[str, dict[str, int]]:
        """Count messages by kind: offered, delivered, dropped by cause, in flight."""
        result = {}
        for kind in MessageKind:
            ended, offered = self._ended[kind], int(self._offered[kind])
            entry = {"offered": offered, "in_flight": offered - int(ended.sum())}
            result[kind.name.lower()] = entry | {o.name.lower(): int(ended[o]) for o in Outcome}
        return result

    def _send_regions(self, begin_ns: int, frame: int, boards: Ints) -> None:
        sampled_ns = begin_ns + self._transducers.complete_ns[boards]
        numbers = self._enter(MessageKind.REGIONS, frame, boards, sampled_ns)
        count = self.tracker.n_rows[boards]
        self._content["count"][numbers] = count
        self._content["rows"][numbers] = self.tracker.rows[boards]
        size = self._network_spec.head_bytes + count * self._network_spec.region_bytes
        self.network.send(begin_ns + self._ready_ns[boards], boards, size, numbers)

    def _send_patterns(self, begin_ns: int, frame: int, boards: Ints) -> None:
        sampled_ns = begin_ns + self._transducers.complete_ns[boards]
        numbers = self._enter(MessageKind.PATTERN, frame, boards, sampled_ns)
        self._content["count"][numbers] = self._size[boards]
        pattern = np.zeros((len(self._on), MAX_SIDE * MAX_SIDE), dtype=np.float32)
        pattern[self._board, self._place] = self.readings_kpa
        self._content["pressure_kpa"][numbers] = pattern[boards]
        size = self._network_spec.head_bytes + -(-self._size[boards] * self._spec.pressure.bits // 8)
        self.network.send(begin_ns + self._ready_ns[boards], boards, size, numbers)

    def _enter(self, kind: MessageKind, frame: int, boards: Ints, sampled_ns: Ints) -> Ints:
        """Register new messages; return their numbers."""
        numbers = self._ledger.enter(boards, sampled_ns)
        if (missing := int(numbers.max(initial=-1)) + 1 - len(self._content)) > 0:
            self._content = np.concatenate([self._content, np.zeros(2 * missing, dtype=_CONTENT)])
        self._content["kind"][numbers] = kind
        self._content["frame"][numbers] = frame
        self._offered[kind] += len(numbers)
        return numbers

    def _receive(self, until_ns: int) -> Delivered:
        finished = self.network.advance(until_ns)
        numbers = finished.packet_id
        board, sampled_ns = self._ledger.leave(numbers)
        kind = self._content["kind"][numbers]
        np.add.at(self._ended, (kind, finished.outcome), 1)
        arrived = finished.outcome == Outcome.DELIVERED
        asked = np.flatnonzero(arrived & (kind == MessageKind.REQUEST))
        for i in asked.tolist():
            self._every[board[i]] = self._content["count"][numbers[i]]
        heads = []
        for wanted, dtype, count in (
            (MessageKind.REGIONS, BOARD_FRAME, "rows"),
            (MessageKind.PATTERN, PATTERN_ROW, "elements"),
        ):
            mine = np.flatnonzero(arrived & (kind == wanted))
            head = np.zeros(len(mine), dtype=dtype)
            head["t_sampled_ns"], head["t_delivered_ns"] = sampled_ns[mine], finished.t_ns[mine]
            head["frame"] = self._content["frame"][numbers[mine]]
            head["board"], head[count] = board[mine], self._content["count"][numbers[mine]]
            heads.append((head, numbers[mine]))
        (frames, with_rows), (patterns, with_patterns) = heads
        patterns["pressure_kpa"] = self._content["pressure_kpa"][with_patterns]
        return Delivered(frames, self._rows(frames, with_rows), patterns)

    def _rows(self, frames: NDArray[Any], numbers: Ints) -> NDArray[Any]:
        """Return the region rows of delivered messages, quantised as on the wire."""
        filled = np.arange(MAX_ROWS) < frames["rows"][:, None]
        rows: NDArray[Any] = self._content["rows"][numbers][filled]
        for name in ("t_sampled_ns", "t_delivered_ns"):
            rows[name] = np.repeat(frames[name], frames["rows"])
        for name, step in (
            ("force_n", FORCE_STEP_N),
            ("xi1_m", XI_STEP_M),
            ("xi2_m", XI_STEP_M),
            ("peak_kpa", self._spec.pressure.range_kpa / PEAK_STEPS),
        ):
            rows[name] = np.rint(rows[name] / step) * step
        return rows
