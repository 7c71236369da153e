"""Whole runs in which links destroy level events: a touched cell streams all the same, and then stops."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launching import run
from recorded import ARM, plain

from skinnet.protocol.messages import STREAM_ROW, Stream, decode

pytestmark = pytest.mark.timeout(120)

TOUCHED = 1
RISE_S, FALL_S = 2.25, 2.95
"""When the force begins to rise, and when it begins to fall; each takes 50 ms."""
SETTINGS = (
    'controller.program=["map", "evade"]',
    "controller.map.periods=1",
    "controller.map.frequency_hz=8",
    "controller.map.settle_s=0.05",
    "controller.stages.evade.duration_s=2.9",
    "teacher.touches=[]",
    f'scripted_stimuli.presses=[{{cells=["fore_link/{TOUCHED}"], start_s={RISE_S - 0.3}, force_n=2.0, '
    "rise_s=0.05, hold_s=0.65, release_s=0.05}]",
)


def streamed(out: Path, *settings: str) -> tuple[list[tuple[float, float]], dict[str, Any]]:
    """Times [s] during which the touched cell streamed while the robot evades, and the run's metrics."""
    summary = run(ARM, out, "--in-process", "--record", settings=SETTINGS + settings)
    rows = [
        np.frombuffer(decode(message.payload, Stream).rows, dtype=STREAM_ROW)
        for message in plain(out / "run.mcap")
        if message.topic.endswith("skin/fore_link/stream")
    ]
    table = np.concatenate(rows)
    t_s = np.sort(table["t_delivered_ns"][table["cell"] == TOUCHED]) * 1e-9
    t_s = t_s[t_s > RISE_S - 0.2]
    parts = np.split(t_s, np.flatnonzero(np.diff(t_s) > 0.1) + 1)
    return [(part[0], part[-1]) for part in parts if len(part)], summary["metrics"]


def loss(at_s: float, until_s: float) -> str:
    return (
        f'faults=[{{kind="loss", target="fore_link", probability=1.0, at_s={at_s}, '
        f"duration_s={round(until_s - at_s, 3)}}}]"
    )


def test_without_losses_nothing_is_repeated_where_touches_are_answered(tmp_path: Path) -> None:
    ((begin_s, end_s),), metrics = streamed(tmp_path)
    assert RISE_S < begin_s < RISE_S + 0.05
    assert FALL_S + 0.5 < end_s < FALL_S + 0.6
    assert metrics["network.level_repeats"] == metrics["network.missed_level_events"] == 0


def test_a_rise_that_a_link_destroys_is_repeated(tmp_path: Path) -> None:
    until_s = RISE_S + 0.08
    ((begin_s, _),), metrics = streamed(tmp_path / "repeated", loss(RISE_S - 0.05, until_s))
    assert until_s < begin_s < RISE_S + 0.05 + 0.1 + 0.03  # the last crossing, the interval, the answer
    assert metrics["network.level_repeats"] > 0
    # what it is like without
    settings = (loss(RISE_S - 0.05, until_s), "cells.encoding.repeat_ms=0")
    ((begin_s, _),), metrics = streamed(tmp_path / "silent", *settings)
    assert begin_s > FALL_S
    assert metrics["network.level_repeats"] == 0


def test_a_fall_that_a_link_destroys_shows_in_the_readings(tmp_path: Path) -> None:
    until_s = FALL_S + 0.2
    *_, (_, end_s) = streamed(tmp_path, loss(FALL_S - 0.02, until_s))[0]
    assert until_s + 0.4 < end_s < until_s + 0.6


def test_every_touch_is_answered_at_a_loss_of_a_fifth_on_every_link(tmp_path: Path) -> None:
    parts, metrics = streamed(tmp_path, "network.loss=0.2", "seed=3")
    assert parts[0][0] < RISE_S + 0.4
    assert parts[-1][1] < FALL_S + 0.05 + 0.5 + 0.4
    assert metrics["network.dropped"] > 100
    assert metrics["network.missed_level_events"] + metrics["network.level_repeats"] > 0
