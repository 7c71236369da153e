"""A recording is played, sought and looped, and one that was cut is played up to there."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded import recorded_once
from view_recordings import LENGTH_S, story, write
from view_scene import MS, deployment, joints

from skinnet.deployment import Deployment
from skinnet.errors import RecordingError
from skinnet.view.sources.playback_clock import PlaybackClock
from skinnet.view.sources.recording_source import RecordingSource
from skinnet.view.state.run_state import RASTER_NS, RunState
from skinnet.view.state.skin_layout import build_skin_layout


@pytest.fixture(scope="module")
def deployed() -> Deployment:
    return deployment()


@pytest.fixture(scope="module")
def file(deployed: Deployment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("recording") / "run.mcap", deployed, story(deployed))


def after(deployed: Deployment, t_ns: int) -> RunState:
    """The scene when everything up to `t_ns` has come, one after the other."""
    scene = RunState(deployed, build_skin_layout(deployed))
    for told in story(deployed):
        if told.t_ns <= t_ns:
            scene.apply(told, 0.0)
    return scene


def assert_alike(scene: RunState, other: RunState, *, history: bool = True) -> None:
    np.testing.assert_array_equal(scene.skin.reading, other.skin.reading)
    np.testing.assert_array_equal(scene.network.connected, other.network.connected)
    assert scene.position_rad == other.position_rad
    assert scene.controller.state == other.controller.state
    assert list(scene.controller.history) == list(other.controller.history)
    if history:
        mine, theirs = (one.events.since(scene.t_ns - RASTER_NS) for one in (scene, other))
        np.testing.assert_array_equal(mine, theirs)


def fed(source: RecordingSource, scene: RunState, now_s: float) -> None:
    """Feeds until the scene is where the recording is."""
    source.deliver(scene, now_s)
    while scene.t_ns < source.clock.position_ns(now_s):
        source.deliver(scene, now_s)


@given(times=st.lists(st.floats(0.0, LENGTH_S), min_size=1, max_size=8))
def test_wherever_one_goes_the_scene_is_what_it_was_then(
    file: Path, deployed: Deployment, times: list[float]
) -> None:
    source, scene = RecordingSource(file, None, 0.0), RunState(deployed, build_skin_layout(deployed))
    for number, t_s in enumerate(times):
        source.clock.seek(round(t_s * 1e9), float(number))
        source.clock.pause(float(number))
        fed(source, scene, float(number))
        assert scene.t_ns == source.clock.position_ns(float(number))
        assert_alike(scene, after(deployed, scene.t_ns))


@pytest.fixture
def source(file: Path) -> RecordingSource:
    return RecordingSource(file, None, 100.0)


def test_it_plays_at_its_rate_and_stops_at_the_end(source: RecordingSource, deployed: Deployment) -> None:
    assert source.base == source.recording.path.parent
    assert source.deployment == deployed
    scene = RunState(deployed, build_skin_layout(deployed))
    fed(source, scene, 110.0)
    assert_alike(scene, after(deployed, 10_000 * MS))
    source.clock.set_rate(10.0, 110.0)
    fed(source, scene, 111.0)
    assert scene.t_ns == pytest.approx(20e9, rel=1e-3)
    fed(source, scene, 200.0)
    assert not source.clock.playing
    assert scene.t_ns == source.clock.end_ns
    assert_alike(scene, after(deployed, scene.t_ns))
    source.clock.set_rate(1.0, 300.0)
    source.clock.play(300.0)
    fed(source, scene, 301.0)
    assert_alike(scene, after(deployed, scene.t_ns))
    assert 1e9 <= scene.t_ns < 1.1e9
    assert source.end_reason == ""


def test_a_loop_begins_anew(source: RecordingSource, deployed: Deployment) -> None:
    source.clock.loop = True
    scene = RunState(deployed, build_skin_layout(deployed))
    fed(source, scene, 159.0)
    fed(source, scene, 161.0)
    assert scene.t_ns < 2e9
    assert_alike(scene, after(deployed, scene.t_ns))


DEEDS = st.sampled_from(["play", "pause", "seek", "rate"])


@given(
    deeds=st.lists(st.tuples(DEEDS, st.floats(0.0, 9.0), st.floats(0.05, 20.0)), max_size=12),
    loop=st.booleans(),
)
def test_a_position_never_leaves_the_recording_nor_jumps(
    deeds: list[tuple[str, float, float]], loop: bool
) -> None:
    start_ns, end_ns, now_s = 500, 90_000_000_000, 0.0
    playback = PlaybackClock(start_ns, end_ns, now_s)
    playback.loop = loop
    for deed, passed_s, number in deeds:
        before_ns = playback.position_ns(now_s)
        jumps, rate, playing = playback.n_seeks, playback.rate, playback.playing
        now_s += passed_s
        position_ns = playback.position_ns(now_s)
        assert start_ns <= position_ns <= end_ns
        if playback.n_seeks == jumps:
            most_ns = rate * passed_s * 1e9 if playing else 0.0
            assert position_ns - before_ns <= most_ns + 1.0
            assert position_ns >= before_ns
        match deed:
            case "play":
                playback.play(now_s)
            case "pause":
                playback.pause(now_s)
            case "seek":
                playback.seek(round(number * 1e10), now_s)
                assert playback.position_ns(now_s) == min(max(round(number * 1e10), start_ns), end_ns) or loop
            case "rate":
                playback.set_rate(number, now_s)
        if deed in ("pause", "rate"):
            assert playback.position_ns(now_s) == position_ns


def test_a_rate_is_above_zero() -> None:
    with pytest.raises(ValueError, match="rate is 0"):
        PlaybackClock(0, 1, 0.0).set_rate(0.0, 0.0)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95, 0.999])
def test_a_recording_that_is_cut_is_played_up_to_there(
    file: Path, deployed: Deployment, tmp_path: Path, share: float
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    scene = RunState(deployed, build_skin_layout(deployed))
    source, whole = RecordingSource(cut, None, 0.0), RecordingSource(file, None, 0.0)
    assert source.clock.end_ns <= whole.clock.end_ns
    assert "it was cut" in source.properties()
    assert "it was cut" not in whole.properties()
    fed(source, scene, 100.0)
    assert_alike(scene, after(deployed, source.clock.end_ns))
    source.clock.seek(source.clock.end_ns // 2, 101.0)
    source.clock.pause(101.0)
    fed(source, scene, 101.0)
    assert_alike(scene, after(deployed, scene.t_ns))


def test_what_does_not_decode_is_left_out_and_counted(deployed: Deployment, tmp_path: Path) -> None:
    told = story(deployed)[:6]
    strange: Any = msgspec.msgpack.encode({"type": "joints", "schema": 9})
    told += [joints(5_000 + i, 0.0, 0.0)._replace(message=junk) for i, junk in enumerate((strange, b"\xc1"))]
    source = RecordingSource(write(tmp_path / "run.mcap", deployed, told), None, 0.0)
    scene = RunState(deployed, build_skin_layout(deployed))
    fed(source, scene, 10.0)
    assert source.properties()["unreadable messages"] == "2"
    assert scene.n_malformed == 0
    assert_alike(scene, after(deployed, told[5].t_ns), history=False)


def test_a_recording_without_a_message_has_nothing_to_show(deployed: Deployment, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no messages"):
        RecordingSource(write(tmp_path / "run.mcap", deployed, []), None, 0.0)


def test_a_recorded_run_is_played_as_it_was(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What the recorder of a run wrote: every state of the controller is there, and why it came."""
    folder, summary = recorded_once("touch", tmp_path_factory)
    source = RecordingSource(folder / "run.mcap", None, 0.0)
    scene = RunState(source.deployment, build_skin_layout(source.deployment))
    source.clock.set_rate(1000.0, 0.0)
    fed(source, scene, 1000.0)
    assert scene.n_malformed == source.n_malformed == 0
    assert scene.network.connected.all()
    assert [move.target for move in scene.controller.history] == ["map", "force_guidance"]
    assert "finger" in scene.free_body_poses
    assert scene.events.n_events > 0
    scene.update_statistics()
    assert scene.n_missed == 0
    assert scene.t_ns == pytest.approx(summary["sim_s"] * 1e9, rel=0.01)
