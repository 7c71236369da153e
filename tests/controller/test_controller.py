"""The controller in its order: first the skin, then the program, and never a command that makes no sense."""

import itertools
import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from wired_controller import HOME_RAD, SIZES, TICK_NS, Robot, S, Wired, events

from controller.cell_input import CellInput
from controller.controller import TickOutput
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import (
    STREAM_ROW,
    Config,
    JointRanges,
    Joints,
    Message,
    Modality,
    PeriodEnd,
    Stream,
)

Floats = NDArray[np.float64]


def test_without_a_skin_the_robot_does_not_move() -> None:
    robot = Robot("bow")
    for _ in range(50):
        tick = robot.tick(ready=False)
        assert not tick.velocity_rad_s.any()
        assert not len(tick.streams_on)
    assert not robot.brain.stage_log
    assert not robot.brain.done
    assert robot.tick().velocity_rad_s.any()
    assert robot.brain.stage_log == [("bow", 50 * TICK_NS)]


def test_the_program_goes_in_its_order_and_the_robot_gets_there() -> None:
    robot = Robot("bow", "structure", "map", "guide", "home")
    robot.live()
    names = [name for name, _ in robot.brain.stage_log]
    starts_ns = [t_ns for _, t_ns in robot.brain.stage_log]
    assert names == ["bow", "structure", "map", "guide", "home"]
    assert starts_ns == sorted(set(starts_ns))
    assert starts_ns[4] - starts_ns[3] == pytest.approx(2_000_000_000, abs=2 * TICK_NS)
    np.testing.assert_allclose(robot.position_rad, HOME_RAD, atol=0.01)
    assert robot.brain.self_model.structure is not None
    assert len(robot.brain.self_model.sensory_motor_map) == 1
    assert robot.brain.progress == 1.0


def test_who_listens_takes_in_what_the_skin_says_and_does_nothing() -> None:
    robot = Robot("listen", "bow").know()
    while robot.brain.stage != "bow":
        robot.feel("arm", (0, 3, 0.5), seq=robot.t_ns)
        tick = robot.tick()
        if robot.brain.stage == "listen":
            assert not tick.velocity_rad_s.any()
        assert not len(tick.streams_on)
        assert robot.brain.tactile_input is None
    begins = dict(robot.brain.stage_log)
    assert begins["bow"] - begins["listen"] == pytest.approx(500_000_000, abs=2 * TICK_NS)
    assert robot.brain.tactile_state.readings(Modality.FORCE)[0, 0] == 0.5


def say(robot: Robot, *cells: int, patch: str = "arm") -> None:
    """These cells of a patch send a full reading each, delivered just now."""
    rows = np.zeros(len(cells), dtype=STREAM_ROW)
    rows["cell"], rows["t_sampled_ns"], rows["t_delivered_ns"] = cells, robot.t_ns - 2000, robot.t_ns - 1000
    rows["seq"] = robot.t_ns + np.arange(len(cells))
    robot.skin.add_stream(patch, Stream(patch=patch, t_ns=0, watermark_ns=0, n_events=0, rows=rows.tobytes()))


def test_a_cell_that_does_not_stream_is_asked_again() -> None:
    robot = Robot("structure")
    asked: dict[int, list[int]] = {}
    for _ in range(45):
        say(robot, 0)
        for cell in robot.tick().streams_on.tolist():
            asked.setdefault(cell, []).append(robot.t_ns)
    assert len(asked[0]) == 1
    assert len(asked[1]) == 3
    assert min(np.diff(asked[1])) > 100_000_000
    assert robot.brain.repeated_stream_requests == 2 * (S - 1)


def test_a_cell_that_leaves_the_network_is_asked_anew_when_it_returns() -> None:
    robot = Robot("structure")
    robot.tick()
    cells = np.arange(2)
    robot.brain.update_presence(cells, np.array([True, False]))
    assert not robot.brain.tactile_state.present[1]
    assert 1 not in robot.tick().streams_on
    robot.brain.update_presence(cells, np.array([True, True]))
    assert robot.tick().streams_on.tolist() == [1]


def test_a_pose_is_reached_before_the_next_stage_begins() -> None:
    robot = Robot("bow", "guide").know()
    while robot.brain.stage != "guide":
        before = robot.position_rad
        robot.tick()
    np.testing.assert_allclose(before, (0.3, -0.2), atol=0.01)


