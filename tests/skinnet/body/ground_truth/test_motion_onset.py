"""Onsets of commanded motion: from rest only, at the first true motion along the command."""

import numpy as np

from skinnet.body.ground_truth.motion_onset import MotionOnsets

MS = 1_000_000
REST = np.zeros(2)
COMMAND = np.array([0.3, -0.4])


def test_a_motion_begins_at_a_tenth_of_the_commanded_speed() -> None:
    motion = MotionOnsets()
    motion.begin_command(0, REST, REST)
    assert not motion.is_pending
    motion.begin_command(10 * MS, COMMAND, REST)
    assert motion.is_pending
    assert not motion.observe(11 * MS, 2, 0.09 * COMMAND)
    assert not motion.observe(12 * MS, 2, -COMMAND), "the other way"
    assert motion.observe(13 * MS, 2, 0.11 * COMMAND)
    assert not motion.is_pending
    assert not motion.observe(14 * MS, 2, COMMAND), "it begins once"
    between = 12 * MS - 1 + round(1.1 / 1.11 * MS)
    assert motion.facts() == [(10 * MS, between)], "a tenth, between -1 and 0.11"


def test_motion_across_the_command_is_none() -> None:
    motion = MotionOnsets()
    motion.begin_command(0, COMMAND, REST)
    assert not motion.observe(MS, 2, np.array([0.4, 0.3]))


def test_a_robot_that_coasts_or_is_under_way_has_no_onset() -> None:
    motion = MotionOnsets()
    motion.begin_command(0, COMMAND, 0.2 * COMMAND)
    assert motion.facts() == []
    motion.begin_command(5 * MS, 2.0 * COMMAND, REST)
    assert motion.facts() == [], "the command before was not zero"


def test_a_command_that_ends_too_early_moves_nothing() -> None:
    motion = MotionOnsets()
    motion.begin_command(0, COMMAND, REST)
    motion.begin_command(5 * MS, REST, REST)
    assert not motion.is_pending
    assert not motion.observe(6 * MS, 2, COMMAND)
    motion.begin_command(10 * MS, COMMAND, REST)
    motion.begin_command(15 * MS, 2.0 * COMMAND, REST)
    assert not motion.observe(17 * MS, 2, 0.15 * COMMAND), "a tenth of the present command"
    assert motion.observe(18 * MS, 2, 0.25 * COMMAND)
    assert motion.facts() == [(0, None), (10 * MS, 17_499_999)]


def test_the_onset_is_found_between_two_steps_of_any_length() -> None:
    """A speed that rises evenly reaches a tenth of the command at 4.2 ms; a step has its mean speed."""
    for step_ns in (MS // 8, MS // 2, MS, 2 * MS):
        motion = MotionOnsets()
        motion.begin_command(0, COMMAND, REST)
        t_ns = 0
        while motion.is_pending:
            t_ns += step_ns
            motion.observe(t_ns, step_ns, (t_ns - 0.5 * step_ns) / (42 * MS) * COMMAND)
        assert motion.facts() == [(0, 4_200_000)]


def test_a_slower_command_finds_the_robot_moving_already() -> None:
    motion = MotionOnsets()
    motion.begin_command(0, COMMAND, REST)
    motion.observe(MS, 2, 0.09 * COMMAND)
    motion.begin_command(MS, 0.5 * COMMAND, 0.09 * COMMAND)
    assert motion.observe(2 * MS, 2, 0.2 * COMMAND)
    assert motion.facts() == [(0, MS)]
