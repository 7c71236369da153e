"""Stuck, drifting and babbling cells: laws that hold whatever else the cells do."""

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats
from small_robot import patch, small

from cells.sensing.babbling_idiots import SpuriousEvents
from cells.sensing.sensor_faults import SensorFaults
from cells.sensing.transducers import (
    STANDARD_GRAVITY_M_S2,
    Transducers,
    channel_scales,
    noise_keys,
    phases_ns,
)
from skinnet.deployment.skin.cells import CellSpec
from skinnet.network.faults.fault_schedule import fault_schedule
from skinnet.protocol.messages import READING_NAMES, EventKind, Modality
from skinnet.skin.placement import place_patches

SPEC = CellSpec()
PERIOD_NS = SPEC.period_ns
ARM, HAND = patch("arm"), patch("hand", 2, 1)
PLACED = place_patches(small(ARM, HAND).patches, SPEC)
FIRST_CELL = {"arm": 0, "hand": 6}
N = 8
PHASES_NS = np.concatenate([phases_ns(1, p.name, p.n_cells, PERIOD_NS) for p in PLACED])


def faults(*rules: dict[str, Any], seed: int = 1, first_cell: dict[str, int] | None = None) -> SensorFaults:
    deployment = small(ARM, HAND, faults=rules, seed=seed)
    return SensorFaults(fault_schedule(deployment, PLACED), first_cell or FIRST_CELL, SPEC, seed)


def column(name: str) -> int:
    return READING_NAMES.index(name)


def healthy(frames: Iterable[int]) -> NDArray[np.float32]:
    """Readings (frames, N, 8) of cells under a force of 1 N, and their noise."""
    transducers = Transducers(
        SPEC, np.concatenate([noise_keys(1, p.name, p.n_cells) for p in PLACED]), PHASES_NS
    )
    stimulus = np.tile([1.0, 1.0, 1.0, 0.01, 0.0, 0.0, STANDARD_GRAVITY_M_S2, 23.0], (N, 1))
    series = []
    for frame in frames:
        out = np.empty((N, 8), dtype=np.float32)
        transducers.sample(frame, stimulus, stimulus, out)
        series.append(out)
    return np.array(series)


def sick(broken: SensorFaults, series: NDArray[np.float32], first: int = 0) -> NDArray[np.float32]:
    """The same readings after the faults."""
    series = series.copy()
    for frame, readings in enumerate(series, start=first):
        start_ns = frame * PERIOD_NS
        broken.apply(start_ns, start_ns + PHASES_NS, readings)
    return series


def sampled_ns(n: int) -> NDArray[np.int64]:
    """(n, N) when every sample was taken."""
    return np.arange(n)[:, None] * PERIOD_NS + PHASES_NS


SERIES = healthy(range(500))


@pytest.mark.parametrize("at_s", [None, 0.5013])
def test_a_stuck_channel_keeps_its_first_reading_and_no_other_is_touched(at_s: float | None) -> None:
    when = {} if at_s is None else {"at_s": at_s}
    rule = {"kind": "stuck_at", "target": "hand/1", "channel": "ay_g", **when}
    out = sick(faults(rule), SERIES)
    since = sampled_ns(500)[:, 7] >= round((at_s or 0.0) * 1e9)
    ay = column("ay_g")
    assert np.ptp(SERIES[since, 7, ay]) > 0.01
    assert np.all(out[since, 7, ay] == SERIES[since, 7, ay][0])
    out[since, 7, ay] = SERIES[since, 7, ay]
    assert np.array_equal(out, SERIES)


def test_a_fault_begins_and_ends_at_its_cells_own_samples() -> None:
    """One instant falls before some cells' samples of a frame and after others'."""
    at_ns, until_ns = 100 * PERIOD_NS + 1_700_000, 300 * PERIOD_NS + 2_100_000
    rule = {"kind": "stuck_at", "target": "*", "channel": "temperature_c", "value": 50.04}
    out = sick(faults(rule | {"at_s": at_ns * 1e-9, "duration_s": (until_ns - at_ns) * 1e-9}), SERIES)
    inside = (sampled_ns(500) >= at_ns) & (sampled_ns(500) < until_ns)
    assert 0 < inside[100].sum() < N
    assert 0 < inside[300].sum() < N
    warmth = column("temperature_c")
    assert np.array_equal(out[..., warmth], np.where(inside, np.float32(834 * 0.06), SERIES[..., warmth]))


