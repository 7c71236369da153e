import copy
import math

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from cells.sensing.encoding import ENCODINGS, Encoder, EncoderOutput
from cells.sensing.transducers import STANDARD_GRAVITY_M_S2, Transducers, noise_keys, phases_ns
from skinnet.deployment.skin.cells import (
    AccelerometerSpec,
    CellSpec,
    EncodingSpec,
    ForceSpec,
    ProximitySpec,
    TemperatureSpec,
)
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.messages import READING_NAMES, Config, EventKind, Modality

PROXIMITY = (0.01, 0.02, 0.10, 0.80)
Event = tuple[int, int, int, int, int, float]


def spec(kind: str = "level_crossing", repeat_ms: float = 0.0) -> CellSpec:
    return CellSpec(encoding=EncodingSpec(kind=kind, repeat_ms=repeat_ms))  # type: ignore[arg-type]


def config(**settings: object) -> Config:
    return Config(patch="arm", cell=0, **settings)  # type: ignore[arg-type]


def rows(n: int, **columns: float) -> NDArray[np.float32]:
    readings = np.zeros((n, 8), dtype=np.float32)
    for name, value in columns.items():
        readings[:, READING_NAMES.index(name)] = value
    return readings


def events(emission: EncoderOutput) -> list[Event]:
    return list(zip(*(column.tolist() for column in emission[:6]), strict=True))


def walk(dice: np.random.Generator, n: int, frames: int) -> NDArray[np.float32]:
    """Readings that wander through all levels, with noise and jumps."""
    steps = dice.normal(0.0, 0.04, (frames, n, 8)) * (dice.random((frames, n, 8)) < 0.5)
    path = np.abs(np.cumsum(steps, axis=0) + dice.normal(0.0, 0.01, steps.shape)) % 1.0
    return np.rint(path * 1024).astype(np.float32) / np.float32(1024)


def test_table_one_up_and_down_with_one_event_a_change() -> None:
    encoder = Encoder(spec(), 1)
    seen: list[tuple[int, float]] = []
    for force in (0.0, 0.039, 0.04, 0.05, 0.10, 0.073, 0.071, 0.50, 0.0):
        seen += [(e[4], round(e[5], 3)) for e in events(encoder.encode(rows(1, force1=force)))]
    assert seen == [(1, 0.04), (2, 0.10), (1, 0.071), (4, 0.50), (0, 0.0)]
    near = []
    for proximity in (0.0, 0.015, 0.9, 0.75, 0.0):
        near += events(encoder.encode(rows(1, proximity=proximity)))
    assert [event[1:5] for event in near] == [
        (Modality.PROXIMITY, 0, EventKind.LEVEL_CROSSING, level) for level in (1, 4, 3, 0)
    ]


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.2), st.integers(0, 4))
def test_levels_are_what_thresholds_and_hysteresis_allow(seed: int, margin: float, n_levels: int) -> None:
    dice = np.random.default_rng(seed)
    n, frames = 5, 60
    encoder = Encoder(spec(), n)
    thresholds = (np.unique(dice.integers(1, 1000, n_levels)) / np.float32(1000)).astype(np.float64)
    settings = config(levels={"force": thresholds.tolist()}, hysteresis={"force": margin, "proximity": 0.0})
    for cell in range(n):
        encoder.configure(cell, settings)
    tables = [(thresholds, margin)] * 3 + [(np.array(PROXIMITY, dtype=np.float32), 0.0)]
    level = np.zeros((n, 4), dtype=int)
    for readings in walk(dice, n, frames):
        expected = []
        for cell in range(n):
            for channel, (table, hysteresis) in enumerate(tables):
                value = float(readings[cell, channel])
                # at least as many levels as thresholds reached, at most as many as not left
                reached, kept = int(np.sum(value >= table)), int(np.sum(value >= table - hysteresis))
                new = min(max(int(level[cell, channel]), reached), kept)
                if new != level[cell, channel]:
                    expected.append((cell, int(channel == 3), channel % 3, 0, new, value))
                level[cell, channel] = new
        assert events(encoder.encode(readings)) == expected
        assert np.array_equal(encoder.last_levels, level)


def frames_of(encoder: Encoder, readings: NDArray[np.float32], n_frames: int) -> dict[int, list[Event]]:
    """Events by frame, of frames that have some, while the readings stay as they are."""
    heard = {frame: events(encoder.encode(readings)) for frame in range(n_frames)}
    return {frame: found for frame, found in heard.items() if found}


