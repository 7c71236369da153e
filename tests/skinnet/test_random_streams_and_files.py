"""Streams of random numbers that depend on names only, files that are whole, and clocks."""

import itertools
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from skinnet.clock import NS_PER_S, WallClockPace, next_multiple
from skinnet.files import atomic_replacement, write_bytes, write_json
from skinnet.random_streams import StreamName, generator, hash64, standard_normal, stream_key, uniform
from skinnet.runtime.process_result import ProcessResult

MASK = 2**64 - 1
words = st.integers(0, MASK)


def finalised(z: int) -> int:
    """The finaliser of SplitMix64, in exact integers."""
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & MASK
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & MASK
    return z ^ (z >> 31)


def test_the_reference_gives_the_published_numbers() -> None:
    """First outputs of SplitMix64 for the seed 1234567 (Rosetta Code, 'Pseudo-random numbers/Splitmix64')."""
    states = (1234567 + 0x9E3779B97F4A7C15 * n & MASK for n in (1, 2, 3))
    assert [finalised(z) for z in states] == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
    ]


@given(key=words, counter=words)
def test_the_hash_is_splitmix_twice(key: int, counter: int) -> None:
    z = key + 0x9E3779B97F4A7C15 * (counter + 1) & MASK
    assert int(hash64(np.uint64(key), np.uint64(counter))) == finalised(finalised(z))


@given(key=words, counter=words)
def test_uniform_values_are_the_hash_and_never_an_end(key: int, counter: int) -> None:
    value = uniform(np.uint64(key), np.uint64(counter))
    assert 0.0 < value < 1.0
    bits = int(hash64(np.uint64(key), np.uint64(counter)))
    assert value == pytest.approx((bits + 2**11) / 2**64, abs=2**-52)


def test_the_names_of_streams_are_frozen() -> None:
    """A stream that is called otherwise draws other numbers: new names may come, none may change."""
    names = {value for name, value in vars(StreamName).items() if not name.startswith("_")}
    frozen = (
        "babble bench boards burst fault joint link network node noise nursing phase pick script stand sway"
    )
    assert names >= set(frozen.split())
    assert int(stream_key(1, StreamName.SWAY, "waist")) == 15665211996656346448


def test_values_are_distributed_as_they_should() -> None:
    key = stream_key(1, "distribution")
    counters = [np.uint64(i) for i in range(20_000)]
    flat = np.array([uniform(key, i) for i in counters])
    bell = np.array([standard_normal(key, i) for i in counters])
    assert scipy.stats.kstest(flat, "uniform").pvalue > 1e-3
    assert scipy.stats.kstest(bell, "norm").pvalue > 1e-3
    for values in (flat, bell):  # neighbours know nothing of each other
        assert abs(np.corrcoef(values[:-1], values[1:])[0, 1]) < 0.03


def test_neighbouring_keys_give_unrelated_values() -> None:
    keys = [stream_key(1, "cell", i) for i in range(3000)]
    first = np.array([uniform(key, np.uint64(0)) for key in keys])
    assert scipy.stats.kstest(first, "uniform").pvalue > 1e-3
    beside = np.array([standard_normal(np.uint64(int(keys[0]) + i), np.uint64(5)) for i in range(3000)])
    assert abs(np.corrcoef(beside[:-1], beside[1:])[0, 1]) < 0.06


def test_streams_have_names() -> None:
    names: list[tuple[str | int, ...]] = [
        (),
        ("a",),
        ("b",),
        ("a", "b"),
        ("ab",),
        ("a", 1),
        ("a", "1"),
        ("a", 11),
    ]
    keys = {int(stream_key(seed, *name)) for seed in (1, 2, 11) for name in names}
    assert len(keys) == 3 * len(names)
    # the same on every machine and in every version: a recorded run stays what it was
    assert int(stream_key(1, "torso", 0, "noise")) == 0x39FE109882D82130
    assert generator(1, "a").random(3).tolist() == generator(1, "a").random(3).tolist()
    assert generator(1, "a").random() != generator(1, "b").random()


@given(t=st.integers(0, 10**12), period=st.integers(1, 10**8), offset=st.integers(0, 10**9))
def test_the_next_multiple_is_the_first_after_now(t: int, period: int, offset: int) -> None:
    following = next_multiple(t, period, offset)
    assert t < following <= t + period
    assert (following - offset) % period == 0


def test_the_wall_pace_counts_from_its_first_use(monkeypatch: pytest.MonkeyPatch) -> None:
    wall_ns = itertools.count(50 * NS_PER_S, NS_PER_S)
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(wall_ns))
    pace = WallClockPace()
    assert pace.wait_s(2 * NS_PER_S) == 2.0
    assert pace.wait_s(2 * NS_PER_S) == 1.0
    assert pace.wait_s(0) == -2.0


def test_a_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    write_bytes(path, b"old")
    with atomic_replacement(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert [entry.name for entry in path.parent.iterdir()] == ["file"]


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_bytes(path, b"old")

    def fail() -> None:
        with atomic_replacement(path) as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    with pytest.raises(TypeError):
        write_json(path, object())
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_json_is_readable(tmp_path: Path) -> None:
    value = {"a": [1, 2.5, None], "b": {"c": "é"}}
    write_json(tmp_path / "v.json", value)
    text = (tmp_path / "v.json").read_text(encoding="utf-8")
    assert json.loads(text) == value
    assert text.count("\n") > 5
    write_json(tmp_path / "h.json", {"at": Path("x")}, enc_hook=str)
    assert json.loads((tmp_path / "h.json").read_text()) == {"at": "x"}


def test_a_part_survives_its_files(tmp_path: Path) -> None:
    arrays: dict[str, NDArray[Any]] = {
        "t_ns": np.arange(3),
        "empty": np.zeros((0, 4), dtype=np.float16),
        "mask": np.eye(2, dtype=bool),
    }
    part = ProcessResult("left", "cells", {"logs": {"p": "00"}, "n": 2**60}, arrays)
    part.save(tmp_path)
    back = ProcessResult.load(tmp_path, "left")
    assert (back.name, back.role, back.facts) == (part.name, part.role, part.facts)
    assert back.arrays.keys() == arrays.keys()
    for name, array in arrays.items():
        assert back.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(back.arrays[name], array)


def test_a_part_that_was_not_finished_is_not_there(tmp_path: Path) -> None:
    """The arrays are written first: a kill in between leaves no part."""
    broken = ProcessResult("left", "cells", {"bad": object()}, {})
    with pytest.raises(TypeError):
        broken.save(tmp_path)
    assert (tmp_path / "left.npz").exists()
    with pytest.raises(FileNotFoundError):
        ProcessResult.load(tmp_path, "left")
