"""The script: who is pressed, how hard, and that any frame follows from (seed, name, time) alone."""

import math

import numpy as np
import pytest

from skinnet.body.scripted.presses import build_press_schedule, presses_before, write_press_stimulus
from skinnet.deployment.checks.environment import check_scripted_stimuli
from skinnet.deployment.environment.scripted_stimuli import (
    RandomPressSpec,
    ScriptedPressSpec,
    ScriptedStimuliSpec,
)
from skinnet.errors import DeploymentError
from skinnet.protocol.messages import STIMULUS_NAMES

MS = 1_000_000
SIZES = {"chest": 61, "arm": 40}
N = sum(SIZES.values())
AMBIENT_C = 21.0
DISTANCE, WARMTH = (STIMULUS_NAMES.index(name) for name in ("distance_m", "temperature_c"))
TOUCH = ScriptedPressSpec(
    cells=("arm/7",),
    start_s=0.2,
    force_n=2.5,
    approach_m=0.06,
    approach_s=0.3,
    rise_s=0.1,
    hold_s=0.4,
    release_s=0.2,
    temperature_c=35.0,
)
CONTACT_MS, LOOSE_MS, END_MS = 500, 1200, 1500
ROW = 61 + 7


def felt(script, times_ms, seed=1, sizes=SIZES):
    """Stimuli (times, n, 8) and the presses."""
    presses = build_press_schedule(script, seed, sizes)
    n = sum(sizes.values())
    frames = np.full((len(times_ms), n, len(STIMULUS_NAMES)), np.nan)
    for frame, t_ms in zip(frames, times_ms, strict=True):
        write_press_stimulus(presses, round(t_ms * MS), np.full(n, AMBIENT_C), frame)
    return frames, presses


def test_a_touch_has_the_course_that_it_is_given():
    times_ms = np.arange(0, 2000, 4)
    frames, _ = felt(ScriptedStimuliSpec(presses=(TOUCH,)), times_ms)
    mine = frames[:, ROW]
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((times_ms - CONTACT_MS) / 100, 0, 1))
    fall = 0.5 - 0.5 * np.cos(np.pi * np.clip((LOOSE_MS - times_ms) / 200, 0, 1))
    for element in range(3):
        np.testing.assert_allclose(mine[:, element], 2.5 * rise * fall, atol=1e-12)
    away_ms = np.maximum(np.maximum(CONTACT_MS - times_ms, times_ms - LOOSE_MS), 0)
    there = (times_ms >= 200) & (times_ms < END_MS)
    np.testing.assert_allclose(mine[there, DISTANCE], 0.06 * away_ms[there] / 300)
    assert np.isinf(mine[~there, DISTANCE]).all()
    touching = away_ms == 0
    assert (mine[touching, WARMTH] == 35.0).all()
    assert (mine[~touching, WARMTH] == AMBIENT_C).all()
    others = np.delete(frames, ROW, axis=1)
    assert not others[:, :, :3].any()
    assert np.isinf(others[:, :, DISTANCE]).all()
    assert np.isnan(others[:, :, 4:7]).all(), "accelerations are not the script's"


@pytest.mark.parametrize("share", [0.0, 0.01, 0.333, 0.5, 0.55, 1.0])
def test_exactly_the_share_is_stimulated(share):
    presses = build_press_schedule(ScriptedStimuliSpec(stimulated_fraction=share), 1, SIZES)
    assert len(presses.cell_row) == len(set(presses.cell_row.tolist())) == round(share * N)


def test_cells_are_chosen_by_their_names_and_the_seed():
    some, more, others = (
        set(
            build_press_schedule(
                ScriptedStimuliSpec(stimulated_fraction=share), seed, SIZES
            ).cell_row.tolist()
        )
        for share, seed in ((0.3, 1), (0.6, 1), (0.3, 2))
    )
    assert some < more
    assert some != others
    swapped = {"arm": 40, "chest": 61}
    moved = {
        row + 61 if row < 40 else row - 40
        for row in build_press_schedule(ScriptedStimuliSpec(stimulated_fraction=0.3), 1, swapped).cell_row
    }
    assert moved == some