def test_a_level_that_nobody_answers_is_repeated_at_intervals_that_double_up_to_sixteen() -> None:
    encoder = Encoder(spec(repeat_ms=40.0), 2)
    touched = rows(2, force1=0.2)
    touched[0] = 0.0
    rising = frames_of(encoder, touched, 800)
    assert list(rising) == [0, 10, 30, 70, 150, 310, 470, 630, 790]
    assert {tuple(found) for found in rising.values()} == {((1, 0, 1, 0, 2, float(np.float32(0.2))),)}
    assert encoder.level_repeats == len(rising) - 1
    falling = frames_of(encoder, rows(2), 3000)
    assert list(falling) == [0, 10, 30, 70, 150, 310]  # the return to level 0 five times, and no more
    assert {tuple(found) for found in falling.values()} == {((1, 0, 1, 0, 0, 0.0),)}
    again = frames_of(encoder, touched, 15)
    assert list(again) == [0, 10]  # from the shortest interval after each change


def test_a_stream_confirms_a_level_and_what_lasts_after_it_is_repeated_seldom() -> None:
    encoder = Encoder(spec(repeat_ms=40.0), 1)
    touched = rows(1, force1=0.2)
    assert list(frames_of(encoder, touched, 5)) == [0]
    encoder.configure(0, config(stream=True))
    assert not frames_of(encoder, touched, 500)
    assert list(frames_of(encoder, rows(1), 500)) == [0]  # the change itself; the stream confirms it
    assert list(frames_of(encoder, touched, 500)) == [0]
    encoder.configure(0, config(stream=False))
    assert list(frames_of(encoder, touched, 500)) == [159, 319, 479]
    encoder.configure(0, config(stream=True))
    encoder.encode(rows(1))
    encoder.configure(0, config(stream=False))
    assert not frames_of(encoder, rows(1), 500)


def test_cells_outside_the_network_forget_what_they_would_repeat() -> None:
    encoder = Encoder(spec(repeat_ms=40.0), 2)
    touched = rows(2, force1=0.2)
    encoder.encode(touched)
    encoder.cancel_repeats(np.array([True, False]))
    assert {event[0] for found in frames_of(encoder, touched, 100).values() for event in found} == {1}
    assert encoder.level_repeats == 3


@given(st.integers(0, 2**32 - 1))
def test_send_on_delta_keeps_the_receivers_picture_within_delta(seed: int) -> None:
    dice = np.random.default_rng(seed)
    n = 4
    encoder = Encoder(spec("send_on_delta"), n)
    delta = np.array([0.02] * 4 + [0.1] * 3 + [0.5])
    first = [3 * (m > 0) + (m > 1) + 3 * (m > 2) for m in range(4)]
    picture = np.full((n, 8), np.nan)
    for frame, readings in enumerate(walk(dice, n, 50)):
        readings[:, 7] *= 10.0
        emission = encoder.encode(readings)
        assert len(emission.full_cell) == 0
        if frame == 0:
            assert len(emission.cell) == 8 * n
        for cell, modality, channel, kind, level, value in events(emission):
            column = first[modality] + channel
            assert (kind, level, value) == (EventKind.SEND_ON_DELTA, 0, readings[cell, column])
            assert not abs(value - picture[cell, column]) <= delta[column]
            picture[cell, column] = value
        assert np.all(np.abs(picture - readings) <= delta)


def test_clock_and_stream_send_full_readings_and_a_stream_leaves_the_events_alone() -> None:
    encoder = Encoder(spec(), 5)
    encoder.configure(1, config(encoding="periodic"))
    encoder.configure(3, config(stream=True))
    encoder.configure(4, config(encoding="periodic", stream=True))
    touched = rows(5, force0=0.2)
    emission = encoder.encode(touched)
    assert emission.full_cell.tolist() == [1, 3, 4]
    assert emission.cell.tolist() == [0, 2, 3]
    assert encoder.encode(touched).full_cell.tolist() == [1, 3, 4]
    encoder.configure(3, config(stream=False))
    assert encoder.encode(touched).full_cell.tolist() == [1, 4]