def test_all_channels_stick_at_once_each_at_its_own_value() -> None:
    out = sick(faults({"kind": "stuck_at", "target": "arm/2", "channel": "all", "at_s": 1.0}), SERIES)
    since = sampled_ns(500)[:, 2] >= 1_000_000_000
    assert np.all(out[since, 2] == SERIES[since, 2][0])
    out[since, 2] = SERIES[since, 2]
    assert np.array_equal(out, SERIES)


def test_a_value_goes_to_the_nearest_step_of_its_sensor() -> None:
    rules = [
        {"kind": "stuck_at", "target": "arm/0", "channel": "force2", "value": 0.5004},
        {"kind": "stuck_at", "target": "arm/0", "channel": "ax_g", "value": -1.2345},
    ]
    out = sick(faults(*rules), SERIES[:3])
    assert np.all(out[:, 0, column("force2")] == 512 / 1024)
    assert out[:, 0, column("ax_g")] == pytest.approx(-309 * 0.004)


@pytest.mark.parametrize(
    ("channel", "rate_per_s"),
    [("force0", 0.05), ("proximity", -0.02), ("az_g", -0.7), ("temperature_c", 1.5)],
)
def test_a_drift_has_its_slope_by_least_squares(channel: str, rate_per_s: float) -> None:
    at_s = 0.4
    out = sick(
        faults(
            {"kind": "drift", "target": "arm/3", "channel": channel, "rate_per_s": rate_per_s, "at_s": at_s}
        ),
        SERIES,
    )
    t_s = sampled_ns(500)[:, 3] * 1e-9
    since, what = t_s >= at_s, column(channel)
    offset = (out[:, 3, what] - SERIES[:, 3, what]).astype(np.float64)
    assert np.all(offset[~since] == 0.0)
    fit = stats.linregress(t_s[since], offset[since])
    step = channel_scales(SPEC).lsb[what]
    # an offset is rounded to steps: errors up to half of one, of variance step² / 12
    spread = math.sqrt(step**2 / 12.0 / (since.sum() * t_s[since].var()))
    assert fit.slope == pytest.approx(rate_per_s, abs=6 * spread)
    assert fit.intercept + fit.slope * at_s == pytest.approx(0.0, abs=step)
    assert np.abs(offset[since] - rate_per_s * (t_s[since] - at_s)).max() <= 0.5 * step + 1e-6
    out[:, 3, what] = SERIES[:, 3, what]
    assert np.array_equal(out, SERIES)


@pytest.mark.parametrize(
    ("channel", "rate_per_s", "end"),
    [("force0", 50.0, 1.0), ("force0", -50.0, 0.0), ("ax_g", -99.0, -8.0), ("temperature_c", 999.0, 54.96)],
)
def test_a_drift_ends_at_the_range_of_its_sensor_and_with_its_rule(
    channel: str, rate_per_s: float, end: float
) -> None:
    rule = {
        "kind": "drift",
        "target": "arm/3",
        "channel": channel,
        "rate_per_s": rate_per_s,
        "duration_s": 1.0,
    }
    out = sick(faults(rule), SERIES)[:, 3, column(channel)]
    healed = sampled_ns(500)[:, 3] >= 1_000_000_000
    low, high = SERIES[..., column(channel)].min(), SERIES[..., column(channel)].max()
    assert out[~healed][-100:] == pytest.approx(end, abs=1e-5)
    assert min(low, end) - 1e-5 <= out.min() <= out.max() <= max(high, end) + 1e-5
    assert np.array_equal(out[healed], SERIES[healed, 3, column(channel)])