def test_a_cell_feels_the_same_whatever_else_there_is():
    script = ScriptedStimuliSpec(stimulated_fraction=1.0)
    times_ms = range(0, 6000, 40)
    both, _ = felt(script, times_ms)
    alone, _ = felt(script, times_ms, sizes={"arm": 40})
    np.testing.assert_array_equal(both[:, 61:], alone)


def test_frames_stand_alone():
    script = ScriptedStimuliSpec(stimulated_fraction=0.7, presses=(TOUCH,))
    times_ms = np.arange(0, 5000, 36)
    forwards, presses = felt(script, times_ms)
    shuffled = np.random.default_rng(3).permutation(len(times_ms))
    again = np.zeros((N, len(STIMULUS_NAMES)))
    for index in shuffled:
        write_press_stimulus(presses, int(times_ms[index]) * MS, np.full(N, AMBIENT_C), again)
        np.testing.assert_array_equal(
            again[:, [0, 1, 2, DISTANCE, WARMTH]], forwards[index][:, [0, 1, 2, 3, 7]]
        )


def test_forces_stay_in_range_and_are_smooth():
    spec = RandomPressSpec(force_n=(1.0, 4.0), modulation=0.1, force_spread=0.4)
    frames, _ = felt(
        ScriptedStimuliSpec(stimulated_fraction=1.0, random_presses=spec), np.arange(0, 12_000, 4)
    )
    force_n = frames[:, :, :3]
    assert force_n.min() == 0.0
    assert 3.9 < force_n.max() <= 4.4
    steepest_n_s = 4.4 * math.pi / (2 * spec.rise_s) + 4.0 * 0.1 * 2 * math.pi * spec.modulation_hz
    assert np.abs(np.diff(force_n, axis=0)).max() <= steepest_n_s * 0.004
    most = force_n.max(axis=2)
    pressed = most > 0
    assert force_n.min(axis=2)[pressed] == pytest.approx(most[pressed], rel=0.4 + 1e-9)
    assert (force_n.argmax(axis=2)[pressed, None] == range(3)).any(axis=0).all(), "each is pressed most once"


def test_the_mean_force_is_that_of_the_truth():
    """Impulse of each press = held force × (hold + half of rise and release); the modulation averages out."""
    spec = RandomPressSpec(modulation=0.2, modulation_hz=40.0, force_spread=0.0)
    times_ms = np.arange(0, 9000, 1.0)
    frames, presses = felt(ScriptedStimuliSpec(stimulated_fraction=0.2, random_presses=spec), times_ms)
    truth = presses_before(presses, 9000 * MS)
    whole = truth[truth["end_ns"] <= 9000 * MS]
    assert len(whole) >= 40
    for row in whole:
        span = (times_ms * MS >= row["begin_ns"]) & (times_ms * MS < row["end_ns"])
        impulse_n_s = frames[span, row["cell"], 0].sum() * 1e-3
        assert impulse_n_s == pytest.approx(row["force_n"] * (1.0 + 0.5 * (0.15 + 0.15)), rel=0.01)


def test_the_truth_says_when_cells_were_touched():
    times_ms = np.arange(0, 9000, 1)
    frames, presses = felt(ScriptedStimuliSpec(stimulated_fraction=0.5, presses=(TOUCH,)), times_ms)
    truth = presses_before(presses, 9000 * MS)
    touched = np.zeros((len(times_ms), N), dtype=bool)
    near = np.zeros_like(touched)
    for row in truth:
        touched[
            (times_ms * MS >= row["contact_ns"]) & (times_ms * MS <= row["contact_end_ns"]), row["cell"]
        ] = True
        near[(times_ms * MS >= row["begin_ns"]) & (times_ms * MS < row["end_ns"]), row["cell"]] = True
    np.testing.assert_array_equal(frames[:, :, DISTANCE] == 0.0, touched)
    np.testing.assert_array_equal(np.isfinite(frames[:, :, DISTANCE]), near)
    assert (np.diff(truth["begin_ns"]) >= 0).all()