@given(st.integers(0, 2**32 - 1))
def test_a_cell_says_the_same_whoever_is_beside_it(seed: int) -> None:
    dice = np.random.default_rng(seed)
    n = 6
    together, alone = Encoder(spec(), n), [Encoder(spec(), 1) for _ in range(n)]
    for readings in walk(dice, n, 40):
        if dice.random() < 0.3:
            cell = int(dice.integers(n))
            settings = config(encoding=ENCODINGS[int(dice.integers(3))], stream=bool(dice.random() < 0.3))
            together.configure(cell, settings)
            alone[cell].configure(0, settings)
        emission = together.encode(readings)
        single = [alone[cell].encode(readings[cell : cell + 1]) for cell in range(n)]
        expected = [(cell, *event[1:]) for cell in range(n) for event in events(single[cell])]
        assert events(emission) == expected
        assert emission.full_cell.tolist() == [cell for cell in range(n) if len(single[cell].full_cell)]


def test_a_change_of_encoding_keeps_the_receivers_picture_right() -> None:
    encoder = Encoder(spec(), 1)
    encoder.encode(rows(1, force0=0.2))
    encoder.configure(0, config(encoding="send_on_delta"))
    assert len(encoder.encode(rows(1, force0=0.0)).cell) == 8  # all of them: nothing was sent as a value
    encoder.configure(0, config(encoding="send_on_delta"))
    assert len(encoder.encode(rows(1, force0=0.01)).cell) == 0  # the same encoding again changes nothing
    encoder.configure(0, config(encoding="level_crossing"))
    assert [event[4] for event in events(encoder.encode(rows(1, force0=0.0)))] == [0]
    encoder.configure(0, config(encoding="send_on_delta"))
    assert len(encoder.encode(rows(1, force0=0.01)).cell) == 8  # a level may have been sent since
    encoder.configure(0, config(encoding="level_crossing"))
    encoder.encode(rows(1, force0=0.5))
    encoder.configure(0, config(levels={"force": [0.3]}))
    assert [event[4] for event in events(encoder.encode(rows(1, force0=0.5)))] == [1]


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"encoding": "morse"}, "'level_crossing', 'send_on_delta', 'periodic'"),
        ({"levels": {"temperature": [1.0]}}, "use one of .*'force', 'proximity'"),
        ({"levels": {"force": [0.1, 0.1]}}, "ascend"),
        ({"levels": {"force": [0.1, math.nan]}}, "finite"),
        ({"levels": {"force": [math.inf]}}, "finite"),
        ({"levels": {"force": [0.1, 0.2, 0.3, 0.4, 0.5]}}, "at most 4"),
        ({"hysteresis": {"force": -0.1}}, "zero or more"),
        ({"hysteresis": {"warmth": 0.1}}, "use one of"),
        ({"deltas": {"force": 0.0}}, "above zero"),
        ({"deltas": {"acceleration": math.nan}}, "above zero"),
        ({"deltas": {"g": 1.0}}, "'force', 'proximity', 'acceleration', 'temperature'"),
    ],
)
def test_a_wrong_setting_is_refused_whole(settings: dict[str, object], names: str) -> None:
    encoder, untouched = Encoder(spec(), 2), Encoder(spec(), 2)
    good: dict[str, object] = {
        "stream": True,
        "encoding": "send_on_delta",
        "levels": {"proximity": [0.5]},
        "hysteresis": {"proximity": 0.0},
        "deltas": {"proximity": 0.001},
    }
    with pytest.raises(ProtocolError, match=f"cell 1.*{names}"):
        encoder.configure(1, config(**{**good, **settings}))
    for proximity in (0.3, 0.301, 0.6, 0.302):
        readings = rows(2, proximity=proximity)
        mine, theirs = encoder.encode(readings), untouched.encode(readings)
        assert events(mine) == events(theirs)
        assert len(mine.full_cell) == 0


def test_a_cell_that_the_patch_does_not_have_is_refused() -> None:
    for cell in (-1, 2):
        with pytest.raises(ProtocolError, match="cells 0 to 1"):
            Encoder(spec(), 2).configure(cell, config(stream=True))


@pytest.mark.parametrize(
    "wrong",
    [
        replace(spec(), force=ForceSpec(levels=(0.2, 0.1))),
        replace(spec(), proximity=ProximitySpec(levels=(0.1, 0.2, 0.3, 0.4, 0.5))),
    ],
)
def test_a_deployment_with_wrong_levels_is_refused(wrong: CellSpec) -> None:
    with pytest.raises(DeploymentError, match=r"cells: levels\."):
        Encoder(wrong, 1)


