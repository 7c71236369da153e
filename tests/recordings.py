"""Recordings for tests, made by the plain MCAP writer from what goes through a run in one process."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from rich.console import Console

from skinnet.channels import CHANNELS, Keys
from skinnet.deployment import Deployment, resolved_json
from skinnet.messages import decode
from skinnet.run.in_process import run_in_process
from skinnet.run.progress import Progress
from skinnet.transport.base import Transport
from skinnet.watch_messages import ProcessLoad

BASE = Path(__file__).parents[1] / "deployments"
LEFT_OUT = ("stimulus", "pressures", "frame", "request")


class Recorder:
    """Takes the place of the window for outsiders, and writes what it sees."""

    def __init__(self, deployment: Deployment, path: Path, chunk_size: int = 100_000) -> None:
        self.counts: dict[str, int] = {}
        self._keys = Keys(deployment.robot)
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        self._writer.start(profile="skinnet", library="test")
        self._writer.add_attachment(0, 0, "deployment.json", "application/json", resolved_json(deployment))
        self._writer.add_metadata("skinnet", {"base": str(BASE), "schema": "1"})
        self._channels: dict[str, int] = {}
        self._other = self._writer.register_channel("/tf", "json", 0)

    def open(self, inner: Transport) -> None:
        for row in CHANNELS:
            if row.name not in LEFT_OUT:
                expression = self._keys.of(row.name, *["*"] * row.pattern.count("<"))
                (inner.overhear if row.receivers else inner.tap)(expression, self.write)

    def write(self, key: str, payload: bytes) -> None:
        row, _ = self._keys.parse(key)
        message: Any = decode(payload, row.message)
        t_ns = message.t_delivered_ns[-1] if row.message.__name__ == "Events" else message.t_ns
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(key, "msgpack", 0)
        self._writer.add_message(self._channels[key], t_ns, payload, t_ns)
        self._writer.add_message(self._other, t_ns, json.dumps({"t": t_ns}).encode(), t_ns)
        self.counts[row.name] = self.counts.get(row.name, 0) + 1

    def tell_processes(self, load: Callable[[], ProcessLoad]) -> None:
        """A recording knows nothing of processes."""

    def leave(self) -> None:
        pass

    def close(self) -> None:
        self._writer.finish()
        self._file.close()


def record(deployment: Deployment, path: Path, base: Path = BASE) -> dict[str, int]:
    """Runs `deployment` in this process and records it; returns the number of messages by channel."""
    recorder: Any = Recorder(deployment, path)
    progress = Progress(Console(), quiet=True)
    asyncio.run(run_in_process(deployment, base, path.parent, progress, recorder))
    recorder.close()
    counts: dict[str, int] = recorder.counts
    return counts
