"""The host of the tactile sheets: their boards, period by period.

In each period every board scans its sheet between the pressures at the two ends of the period. What reaches
the main PC before the period ends is published, and the message closes the period.
"""

import hashlib
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from cells.sheets.boards import Boards
from skinnet.channels import Keys, Role
from skinnet.clock import NS_PER_S
from skinnet.deployment import Deployment
from skinnet.deployment.schema import BOARDS
from skinnet.errors import ProtocolError
from skinnet.loop import Put
from skinnet.messages import Config, decode, encode, unpack
from skinnet.part import Part
from skinnet.record_messages import Counters
from skinnet.sheet_messages import Pressures, Regions
from skinnet.skin.sheet import place_sheets
from skinnet.upstream import Upstream

__all__ = ["BoardsNode"]

_KEPT_EVERY = 25
"""Every so many frames the readings of all elements are kept, for plots of patterns."""
_LATENCY_BINS = 100_001
"""Microseconds up to 0.1 s; the last bin takes what is longer."""


class BoardsNode:
    """All boards of a robot and their network."""

    role = Role.CELLS.value
    paced = False

    def __init__(self, deployment: Deployment, name: str) -> None:
        self.name = name
        keys = Keys(deployment.robot)
        self.subscriptions = (keys.of("pressures"), keys.of("config", BOARDS, "*"))
        self._body = Upstream("body", "body", covered_ns=-1)
        self.upstreams = {"body": self._body}
        self.senders = frozenset({"body"})
        self.peers = frozenset({"body", "controller", *deployment.hosts_of_skin()})
        self.tolerated = frozenset(deployment.run.may_be_lost)
        self.counters: Counter[str] = Counter()
        sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self._n_boards = len(sheets)
        self._requests: list[tuple[int, int]] = []
        self._n_elements = sum(sheet.n_elements for sheet in sheets)
        self._boards = Boards(sheets, deployment.boards, deployment.board_network, deployment.seed)
        self._key = keys.of("regions", BOARDS)
        self._counters_key = keys.of("counters", name)
        self._period_ns = deployment.boards.period_ns
        self._end_ns = deployment.max_ns
        self._frame = 0
        self._pressures: dict[int, NDArray[np.float32]] = {}
        self._seq = 0
        self._log = hashlib.sha256()
        self._latency_us = np.zeros(_LATENCY_BINS, dtype=np.int64)
        self._latency_max_ns = 0
        self._kept: list[tuple[int, NDArray[np.float32]]] = []

    def start(self, put: Put) -> None:
        """Boards wait for the first pressures."""

    def needs(self) -> dict[str, int] | None:
        """The pressures at both ends of the next period."""
        end_ns = self.due_ns()
        return None if end_ns > self._end_ns else {"body": end_ns}

    def due_ns(self) -> int:
        """End of the next period."""
        return (self._frame + 1) * self._period_ns

    def accept(self, channel: str, fields: tuple[str, ...], payload: bytes) -> None:
        """Takes in pressures, or a stranger's request for raw patterns."""
        if channel == "config":
            self._accept_request(decode(payload, Config))
            return
        if channel != "pressures":
            raise ProtocolError(f"a host of boards does not read {channel}")
        pressures = decode(payload, Pressures)
        values = unpack(pressures.values, "<f4")
        if len(values) != self._n_elements:
            raise ProtocolError(f"pressures of {len(values)} elements; there are {self._n_elements}")
        self._pressures[pressures.t_ns] = values
        self._body.close(pressures.covered_ns)
        if pressures.end_ns is not None:
            self._end_ns = min(self._end_ns, pressures.end_ns)

    def _accept_request(self, config: Config) -> None:
        if config.patch != BOARDS or not 0 <= config.cell < self._n_boards:
            raise ProtocolError(f"config of board {config.cell}: there are boards 0 to {self._n_boards - 1}")
        if config.pattern_every is None or config.pattern_every < 0:
            raise ProtocolError(f"config of board {config.cell}: give pattern_every, 0 or more frames")
        self.counters["configs_from_outside"] += 1
        self._requests.append((config.cell, config.pattern_every))

    def lose(self, upstream: Upstream) -> None:
        """Without the body there is nothing to feel; it may never be lost."""

    def step(self, put: Put) -> None:
        """Computes one period."""
        start_ns = self._frame * self._period_ns
        before, after = self._pressures.pop(start_ns), self._pressures[start_ns + self._period_ns]
        for board, every in self._requests:
            self._boards.request(start_ns, board, every)
        self._requests.clear()
        told = self._boards.step(self._frame, before, after)
        if self._frame % _KEPT_EVERY == 0:
            self._kept.append((start_ns, self._boards.readings_kpa.astype(np.float32)))
        self._frame += 1
        end_ns = start_ns + self._period_ns
        if end_ns % NS_PER_S < self._period_ns or end_ns + self._period_ns > self._end_ns:
            put(self._counters_key, encode(self._counted(end_ns)))
        message = Regions(
            t_ns=start_ns,
            covered_ns=end_ns,
            frames=told.frames.tobytes(),
            rows=told.rows.tobytes(),
            patterns=told.patterns.tobytes(),
            seq=self._seq,
        )
        self._seq += len(told.frames)
        latency_ns = told.frames["t_delivered_ns"] - told.frames["t_sampled_ns"]
        if len(latency_ns):
            np.add.at(self._latency_us, np.minimum(latency_ns // 1000, _LATENCY_BINS - 1), 1)
            self._latency_max_ns = max(self._latency_max_ns, int(latency_ns.max()))
        payload = encode(message)
        self._log.update(payload)
        put(self._key, payload)

    def _counted(self, t_ns: int) -> Counters:
        """What the board network and this process have counted until `t_ns`."""
        messages = self._boards.counters()
        counts = {f"{kind}.{what}": n for kind, entry in messages.items() for what, n in entry.items()}
        return Counters(host=self.name, t_ns=t_ns, counts=counts | dict(self.counters))

    def news(self) -> tuple[()]:
        """All that boards have to say is part of the run."""
        return ()

    def result(self) -> Part:
        """Counters of the board network and its latencies."""
        facts = {
            "logs": {self.name: self._log.hexdigest()},
            "boards": self._boards.counters(),
            "latency_max_ns": self._latency_max_ns,
        }
        arrays = {
            "latency_us": self._latency_us,
            "pattern_t_ns": np.array([t_ns for t_ns, _ in self._kept], dtype=np.int64),
            "pattern_kpa": np.array([kpa for _, kpa in self._kept]).reshape(-1, self._n_elements),
        }
        return Part(self.name, "boards", facts, arrays)
