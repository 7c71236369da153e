"""From what a run tells to ROS messages: the newest of everything, and nothing from what does not fit."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros2_run import ARM, KEYS, events, joints, stream, topology
from rosbags.typesys import Stores, get_typestore

from skinnet.body.link_kinematics import LinkKinematics
from skinnet.deployment import load
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import (
    ControllerState,
    PeriodEnd,
    Stream,
    encode,
)
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.ros2 import message_types as types
from skinnet.ros2.markers import marker_colour
from skinnet.ros2.message_builder import RosMessageBuilder
from skinnet.ros2.readings import CellReadings

STORE = get_typestore(Stores.ROS2_JAZZY)
SIZES = {"arm": 6, "hand": 2}


def mirror(file: Path = ARM) -> RosMessageBuilder:
    deployment = load(file)
    return RosMessageBuilder(deployment, LinkKinematics(deployment, file.parent))


def told(m: Any) -> Any:
    """The message after its way over the wire."""
    return types.decode(types.encode(m), m.__msgtype__)


def points(cloud: Any) -> np.ndarray:
    """The points of a cloud by the names of its fields."""
    kinds = {7: "<f4", 6: "<u4"}
    layout = {
        "names": [f.name for f in cloud.fields],
        "formats": [kinds[f.datatype] for f in cloud.fields],
        "offsets": [f.offset for f in cloud.fields],
        "itemsize": cloud.point_step,
    }
    assert cloud.row_step == cloud.width * cloud.point_step == len(cloud.data)
    return np.frombuffer(cloud.data.tobytes(), dtype=np.dtype(layout))


def test_joints_become_a_joint_state() -> None:
    one = mirror()
    one.handle(KEYS.of("joints"), joints(1_000_000_000, 0.1, 0.2, 0.3))
    one.handle(KEYS.of("joints"), joints(1_005_000_000, 0.1, 0.2, 0.31))
    one.handle(KEYS.of("joints"), joints(990_000_000, 9.0, 9.0, 9.0))  # overtaken on the way
    state = told(one.joint_state())
    assert state.name == ["shoulder_pitch", "shoulder_roll", "elbow"]
    assert (state.header.stamp.sec, state.header.stamp.nanosec) == (1, 5_000_000)
    assert state.position.tolist() == [0.1, 0.2, 0.31]
    np.testing.assert_allclose(state.velocity, [0.0, 0.0, 2.0])
    assert len(state.effort) == 0
    assert told(one.clock()).clock == state.header.stamp


def test_links_become_one_tree_of_transforms() -> None:
    one = mirror()
    one.handle(KEYS.of("joints"), joints(2_500_000_000, 0.1, 0.2, 0.3))
    fixed, moving = told(one.static_transforms()).transforms, told(one.moving_transforms()).transforms
    parents = {t.child_frame_id: t.header.frame_id for t in (*fixed, *moving)}
    assert parents == {
        "arm/base": "world",
        "arm/upper_link": "arm/base",
        "arm/fore_link": "arm/upper_link",
    }
    assert [t.header.stamp.sec for t in (*fixed, *moving)] == [0, 2, 2]
    for t in (*fixed, *moving):
        turn = t.transform.rotation
        assert turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 == pytest.approx(1.0)


def test_readings_become_points() -> None:
    one = mirror()
    one.handle(KEYS.of("joints"), joints(0, 0.0, 0.0, 0.0))
    one.handle(
        KEYS.of("events", "fore_link", 1),
        encode(events("fore_link", (1, 0, 2, 10, 0.25), (1, 1, 0, 10, 0.5))),
    )
    full = (0.01, 0.02, 0.03, 0.04, 0.0, 0.0, 1.0, 31.5)
    one.handle(KEYS.of("stream", "base"), encode(stream("base", (0, 4, 20, full))))
    cloud = points(told(one.skin_cloud()))
    assert len(cloud) == 15
    assert np.isfinite([cloud[axis] for axis in "xyz"]).all()
    touched = cloud[(cloud["patch"] == 2) & (cloud["cell"] == 1)]
    assert touched[["force", "force0", "force2", "proximity"]].tolist() == [(0.25, 0.0, 0.25, 0.5)]
    assert np.isnan(touched["temperature"]).all()
    warm = cloud[(cloud["patch"] == 0) & (cloud["cell"] == 4)]
    assert warm["temperature"].tolist() == [31.5]
    assert warm["proximity"].tolist() == pytest.approx([0.04])
    silent = cloud[(cloud["patch"] == 1)]
    assert not silent["force"].any()


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        (KEYS.of("joints"), joints(0, 0.0, 0.0)),
        (KEYS.of("joints"), joints(0, 0.0, 0.0, float("nan"))),
        (KEYS.of("joints"), b"garbage"),
        (KEYS.of("period_end", "base"), encode(PeriodEnd(patch="base", t_ns=0, watermark_ns=0, n_events=0))),
        (KEYS.of("events", "nose", 0), encode(events("nose", (0, 0, 0, 0, 1.0)))),
        (KEYS.of("events", "base", 6), encode(events("base", (6, 0, 0, 0, 1.0)))),
        (KEYS.of("events", "base", 0), encode(events("base", (0, 4, 0, 0, 1.0)))),
        (KEYS.of("events", "base", 0), encode(events("base", (0, 1, 1, 0, 1.0)))),
        (KEYS.of("events", "base", 0), encode(events("base", (-1, 0, 0, 0, 1.0)))),
        (KEYS.of("stream", "base"), encode(stream("base", (0, 6, 0, (1.0,) * 8)))),
        (
            KEYS.of("stream", "base"),
            encode(Stream(patch="base", t_ns=0, watermark_ns=0, n_events=0, rows=b"1")),
        ),
        (KEYS.of("topology", "base"), encode(topology("base", 1))),
        ("skinnet/arm/nothing", b""),
        ("elsewhere/arm/body/joints", joints(0, 0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_counted_and_changes_nothing(key: str, payload: bytes) -> None:
    one, other = mirror(), mirror()
    for m in (one, other):
        m.handle(KEYS.of("joints"), joints(0, 0.1, 0.2, 0.3))
    with pytest.raises(ProtocolError):
        one.handle(key, payload)
    assert one.counters == {"refused": 1}
    for of in (
        RosMessageBuilder.joint_state,
        RosMessageBuilder.skin_cloud,
        RosMessageBuilder.moving_transforms,
        RosMessageBuilder.markers,
    ):
        assert types.encode(of(one)) == types.encode(of(other))


def test_markers_are_the_cells_in_their_colours() -> None:
    one = mirror()
    one.handle(KEYS.of("joints"), joints(0, 0.0, 0.0, 0.0))
    one.handle(KEYS.of("events", "fore_link", 1), encode(events("fore_link", (1, 0, 2, 10, 0.4))))
    one.handle(KEYS.of("topology", "base"), encode(topology("base", 1, 2, 0, 3, 4, 5)))
    markers = told(one.markers()).markers
    assert [m.header.frame_id for m in markers] == ["arm/base", "arm/upper_link", "arm/fore_link"]
    assert len({(m.ns, m.id) for m in markers}) == 3
    assert [len(m.points) for m in markers] == [72, 72, 36]
    for m in markers:
        assert (m.type, m.action, m.frame_locked) == (11, 0, True)
        assert len(m.colors) == len(m.points)
    shades = [(c.r, c.g, c.b) for c in markers[2].colors[::12]]
    assert shades[0] == shades[2] == pytest.approx(marker_colour(0.0, 0.0), abs=1e-6)
    assert shades[1][0] > 0.8 > shades[1][1]  # from yellow to red
    assert sum(markers[0].colors[2 * 12 + 5].__dict__[name] for name in "rgb") < 0.5  # out of reach: dark


def test_a_hexagon_faces_outwards() -> None:
    """Corners run counter-clockwise as seen from outside: RViz draws one side only."""
    one = mirror()
    one.handle(KEYS.of("joints"), joints(0, 0.0, 0.0, 0.0))
    corners = told(one.markers()).markers[0].points[:3]
    a, b, c = (np.array([p.x, p.y, p.z]) for p in corners)
    normal = np.cross(b - a, c - a)
    np.testing.assert_allclose(normal / np.linalg.norm(normal), [1.0, 0.0, 0.0], atol=1e-9)


def test_diagnostics_tell_what_is_wrong() -> None:
    one = mirror()
    assert [int(s.level) for s in told(one.diagnostics(0.0, {})).status if s.name == "arm: run"] == [3]
    one.handle(KEYS.of("joints"), joints(0, 0.0, 0.0, 0.0))
    one.handle(KEYS.of("state"), encode(ControllerState(t_ns=0, stage="evade", progress=0.5)))
    one.handle(KEYS.of("events", "base", 1), encode(events("base", (1, 0, 2, 10, 0.4), seq=7)))
    one.handle(KEYS.of("events", "base", 1), encode(events("base", (1, 0, 2, 10, 0.4), seq=10)))
    one.handle(KEYS.of("topology", "base"), encode(topology("base", 1, 2, 0, 3, 4, 5)))
    status = {s.name: s for s in told(one.diagnostics(0.1, {"/tf": 3})).status}
    assert (int(status["arm: run"].level), status["arm: run"].message) == (0, "evade")
    assert (int(status["arm: skin base"].level), status["arm: skin base"].message) == (
        1,
        "5 of 6 cells connected",
    )
    figures = {pair.key: pair.value for pair in status["arm: skin base"].values}
    assert figures == {"cells": "6", "reached": "5", "events": "2", "full_readings": "0", "lost": "2"}
    assert int(status["arm: skin fore_link"].level) == 0
    assert {pair.key: pair.value for pair in status["arm: bridge"].values} == {"/tf": "3"}
    assert {s.hardware_id for s in status.values()} == {"arm"}


def test_regions_of_sheets_lie_on_their_surface() -> None:
    file = ARM.with_name("riba_cylinder.toml")
    one, keys = mirror(file), Keys(load(file).robot)
    n = len(load(file).body.joints)
    one.handle(keys.of("joints"), joints(0, *[0.0] * n))
    rows = np.zeros(3, dtype=REGION_ROW)
    rows["board"], rows["region_id"], rows["n_elements"] = (0, 1, 1), (1, 1, 2), (4, 2, 0)
    rows["force_n"], rows["xi2_m"] = (5.0, 2.0, 0.0), (0.01, 0.0, 0.0)
    frames = np.zeros(2, dtype=SCAN_FRAME_ROW)
    frames["board"], frames["n_regions"] = (0, 1), (1, 2)
    message = Regions(t_ns=0, watermark_ns=1, frames=frames.tobytes(), rows=rows.tobytes())
    one.handle(keys.of("regions", "boards"), encode(message))
    cloud = points(told(one.region_cloud()))
    assert cloud[["board", "region", "force_n"]].tolist() == [(0, 1, 5.0), (1, 1, 2.0)]  # the other one ended
    wrong = Regions(t_ns=0, watermark_ns=1, frames=frames.tobytes(), rows=rows[:2].tobytes())
    with pytest.raises(ProtocolError, match="2 rows, and frames of 3"):
        one.handle(keys.of("regions", "boards"), encode(wrong))


CHANNELS = st.sampled_from([(0, 0), (0, 2), (1, 0), (3, 0)])
CELL_EVENTS = st.lists(st.tuples(st.integers(0, 5), CHANNELS, st.integers(0, 50)), max_size=30)


@given(CELL_EVENTS, st.lists(st.integers(0, 30), max_size=4), st.randoms())
def test_the_newest_stays_whatever_the_order(rows: list[Any], cuts: list[int], random: Any) -> None:
    """Events in any order and any messages leave the last value of each channel of each cell."""
    rows = [(cell, kind, t_ns, 100.0 * t_ns + cell) for cell, kind, t_ns in dict.fromkeys(rows)]
    random.shuffle(rows)
    readings = CellReadings(SIZES)
    bounds = [0, *sorted(min(cut, len(rows)) for cut in cuts), len(rows)]
    for begin, end in itertools.pairwise(bounds):
        if part := rows[begin:end]:
            readings.apply_events("arm", events("arm", *((c, *kind, t, v) for c, kind, t, v in part)))
    first = {0: 0, 1: 3, 3: 7}
    for cell, (modality, channel), _, _ in rows:
        newest = max(v for c, kind, _, v in rows if (c, kind) == (cell, (modality, channel)))
        assert readings.values[cell, first[modality] + channel] == newest
    assert readings.deliveries["arm"].n_events == len(rows)


@given(st.lists(st.integers(0, 40), unique=True, min_size=1))
def test_lost_deliveries_are_counted_whatever_the_order(seq: list[int]) -> None:
    readings = CellReadings(SIZES)
    for number in seq:
        readings.apply_stream("hand", stream("hand", (number, 1, number, (0.0,) * 8)))
    assert readings.deliveries["hand"].n_lost == max(seq) - min(seq) + 1 - len(seq)


def test_an_older_reading_does_not_replace_a_newer_one() -> None:
    readings = CellReadings(SIZES)
    readings.apply_stream("hand", stream("hand", (1, 0, 20, (0.2,) * 8), (0, 0, 10, (0.1,) * 8)))
    readings.apply_events("hand", events("hand", (0, 0, 0, 15, 0.9)))
    np.testing.assert_allclose(readings.values[6], 0.2)