def test_drifts_add_up_and_what_is_stuck_drifts_no_more_whatever_the_order_of_the_rules() -> None:
    drift = {"kind": "drift", "target": "arm/1", "channel": "az_g", "rate_per_s": 0.5}
    stuck = {"kind": "stuck_at", "target": "arm/1", "channel": "az_g", "at_s": 1.0}
    what = column("az_g")
    twice = sick(faults(drift, drift), SERIES)[:, 1, what]
    once = sick(faults(drift | {"rate_per_s": 1.0}), SERIES)[:, 1, what]
    assert np.abs(twice - once).max() <= 0.004 + 1e-6
    held = sick(faults(stuck, drift), SERIES)[:, 1, what]
    assert np.array_equal(held, sick(faults(drift, stuck), SERIES)[:, 1, what])
    since = sampled_ns(500)[:, 1] >= 1_000_000_000
    assert np.ptp(held[since]) == 0.0
    assert held[since][0] == pytest.approx(1.5, abs=0.03)


@pytest.mark.parametrize(
    "rules", [[], [{"kind": "stuck_at", "target": "arm", "channel": "all", "at_s": 100.0}]]
)
def test_without_a_fault_not_a_bit_changes(rules: list[dict[str, Any]]) -> None:
    broken = faults(*rules)
    assert sick(broken, SERIES).tobytes() == SERIES.tobytes()
    assert all(len(part) == 0 for part in broken.spurious_events(0, 10**9))
    untouched = SERIES[0].copy()
    untouched.flags.writeable = False
    broken.apply(0, PHASES_NS, untouched)  # it does not even look


def test_a_fault_that_is_over_costs_nothing_any_more() -> None:
    broken = faults({"kind": "stuck_at", "target": "arm", "channel": "all", "at_s": 0.1, "duration_s": 0.2})
    sick(broken, SERIES[:100])
    untouched = SERIES[100].copy()
    untouched.flags.writeable = False
    broken.apply(100 * PERIOD_NS, 100 * PERIOD_NS + PHASES_NS, untouched)


def test_a_host_knows_its_own_cells_only_and_by_its_own_numbers() -> None:
    rules = (
        {"kind": "stuck_at", "target": "*", "channel": "force0", "value": 1.0},
        {"kind": "babbling_idiot", "target": "*/1", "rate_hz": 500.0},
    )
    alone = faults(*rules, first_cell={"hand": 0})
    readings = SERIES[0, 6:].copy()
    alone.apply(0, PHASES_NS[6:], readings)
    assert np.all(readings[:, 0] == 1.0)
    together = said(faults(*rules), 0, 10**9)
    mine = together.cell == 7
    assert 0 < mine.sum() < len(mine)
    own = said(alone, 0, 10**9)
    assert np.all(own.cell == 1)
    for column_alone, column_together in zip(own[1:], together[1:], strict=True):
        assert np.array_equal(column_alone, column_together[mine])


def said(broken: SensorFaults, *cuts_ns: int) -> SpuriousEvents:
    """What is babbled between the first cut and the last."""
    parts = [broken.spurious_events(a, b) for a, b in pairwise(cuts_ns)]
    return SpuriousEvents._make(map(np.concatenate, zip(*parts, strict=True)))


BABBLE = {
    "kind": "babbling_idiot",
    "target": "arm/4",
    "rate_hz": 800.0,
    "at_s": 0.5,
    "duration_s": 20.0,
}


def test_a_babbling_cell_is_a_poisson_process_of_its_rate() -> None:
    events = said(faults(BABBLE), 0, 30 * 10**9)
    assert np.all(events.cell == 4)
    assert events.t_ns.dtype == np.int64
    assert events.t_ns.min() >= 500_000_000
    assert events.t_ns.max() < 20_500_000_000
    n, expected = len(events.t_ns), 800.0 * 20.0
    assert n == pytest.approx(expected, abs=4 * math.sqrt(expected))
    gaps_s = np.diff(events.t_ns, prepend=500_000_000) * 1e-9
    assert stats.kstest(gaps_s * 800.0, "expon").pvalue > 1e-3
    counts = np.histogram(events.t_ns, bins=400)[0]  # no memory: counts scatter as their mean
    assert counts.var(ddof=1) / counts.mean() == pytest.approx(1.0, abs=4 * math.sqrt(2 / 399))


