"""Recordings for tests: made once for a session, and read with the plain library of MCAP."""

from pathlib import Path
from typing import Any, NamedTuple

import pytest
from launching import TOUCH, run
from locations import ROOT
from mcap.reader import make_reader

ARM = ROOT / "deployments" / "two_link_arm.toml"
CYLINDER = ROOT / "deployments" / "riba_cylinder.toml"
SHORT_ARM = ("run.max_s=2.0", "controller.structure.settle_s=0.1", "controller.structure.averaging_s=0.1")
SHORT_CYLINDER = ("nursing.waypoints.0.t_s=0.5", "nursing.settle_s=0.2", "nursing.hold_s=0.8")
SHORT_TOUCH = (
    'controller.program=["map", "force_guidance"]',
    "controller.map.periods=1",
    "controller.map.frequency_hz=8",
    "controller.map.settle_s=0.05",
    "controller.stages.force_guidance.duration_s=2.0",
)
SHORT = {
    "arm": (ARM, SHORT_ARM),
    "cylinder": (CYLINDER, SHORT_CYLINDER),
    "touch": (TOUCH, SHORT_TOUCH),
}


class Plain(NamedTuple):
    """A message as the plain reader gives it."""

    topic: str
    t_ns: int
    sequence: int
    payload: bytes
    schema: str


def record(name: str, out: Path, *arguments: str, settings: tuple[str, ...] = ()) -> dict[str, Any]:
    """Summary of a short recorded run."""
    file, short = SHORT[name]
    return run(file, out, "--record", *arguments, settings=short + settings)


_made: dict[str, tuple[Path, dict[str, Any]]] = {}


def recorded_once(name: str, folders: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Folder and summary of a short recorded run in one process, which all tests share and none changes."""
    if name not in _made:
        folder = folders.mktemp(name)
        _made[name] = folder, record(name, folder, "--in-process")
    return _made[name]


def plain(path: Path) -> list[Plain]:
    """All messages of a whole recording, in the order of the file."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [
            Plain(channel.topic, message.log_time, message.sequence, bytes(message.data), schema.name)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
            if schema is not None
        ]