def test_many_cells_are_in_contact_at_once():
    spec = RandomPressSpec()
    frames, _ = felt(ScriptedStimuliSpec(stimulated_fraction=0.55), np.arange(6000, 12_000, 20))
    at_once = (frames[:, :, DISTANCE] == 0.0).sum(axis=1)
    touching_share = (spec.rise_s + spec.hold_s + spec.release_s) / (spec.period_ns * 1e-9)
    assert at_once.mean() == pytest.approx(round(0.55 * N) * touching_share, rel=0.1)
    assert at_once.min() > 0.2 * N * 0.55


def test_a_hug_presses_once_and_together():
    spec = RandomPressSpec(repeat=False, onset_spread_s=0.2, start_s=1.0)
    frames, presses = felt(
        ScriptedStimuliSpec(stimulated_fraction=0.8, random_presses=spec), np.arange(0, 20_000, 20)
    )
    touching = (frames[:, :, DISTANCE] == 0.0).sum(axis=1)
    assert touching.max() == round(0.8 * N)
    assert len(presses_before(presses, 10**12)) == round(0.8 * N)
    assert not touching[round((1.2 + spec.duration_ns * 1e-9) / 0.02) :].any()


def test_touches_repeat_and_add_up():
    every = ScriptedPressSpec(cells=("arm/7", "arm/8"), start_s=0.0, force_n=1.0, period_s=3.0)
    one, _ = felt(ScriptedStimuliSpec(presses=(every,)), np.arange(0, 3000, 4))
    later, _ = felt(ScriptedStimuliSpec(presses=(every,)), np.arange(9000, 12_000, 4))
    np.testing.assert_array_equal(one, later)
    assert one[:, ROW, 0].max() == 1.0
    both, _ = felt(ScriptedStimuliSpec(presses=(every, TOUCH)), np.arange(0, 3000, 4))
    single, _ = felt(ScriptedStimuliSpec(presses=(TOUCH,)), np.arange(0, 3000, 4))
    np.testing.assert_allclose(both[:, :, :3], one[:, :, :3] + single[:, :, :3])
    np.testing.assert_array_equal(
        both[:, :, DISTANCE], np.minimum(one[:, :, DISTANCE], single[:, :, DISTANCE])
    )


@pytest.mark.parametrize(
    ("patterns", "expected"),
    [
        (("arm/3",), [("arm", 3)]),
        (("arm/*", "arm/3"), [("arm", cell) for cell in range(40)]),
        (("*/60",), [("chest", 60)]),
        (("arm/0", "*/0"), [("chest", 0), ("arm", 0)]),
        (("*/*",), [("chest", cell) for cell in range(61)] + [("arm", cell) for cell in range(40)]),
    ],
)
def test_patterns_name_each_cell_once(patterns, expected):
    script = ScriptedStimuliSpec(presses=(ScriptedPressSpec(cells=patterns, start_s=0.0, force_n=1.0),))
    assert script.pressed_cells(0, SIZES) == expected


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            ScriptedStimuliSpec(presses=(ScriptedPressSpec(cells=("leg/1",), start_s=0, force_n=1),)),
            "unknown patch.*chest, arm",
        ),
        (
            ScriptedStimuliSpec(presses=(ScriptedPressSpec(cells=("arm/40",), start_s=0, force_n=1),)),
            "arm has cells 0 to 39",
        ),
        (
            ScriptedStimuliSpec(presses=(ScriptedPressSpec(cells=("*/61",), start_s=0, force_n=1),)),
            "cells 0 to 60",
        ),
        (
            ScriptedStimuliSpec(
                presses=(ScriptedPressSpec(cells=("arm/1",), start_s=0, force_n=1, period_s=1.8),)
            ),
            r"presses\[0\].period_s = 1.8: .* 1.9 s",
        ),
        (ScriptedStimuliSpec(random_presses=RandomPressSpec(force_n=(2.0, 1.0))), r"force_n = \[2, 1\]"),
    ],
)
def test_a_script_that_does_not_hold_is_refused(script, words):
    with pytest.raises(DeploymentError, match=words):
        check_scripted_stimuli(script, SIZES)
