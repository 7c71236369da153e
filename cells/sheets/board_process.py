"""Board process: the boards of all tactile sheets, simulated one period at a time.

In each period every board scans its sheet between the pressures at the two ends of the period. Frames that
reach the main PC before the period ends are published in one message, which is also the period end.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

from cells.networking.packet_counters import LatencyHistogram
from cells.sheets.boards import Boards
from skinnet.clock import NS_PER_S
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import BODY, Keys
from skinnet.protocol.messages import Config, decode, encode, unpack
from skinnet.protocol.recorded_messages import Counters
from skinnet.protocol.sheet_messages import Pressures, Regions
from skinnet.runtime.loop import Put
from skinnet.runtime.process_result import ProcessResult
from skinnet.runtime.upstream import Upstream
from skinnet.runtime.wiring import WiredProcess, wiring_of
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["BoardProcess"]

_PATTERN_INTERVAL_FRAMES = 25
"""Scan frames between two patterns [kPa] that are kept for plots."""


class BoardProcess(WiredProcess):
    """Logical process of all boards of a robot and their network."""

    def __init__(self, deployment: Deployment, name: str, *, recorded: bool = False) -> None:
        super().__init__(wiring_of(deployment, name, recorded=recorded))
        keys = Keys(deployment.robot)
        self._body = self.upstreams[BODY]
        sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self._n_boards = len(sheets)
        self._pattern_requests: list[tuple[int, int]] = []
        self._n_elements = sum(sheet.n_elements for sheet in sheets)
        self._boards = Boards(sheets, deployment.boards, deployment.board_network, deployment.seed)
        self._regions_key = keys.of("regions", BOARD_PROCESS)
        self._counters_key = keys.of("counters", name)
        self._period_ns = deployment.boards.period_ns
        self._end_ns = deployment.max_duration_ns
        self._frame = 0
        self._pressures: dict[int, NDArray[np.float32]] = {}
        self._seq = 0
        self._log_hash = hashlib.sha256()
        self._latency = LatencyHistogram()
        self._kept_patterns: list[tuple[int, NDArray[np.float32]]] = []

    def start(self, put: Put) -> None:
        """Publish nothing: boards start with the first pressures."""

    def needs(self) -> dict[str, int] | None:
        """Return the watermark [ns] that the next step needs: pressures up to the end of its period."""
        end_ns = self.due_ns()
        return None if end_ns > self._end_ns else {BODY: end_ns}

    def due_ns(self) -> int:
        """Return the end of the next period [ns]."""
        return (self._frame + 1) * self._period_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Accept pressures, or an external client's request for raw patterns.

        Raises:
            ProtocolError: a wrong channel, number of elements, board or rate of patterns.
        """
        if channel == "config":
            self._accept_pattern_request(decode(payload, Config))
            return
        if channel != "pressures":
            raise ProtocolError(f"the board process does not subscribe to {channel}")
        pressures = decode(payload, Pressures)
        values = unpack(pressures.values, "<f4")
        if len(values) != self._n_elements:
            raise ProtocolError(
                f"pressures of {len(values)} elements; the sheets have {self._n_elements}: body and boards "
                "run different deployments"
            )
        self._pressures[pressures.t_ns] = values
        self._body.end_period(pressures.watermark_ns)
        if pressures.end_ns is not None:
            self._end_ns = min(self._end_ns, pressures.end_ns)

    def _accept_pattern_request(self, config: Config) -> None:
        if config.patch != BOARD_PROCESS or not 0 <= config.cell < self._n_boards:
            raise ProtocolError(f"config of board {config.cell}: there are boards 0 to {self._n_boards - 1}")
        if config.pattern_interval_scans is None or config.pattern_interval_scans < 0:
            raise ProtocolError(f"config of board {config.cell}: give pattern_interval_scans, 0 or more")
        self.counters["external_configs"] += 1
        self._pattern_requests.append((config.cell, config.pattern_interval_scans))

    def on_upstream_lost(self, upstream: Upstream) -> None:
        """Do nothing: the body is the only upstream, and its loss is never tolerated."""

    def step(self, put: Put) -> None:
        """Simulate one period and publish its frames, regions and patterns."""
        start_ns = self._frame * self._period_ns
        before, after = self._pressures.pop(start_ns), self._pressures[start_ns + self._period_ns]
        for board, every in self._pattern_requests:
            self._boards.request_pattern(start_ns, board, every)
        self._pattern_requests.clear()
        told = self._boards.step(self._frame, before, after)
        if self._frame % _PATTERN_INTERVAL_FRAMES == 0:
            self._kept_patterns.append((start_ns, self._boards.readings_kpa.astype(np.float32)))
        self._frame += 1
        end_ns = start_ns + self._period_ns
        if end_ns % NS_PER_S < self._period_ns or end_ns + self._period_ns > self._end_ns:
            put(self._counters_key, encode(self._counters_message(end_ns)))
        message = Regions(
            t_ns=start_ns,
            watermark_ns=end_ns,
            frames=told.frames.tobytes(),
            rows=told.rows.tobytes(),
            patterns=told.patterns.tobytes(),
            seq=self._seq,
        )
        self._seq += len(told.frames)
        self._latency.add(told.frames["t_delivered_ns"] - told.frames["t_sampled_ns"])
        payload = encode(message)
        self._log_hash.update(payload)
        put(self._regions_key, payload)

    def _counters_message(self, t_ns: int) -> Counters:
        """Return the counters of the board network and of this process up to `t_ns`."""
        messages = self._boards.counters()
        counts = {f"{kind}.{what}": n for kind, entry in messages.items() for what, n in entry.items()}
        return Counters(process=self.name, t_ns=t_ns, counts=counts | dict(self.counters))

    def best_effort_messages(self) -> tuple[()]:
        """Return no best-effort publications: all output of boards is part of the run."""
        return ()

    def result(self) -> ProcessResult:
        """Return the counters, the latency histogram and the kept patterns."""
        facts = {
            "logs": {self.name: self._log_hash.hexdigest()},
            "boards": self._boards.counters(),
            "latency_max_ns": self._latency.max_ns,
        }
        arrays = {
            "latency_us": self._latency.counts,
            "pattern_t_ns": np.array([t_ns for t_ns, _ in self._kept_patterns], dtype=np.int64),
            "pattern_kpa": np.array([kpa for _, kpa in self._kept_patterns]).reshape(-1, self._n_elements),
        }
        return ProcessResult(self.name, self.role, facts, arrays)