def test_all_cells_stream_while_the_robot_explores_and_not_after() -> None:
    robot = Robot("structure", "bow")
    streaming: set[int] = set()
    asked: dict[int, int] = {}
    most = 0
    while not robot.brain.done:
        tick = robot.tick()
        on, off = set(tick.streams_on.tolist()), set(tick.streams_off.tolist())
        asked_now = dict.fromkeys(on, robot.t_ns)
        # nobody is asked twice, unless nothing came of it
        assert all(robot.t_ns - asked[cell] > 100_000_000 for cell in streaming & on)
        asked |= asked_now
        assert off <= streaming
        streaming = (streaming | on) - off
        most = max(most, len(streaming))
        assert robot.brain.stage == "structure" or not streaming
    assert most == S
    assert [name for name, _ in robot.brain.stage_log] == ["structure", "bow"]


def test_a_cell_in_contact_streams_until_it_is_left_alone() -> None:
    robot = Robot("guide").know()
    robot.tick()
    robot.feel("hand", (1, 2, 0.2))
    on = robot.tick()
    assert on.streams_on.tolist() == [4]
    robot.feel("hand", (1, 0, 0.0), seq=1)
    ticks: list[TickOutput] = []
    for _ in range(150):
        if not any(len(tick.streams_off) for tick in ticks):
            say(robot, 1, patch="hand")
        ticks.append(robot.tick())
    off = [i for i, tick in enumerate(ticks) if len(tick.streams_off)]
    assert len(off) == 1
    assert ticks[off[0]].streams_off.tolist() == [4]
    assert off[0] * TICK_NS == pytest.approx(500_000_000, abs=2 * TICK_NS)
    assert not any(len(tick.streams_on) for tick in ticks)


def test_guidance_is_that_of_the_paper() -> None:
    """(0.14 − 0.05) × 1.0 = 0.09 rad/s on one DoF [M14]; cells add up; what is old is let go."""
    robot = Robot("guide").know()
    robot.tick()
    robot.feel("arm", (0, 2, 0.14))
    assert robot.tick().velocity_rad_s.tolist() == pytest.approx([0.09, 0.0])
    robot.feel("hand", (0, 2, 0.14))
    assert robot.tick().velocity_rad_s.tolist() == pytest.approx([0.18, 0.0])
    drives = robot.brain.reaction_log.rows
    assert drives[["cell", "channel", "tick_ns"]].tolist() == [(0, 0, TICK_NS), (3, 0, 2 * TICK_NS)]
    assert (drives["tick_ns"] - drives["t_sampled_ns"] == 2000).all()
    for _ in range(12):  # nothing more is heard of that touch for longer than `input_timeout_ms`
        tick = robot.tick()
    assert not tick.velocity_rad_s.any()


def test_reactions_can_be_switched_off() -> None:
    robot = Robot("guide", reactions={"enabled": False}).know()
    robot.tick()
    robot.feel("arm", (0, 4, 1.0))
    tick = robot.tick()
    assert not tick.velocity_rad_s.any()
    assert not len(tick.streams_on)
    assert not len(robot.brain.reaction_log.rows)


def test_a_silent_skin_slows_the_robot_down() -> None:
    """50 ms are tolerated, then the speed falls to rest within 100 ms, until the skin is back."""
    robot = Robot("bow", poses_rad={"bow": (30.0, 0.2)})
    assert robot.tick(skin_lag_ns=50_000_000).velocity_rad_s.tolist() == [0.4, 0.0]
    speeds = [robot.tick(skin_lag_ns=50_000_001).velocity_rad_s[0] for _ in range(30)]
    assert all(b < a or a == 0.0 for a, b in itertools.pairwise(speeds))
    assert speeds[18] > 0.0
    assert speeds[20:] == [0.0] * 10
    assert robot.tick().velocity_rad_s[0] > 0.0


def test_lost_cells_feel_nothing_and_are_asked_for_nothing() -> None:
    robot = Robot("guide", "structure").know()
    robot.tick()
    robot.feel("hand", (0, 4, 1.0))
    assert robot.tick().velocity_rad_s[0] > 0.5
    robot.brain.tactile_state.set_present(robot.skin.cells("hand"), False)
    assert not robot.tick().velocity_rad_s.any()
    robot.feel("hand", (0, 4, 1.0), seq=1)
    assert not robot.tick().velocity_rad_s.any()
    asked = {cell for tick in robot.live() for cell in tick.streams_on.tolist()}
    assert asked == {0, 1, 2}


anything = st.floats(width=32) | st.sampled_from([0.0, 0.14, 1.0, math.nan, math.inf])
felt = st.lists(
    st.tuples(st.sampled_from(sorted(SIZES)), st.integers(0, 1), st.integers(0, 4), anything), max_size=6
)