def sampled(cell: CellSpec, n: int, reading: float = 0.0) -> tuple[Transducers, NDArray[np.float64]]:
    """Transducers, and a stimulus at rest with the force that makes `reading`."""
    force_n = np.interp(reading, cell.force.calibration_reading, cell.force.calibration_n)
    stimulus = np.tile([force_n] * 3 + [math.inf, 0.0, 0.0, STANDARD_GRAVITY_M_S2, 23.0], (n, 1))
    return Transducers(cell, noise_keys(1, "arm", n), phases_ns(1, "arm", n, 4_000_000)), stimulus


def test_ten_idle_minutes_of_74_cells_are_silent() -> None:
    quiet = CellSpec(accelerometer=AccelerometerSpec(noise_g=0.0), temperature=TemperatureSpec(noise_c=0.0))
    n, repeats = 74, 10  # ten times the cells for a tenth of the frames: noise has no memory
    transducers, stimulus = sampled(quiet, n * repeats)
    encoder, out = Encoder(quiet, n * repeats), np.empty((n * repeats, 8), dtype=np.float32)
    highest = np.zeros(8)
    for frame in range(600 * 250 // repeats):
        transducers.sample(frame, stimulus, stimulus, out)
        assert len(encoder.encode(out).cell) == 0
        if frame < 250:
            highest = np.maximum(highest, out.max(axis=0))
    assert np.all(highest[:3] > 4 * quiet.force.noise)  # it was noise that did not wake them
    assert highest[3] > 4 * quiet.proximity.noise


@pytest.mark.parametrize("margin_in_sigmas", [0.0, 1.0, 2.0, 3.0, 4.0])
def test_noise_crosses_a_hysteresis_as_often_as_two_states_of_a_markov_chain_change(
    margin_in_sigmas: float,
) -> None:
    sigma, threshold, n, frames = 0.004, 0.10, 300, 400
    hysteresis = margin_in_sigmas * sigma
    force = ForceSpec(noise=sigma, lsb=1e-7, levels=(threshold,), hysteresis=hysteresis)
    cell = replace(spec(), force=force)
    transducers, stimulus = sampled(cell, n, reading=threshold - hysteresis / 2)
    encoder, out = Encoder(cell, n), np.empty((n, 8), dtype=np.float32)
    changes = 0
    for frame in range(frames):
        transducers.sample(frame, stimulus, stimulus, out)
        changes += int(np.sum(encoder.encode(out).modality == Modality.FORCE))
    # in the middle of the band each sample leaves either state with probability Q(h / 2σ)
    expected = scipy.stats.norm.sf(margin_in_sigmas / 2) * n * 3 * frames
    assert changes == pytest.approx(expected, abs=4 * math.sqrt(expected))


@given(st.integers(0, 2**32 - 1), st.sampled_from(ENCODINGS))
def test_a_cell_that_is_switched_on_again_is_as_new_and_the_others_are_as_they_were(
    seed: int, kind: str
) -> None:
    dice = np.random.default_rng(seed)
    n = 6
    again = np.flatnonzero(dice.random(n) < 0.5)
    encoder, fresh = Encoder(spec(kind), n), Encoder(spec(kind), n)
    settings = config(
        stream=True,
        encoding="send_on_delta",
        levels={"force": [0.5]},
        hysteresis={"force": 0.2},
        deltas={"force": 0.3, "proximity": 0.4, "acceleration": 0.5, "temperature": 0.6},
    )
    path = walk(dice, n, 40)
    for readings in path[:20]:
        encoder.encode(readings)
        if dice.random() < 0.2:
            encoder.configure(int(dice.integers(n)), settings)
    steady = copy.deepcopy(encoder)
    encoder.reset(again)
    for readings in path[20:]:
        mine, old, new = encoder.encode(readings), steady.encode(readings), fresh.encode(readings)
        chosen = set(again.tolist())
        expected = [e for e in events(new) if e[0] in chosen] + [e for e in events(old) if e[0] not in chosen]
        assert events(mine) == sorted(expected, key=lambda event: event[0])
        full = [c for c in new.full_cell.tolist() if c in chosen] + [
            c for c in old.full_cell.tolist() if c not in chosen
        ]
        assert mine.full_cell.tolist() == sorted(full)
