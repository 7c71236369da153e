"""Full readings tell the levels, so a lost event is made up for while a cell streams."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.touch.tactile_state import REACTION_COLUMNS, LevelThresholds, TactileState
from skinnet.deployment.skin.cells import CellSpec, ForceSpec, ProximitySpec
from skinnet.protocol.messages import EventKind, Modality

LEVELS = {"force": (0.1, 0.3, 0.6), "proximity": (0.2, 0.8)}
HYSTERESIS = 0.05
SPEC = CellSpec(
    force=ForceSpec(levels=LEVELS["force"], hysteresis=HYSTERESIS),
    proximity=ProximitySpec(levels=LEVELS["proximity"], hysteresis=HYSTERESIS),
)
TABLES = [np.float32(LEVELS["force"])] * 3 + [np.float32(LEVELS["proximity"])]
PERIOD_NS = 4_000_000


def state(spec: CellSpec = SPEC) -> TactileState:
    return TactileState(1, level_thresholds=LevelThresholds.from_spec(spec))


def levels(tactile_state: TactileState) -> list[int]:
    return [int(tactile_state.level(modality)[0]) for modality in (Modality.FORCE, Modality.PROXIMITY)]


def send_event(tactile_state: TactileState, t_ns: int, column: int, level: int, value: float) -> None:
    integers = [0, t_ns, int(column == 3), column % 3, EventKind.LEVEL_CROSSING, level]
    tactile_state.apply_events(*(np.array([one], dtype=np.int64) for one in integers), np.array([value]))


def send_row(tactile_state: TactileState, t_ns: int, reading: NDArray[np.float32]) -> None:
    tactile_state.apply_stream(np.array([0]), np.array([t_ns]), reading[None])


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_levels_are_those_of_the_cell_whatever_events_are_lost(seed: int, loss: float) -> None:
    dice = np.random.default_rng(seed)
    tactile_state, true = state(), np.zeros(4, dtype=int)
    lost = 0
    for frame in range(60):
        reading = np.float32(np.abs(np.cumsum(dice.normal(0.0, 0.2, 8))) % 1.0)
        for column, table in enumerate(TABLES):
            # at least as many levels as thresholds reached, at most as many as not left
            kept = int(np.sum(reading[column] >= table.astype(float) - HYSTERESIS))
            level = min(max(int(true[column]), int(np.sum(reading[column] >= table))), kept)
            if level != true[column] and dice.random() < loss:
                lost += 1
            elif level != true[column]:
                send_event(tactile_state, frame * PERIOD_NS, column, level, float(reading[column]))
            true[column] = level
        send_row(tactile_state, frame * PERIOD_NS, reading)
        assert levels(tactile_state) == [true[:3].max(), true[3]]
    assert tactile_state.missed_level_events == lost


def test_a_lost_fall_ends_the_stream_as_if_it_had_come() -> None:
    tactile_state, gains = state(), np.ones((1, 4))
    send_event(tactile_state, 0, 1, 2, 0.4)
    assert tactile_state.cells_to_stream(0, gains).all()
    for frame in range(1, 200):
        send_row(tactile_state, frame * PERIOD_NS, np.zeros(8, dtype=np.float32))
        wanted = bool(tactile_state.cells_to_stream(frame * PERIOD_NS, gains)[0])
        assert wanted == (frame * PERIOD_NS <= 500_000_000)
    assert tactile_state.missed_level_events == 1


def test_an_older_row_does_not_undo_a_newer_event() -> None:
    tactile_state, reading = state(), np.zeros(8, dtype=np.float32)
    send_event(tactile_state, 2 * PERIOD_NS, 0, 1, 0.15)
    send_row(tactile_state, PERIOD_NS, reading)
    assert levels(tactile_state) == [1, 0]
    assert tactile_state.missed_level_events == 0


def test_a_cell_whose_events_have_other_thresholds_is_believed() -> None:
    """Another client has set them: 0.4 is level 2 by ours."""
    tactile_state, reading = state(), np.zeros(8, dtype=np.float32)
    reading[REACTION_COLUMNS] = 0.4
    send_event(tactile_state, 0, 0, 1, 0.4)
    send_row(tactile_state, PERIOD_NS, reading)
    assert levels(tactile_state) == [1, 0]
    assert tactile_state.missed_level_events == 0


@pytest.mark.parametrize("reading", [np.inf, np.nan])
def test_a_row_that_is_refused_tells_no_level(reading: float) -> None:
    tactile_state, row = state(), np.zeros(8, dtype=np.float32)
    row[0], row[7] = 0.4, reading
    send_row(tactile_state, 0, row)
    assert levels(tactile_state) == [0, 0]
    assert (tactile_state.rejected, tactile_state.missed_level_events) == (1, 0)


def test_a_channel_that_the_modality_does_not_have_is_refused() -> None:
    tactile_state = state()
    before = tactile_state.rejected
    send_event(tactile_state, 0, column=2, level=1, value=0.2)
    assert tactile_state.rejected == before
    for modality, channel in ((Modality.PROXIMITY, 1), (Modality.FORCE, 3), (Modality.FORCE, -1)):
        integers = [0, PERIOD_NS, modality, channel, EventKind.LEVEL_CROSSING, 1]
        columns = (np.array([one], dtype=np.int64) for one in integers)
        tactile_state.apply_events(*columns, np.array([0.9]))
        before += 1
        assert tactile_state.rejected == before, (modality, channel)
    assert levels(tactile_state) == [1, 0]