@settings(max_examples=60)
@given(
    program=st.permutations(["bow", "structure", "map", "guide", "home"]),
    ticks=st.lists(
        st.tuples(felt, st.tuples(*[st.floats(-1e6, 1e6)] * 2), st.booleans()), min_size=1, max_size=20
    ),
)
def test_whatever_comes_in_what_goes_out_is_finite_and_within_the_limit(
    program: list[str], ticks: list[tuple[Any, tuple[float, float], bool]]
) -> None:
    robot = Robot(*program).know()
    for rows, position_rad, streamed in ticks:
        for seq, (patch, cell, level, value) in enumerate(rows):
            robot.feel(patch, (cell, level, value), seq=seq)
            if streamed:
                full = np.zeros(1, dtype=STREAM_ROW)
                full["t_sampled_ns"], full["cell"], full["values"] = robot.t_ns - 2000, cell, value
                message = Stream(patch=patch, t_ns=0, watermark_ns=0, n_events=0, rows=full.tobytes())
                robot.skin.add_stream(patch, message)
        robot.position_rad = np.array(position_rad)
        velocity = robot.tick().velocity_rad_s
        assert np.isfinite(velocity).all()
        assert (np.abs(velocity) <= 1.2).all()


arrivals = st.lists(
    st.tuples(
        st.sampled_from(sorted(SIZES)),
        st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1)), min_size=1, max_size=4),
    ),
    max_size=6,
)