def test_it_says_anything_that_a_sensor_can_read() -> None:
    events = said(faults(BABBLE | {"rate_hz": 4000.0}), 0, 30 * 10**9)
    assert np.all(events.kind == EventKind.SEND_ON_DELTA)
    assert np.all(events.level == 0)
    first = np.array([0, 3, 4, 7])[events.modality]
    what = first + events.channel
    assert stats.chisquare(np.bincount(what, minlength=8)).pvalue > 1e-3
    assert set(events.modality.tolist()) == set(Modality)
    _, lsb, lowest, highest = channel_scales(SPEC)
    for channel in range(8):
        steps = events.value[what == channel].astype(np.float64) / lsb[channel]
        assert np.abs(steps - np.rint(steps)).max() < 1e-3
        if highest[channel] - lowest[channel] < 1100:  # few enough steps that both ends turn up
            ends = np.rint(steps).min(), np.rint(steps).max()
            assert ends == (lowest[channel], highest[channel])
        width = highest[channel] - lowest[channel] + 1.0
        share = (np.rint(steps) - lowest[channel] + 0.5) / width
        assert share.min() > 0.0
        assert share.max() < 1.0
        assert stats.kstest(share, "uniform").statistic < 1.0 / width + 2.0 / math.sqrt(len(share))


def test_no_event_tells_of_the_next() -> None:
    """Waiting times, channels and values of successive events are independent: no draw is used twice."""
    events = said(faults(BABBLE | {"rate_hz": 4000.0}), 0, 30 * 10**9)
    what = np.array([0, 3, 4, 7])[events.modality] + events.channel
    _, lsb, lowest, highest = channel_scales(SPEC)
    share = (events.value / lsb[what] - lowest[what]) / (highest[what] - lowest[what])
    series = (np.diff(events.t_ns), what[1:], share[1:])
    bound = 5.0 / math.sqrt(len(share))
    for one in series:
        for other in series:
            assert abs(stats.spearmanr(one[:-1], other[1:]).statistic) < bound


@given(st.lists(st.integers(0, 3 * 10**9), max_size=12))
def test_how_time_is_cut_changes_nothing_that_is_said(cuts_ns: list[int]) -> None:
    rules = (BABBLE | {"duration_s": 1.0}, BABBLE | {"target": "hand", "at_s": 0.2, "rate_hz": 90.0})
    whole = said(faults(*rules), 0, 3 * 10**9)
    assert len(whole.cell) > 900
    order = np.lexsort((whole.cell, whole.t_ns))
    assert np.array_equal(order, np.arange(len(order)))
    pieces = said(faults(*rules), *sorted([0, 3 * 10**9, *cuts_ns]))
    assert all(np.array_equal(a, b) for a, b in zip(whole, pieces, strict=True))


def test_what_is_said_at_the_end_of_a_time_belongs_to_the_next() -> None:
    whole = said(faults(BABBLE), 0, 10**9)
    assert len(set(whole.t_ns.tolist())) == len(whole.t_ns) > 20
    before = said(faults(BABBLE), 0, int(whole.t_ns[20]))
    assert before.t_ns.tolist() == whole.t_ns[:20].tolist()


def test_every_babbler_has_its_own_stream() -> None:
    events = said(faults(BABBLE | {"target": "arm"}), 0, 2 * 10**9)
    assert set(events.cell.tolist()) == set(range(6))
    assert len(set(events.t_ns.tolist())) == len(events.t_ns)
    other = said(faults(BABBLE | {"target": "arm"}, seed=2), 0, 2 * 10**9)
    assert not set(events.t_ns.tolist()) & set(other.t_ns.tolist())