@given(arrivals=arrivals, random=st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_matter(
    arrivals: list[tuple[str, list[tuple[int, int]]]], random: random.Random
) -> None:
    """Rows come out by (delivery, patch, gateway, number), at the tick after their delivery and only once."""
    messages = [
        events(
            patch,
            *[(cell, 1, 0.5)] * len(rows),
            t_delivered_ns=[t * TICK_NS for t, _ in rows],
            seq=10 * i,
            channel=[channel for _, channel in rows],
        )
        for i, (patch, rows) in enumerate(arrivals)
        for cell in [i % 2]
    ]
    taken = []
    for jumbled in (messages, random.sample(messages, len(messages))):
        skin = CellInput(SIZES)
        assert sum(skin.add_events(m.patch, m) for m in jumbled) == sum(len(m.cell) for m in messages)
        ticks = [skin.take_delivered(t_ns)[0] for t_ns in range(0, 6 * TICK_NS, TICK_NS)]
        taken.append([(tick.cell.tolist(), tick.rows.tolist()) for tick in ticks])
        for t, tick in enumerate(ticks):
            assert (tick.rows["t_delivered_ns"] == (t - 1) * TICK_NS).all()
    assert taken[0] == taken[1]
    assert sum(len(cells) for cells, _ in taken[0]) == sum(len(m.cell) for m in messages)
    first = {"arm": 0, "hand": 3}
    numbers = {first[m.patch] + cell for m in messages for cell in m.cell}
    assert {cell for cells, _ in taken[0] for cell in cells} == numbers


def test_a_command_says_when_it_takes_effect_and_what_was_sent_with_it() -> None:
    robot = Wired("structure", "bow")
    counted = 0
    for t_ns in range(0, 2000 * TICK_NS, TICK_NS):
        command = robot.step()
        assert (command.t_ns, command.effect_ns) == (t_ns, t_ns + TICK_NS)
        assert all(config.t_ns == command.effect_ns for config in robot.configs)
        by_patch = {patch: sum(c.patch == patch for c in robot.configs) for patch in SIZES}
        assert command.config_counts == {patch: n for patch, n in by_patch.items() if n}
        counted += len(robot.configs)
        if command.end_ns is not None:
            break
        assert command.watermark_ns == t_ns + 2 * TICK_NS
    assert robot.node.needs() is None
    # the end lies after the effect: until then, everybody still owes a frame to everybody
    assert command.end_ns is not None
    assert command.effect_ns < command.end_ns <= command.effect_ns + 20_000_000
    assert command.end_ns % 20_000_000 == 0
    assert command.watermark_ns > command.end_ns
    assert counted == 2 * S + robot.result.facts["repeated_stream_requests"]  # these cells never answer
    assert robot.result.facts["done"]
    assert [name for name, _ in robot.result.facts["stages"]] == ["structure", "bow"]


def test_nothing_begins_before_every_patch_that_lives_has_formed() -> None:
    waiting = Wired("bow", here=("arm",), lost=False)
    waiting.here = ("arm", "hand")
    for upstream in waiting.node.upstreams.values():
        upstream.count_arrivals()  # its frames come, its topology does not
    for _ in range(20):
        assert waiting.step().velocity_rad_s == [0.0, 0.0]
        assert waiting.result.facts["stages"] == []
    assert any(Wired("bow").step().velocity_rad_s)


def test_the_controller_goes_on_without_a_lost_patch() -> None:
    robot = Wired("map", here=("arm",))
    asked = []
    while robot.node.needs() is not None:
        robot.step()
        asked += robot.configs
    assert {config.patch for config in asked} == {"arm"}
    assert robot.result.facts["done"]


def test_two_controllers_that_hear_the_same_write_the_same_log() -> None:
    logs = []
    for value in (0.14, 0.14, 0.15):
        robot = Wired("bow")
        robot.step()
        robot.accept("events", events("arm", (0, 1, value)), "arm", "0")
        for _ in range(5):
            robot.step()
        logs.append(robot.result.facts["logs"]["controller"])
    assert logs[0] == logs[1] != logs[2]


two = events("arm", (0, 1, 0.5), (1, 1, 0.5))


@pytest.mark.parametrize(
    ("channel", "fields", "message", "said"),
    [
        ("joints", (), Joints(t_ns=0, watermark_ns=9**9, position_rad=[0.0, math.nan]), "finite"),
        ("joints", (), Joints(t_ns=0, watermark_ns=9**9, position_rad=[-math.inf, 0.0]), "finite"),
        ("joints", (), Joints(t_ns=0, watermark_ns=9**9, position_rad=[0.0]), "1 positions; expected 2"),
        ("joints", (), Joints(t_ns=0, watermark_ns=9**9, position_rad=[]), "0 positions"),
        ("joint_ranges", (), JointRanges(lowest_rad=[0.0], highest_rad=[1.0, 2.0]), "1 lowest and 2 highest"),
        ("joint_ranges", (), JointRanges(lowest_rad=[0.0, 1.0], highest_rad=[1.0, 0.0]), "range is empty"),
        (
            "joint_ranges",
            (),
            JointRanges(lowest_rad=[0.0] * 2, highest_rad=[1.0, math.nan]),
            "range is empty",
        ),
        ("period_end", ("leg",), PeriodEnd(patch="leg", t_ns=0, watermark_ns=9**9, n_events=0), "leg"),
        ("period_end", ("arm",), events("arm", (0, 1, 0.5)), "PeriodEnd"),
        ("events", ("arm", "3"), events("arm", (3, 1, 0.5)), "unknown cell of arm: .* 0 to 2"),
        ("events", ("arm", "0"), events("arm", (-1, 1, 0.5)), "unknown cell"),
        ("events", ("arm", "0"), events("hand", (0, 1, 0.5)), "hand under a key of arm"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), (1, 1, 0.5), value=[0.5]), "differ in length"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), seq=2**63), "64 bits"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), modality=[4]), "modality"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), modality=[-1]), "modality"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), channel=[3]), "channel"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), channel=[-1]), "channel"),
        ("bundle", ("arm",), events("arm", (0, 1, 0.5), modality=[1], channel=[1]), "channel"),
        (
            "stream",
            ("arm",),
            Stream(patch="arm", t_ns=0, watermark_ns=9, n_events=0, rows=bytes(61)),
            "61 bytes",
        ),
        (
            "stream",
            ("arm",),
            Stream(patch="arm", t_ns=0, watermark_ns=9, n_events=0, rows=b"\xff" * 60),
            "unknown cell",
        ),
        ("config", ("arm", "0"), Config(patch="arm", cell=0), "does not subscribe to channel config"),
    ],
)
def test_what_makes_no_sense_changes_nothing(
    channel: str, fields: tuple[str, ...], message: Message, said: str
) -> None:
    calm, told = Wired("bow"), Wired("bow")
    calm.step()
    told.step()
    with pytest.raises(ProtocolError, match=said):
        told.accept(channel, message, *fields)
    for name, upstream in told.node.upstreams.items():
        assert upstream.watermark_ns == calm.node.upstreams[name].watermark_ns
        assert upstream.n_missing == 0
    assert [told.step() for _ in range(5)] == [calm.step() for _ in range(5)]
    assert told.result.facts == calm.result.facts


def test_a_network_is_not_used_before_it_was_formed() -> None:
    """A host that is ahead tells of it early; when its message arrives must not matter."""
    wired = Wired("bow", formed_ns=2 * TICK_NS + 1)
    assert [wired.step().stage for _ in range(5)] == ["", "", "", "bow", "bow"]
