"""A teacher leads a robot that evades: into reachable poses, without a touch, and never for ever."""

import body_scenes
import msgspec
import numpy as np
import pytest
from evading import MS, Evader

from skinnet.analysis.metrics.teaching import teaching_metrics
from skinnet.body.simulation import BodySimulation
from skinnet.body.teacher.finger_task import FingerPhase
from skinnet.deployment.environment.teacher import GoalSpec, LessonSpec, TeacherSpec
from skinnet.deployment.load import load
from skinnet.deployment.skin.patches import CellPoseSpec, InterfaceSpec, PatchSpec
from skinnet.runtime.process_result import ProcessResult

S = 1000 * MS
TIP_M = (0.45, 0.0, 0.0)
"""A point at the end of the small arm."""
PADS = (
    CellPoseSpec(position_m=(0.30, 0.0, 0.01), normal=(0, 0, 1), x_axis=(0, 1, 0)),
    CellPoseSpec(position_m=(0.33, 0.0, -0.01), normal=(0, 0, -1), x_axis=(0, 1, 0)),
    CellPoseSpec(position_m=(0.35, 0.03, 0.0), normal=(0, 1, 0), x_axis=(0, 0, 1)),
    CellPoseSpec(position_m=(0.35, -0.03, 0.0), normal=(0, -1, 0), x_axis=(0, 0, 1)),
)
"""One cell on every side of the small arm: top, bottom, left, right."""


def lesson(at_m, **keys):
    goal = GoalSpec(body="arm", point_m=TIP_M, position_m=tuple(at_m))
    keys = {"clearance_m": 0.002, "start_s": 0.1, "tolerance_m": 0.01, **keys}
    return LessonSpec(**{"stage": "guide", "goals": (goal,), **keys})


def arm(folder, *lessons, cells=PADS, more=""):
    mjcf = body_scenes.ARM.format(more=more, sensors="")
    patches = (body_scenes.patch("skin", "arm", *cells),)
    teacher = TeacherSpec(lessons=lessons)
    body = body_scenes.body_of(folder, mjcf, patches, ("turn", "lift"), teacher=teacher)
    body.begin_stage("guide")
    return body


def tip_m(turn_rad, lift_rad):
    """Where the point of the small arm is; a positive lift lowers it."""
    out_m = TIP_M[0] * np.cos(lift_rad)
    return out_m * np.cos(turn_rad), out_m * np.sin(turn_rad), 1.05 - TIP_M[0] * np.sin(lift_rad)


@pytest.mark.parametrize("pose", [(0.4, 0.0), (0.0, -0.3), (-0.35, 0.4)])
def test_a_reachable_pose_is_reached_without_a_touch(tmp_path, pose):
    body = arm(tmp_path, lesson(tip_m(*pose)))
    Evader(body).run(40 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "reached"
    assert max(truth.error_m) <= 0.01 < max(truth.begin_error_m)
    assert truth.contact_ns is None
    assert truth.min_height_m > 0.0015
    np.testing.assert_allclose(body.joints(), pose, atol=0.03)
    assert body.teacher.phase is FingerPhase.PARKED
    assert sum(touch.joint_motion_rad for touch in truth.touches) < 1.5 * np.abs(pose).sum()


def test_the_first_touch_is_on_the_side_from_which_the_arm_shall_go(tmp_path):
    """A finger on the left turns it to the right, one on the top lowers it."""
    for pose, side in (((-0.4, 0.0), 2), ((0.4, 0.0), 3), ((0.0, 0.4), 0), ((0.0, -0.4), 1)):
        body = arm(tmp_path, lesson(tip_m(*pose)))
        body.advance(200 * MS)
        assert [touch.cell for touch in body.teacher.outcome.lessons[0].touches] == [side]


def test_the_figures_of_a_run_tell_of_its_lessons(tmp_path):
    body = arm(tmp_path, lesson(tip_m(0.3, 0.0)), lesson(tip_m(0.0, 0.3)))
    evader = Evader(body)
    evader.run(10 * S)
    body.begin_stage("guide")
    body.advance(body.t_ns + 150 * MS)
    figures = teaching_metrics(ProcessResult("body", "body", body.ground_truth().facts, {}))
    assert figures["lessons.outcomes"] == ["reached", "not over"]
    assert figures["lessons.error_mm"][0] < 10.0 < 100.0 < figures["lessons.error_mm"][1]
    assert figures["lessons.touches"] == [1, 1]
    assert 1.0 < figures["lessons.duration_s"][0] < 10.0
    assert figures["lessons.duration_s"][1] is None
    assert figures["lessons.contacts"] == 0
    assert figures["lessons.min_distance_mm"] > 1.5
    assert "strokes.count" not in figures


def test_only_the_cells_of_the_lesson_are_used(tmp_path):
    body = arm(tmp_path, lesson(tip_m(-0.3, 0.3), cells=("skin/0-1",)))
    Evader(body).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "nothing helps"
    assert {touch.cell for touch in truth.touches} == {0}
    np.testing.assert_allclose(body.joints(), [0.0, 0.3], atol=0.05)


def test_what_evasion_cannot_do_ends_by_itself(tmp_path):
    """No cell on the right side: nobody can turn the arm to the left."""
    body = arm(tmp_path, lesson(tip_m(0.4, 0.0)), cells=PADS[:3])
    Evader(body).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "nothing helps"
    assert truth.end_ns < 5 * S


def test_a_cell_that_does_not_answer_is_given_up_for_another(tmp_path):
    spare = CellPoseSpec(position_m=(0.40, 0.03, 0.0), normal=(0, 1, 0), x_axis=(0, 0, 1))
    body = arm(tmp_path, lesson(tip_m(-0.4, 0.0)), cells=(*PADS, spare))
    body.advance(200 * MS)
    first = body.teacher.outcome.lessons[0].touches[0].cell
    Evader(body, asleep=[first]).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "reached"
    assert [touch.cell for touch in truth.touches].count(first) == 1


def test_a_robot_that_does_not_react_is_left_alone(tmp_path):
    body = arm(tmp_path, lesson(tip_m(-0.4, 0.4)))
    body.advance(30 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "nothing helps"
    assert sorted(touch.cell for touch in truth.touches) == [0, 2]
    assert truth.min_height_m == pytest.approx(0.002, abs=5e-4)
    assert truth.contact_ns is None


def test_patience_has_an_end(tmp_path):
    body = arm(tmp_path, lesson(tip_m(-0.5, 0.5), timeout_s=2.0))
    Evader(body).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "out of patience"
    assert truth.end_ns - truth.begin_ns < 3 * S


def test_the_finger_leaves_with_the_stage_and_the_next_lesson_comes_with_the_next(tmp_path):
    body = arm(tmp_path, lesson(tip_m(-0.5, 0.0)), lesson(tip_m(0.5, 0.0)))
    evader = Evader(body)
    evader.run(1 * S)
    assert body.teacher.phase is not FingerPhase.PARKED
    body.begin_stage("rest")
    evader.run(3 * S)
    assert body.teacher.outcome.lessons[0].outcome == "stage over"
    assert body.teacher.phase is FingerPhase.PARKED
    for stage, lessons in (("guide", 2), ("rest", 2), ("guide", 2)):
        body.begin_stage(stage)
        body.advance(body.t_ns + 300 * MS)
        assert [truth.lesson for truth in body.teacher.outcome.lessons] == list(range(lessons))
    assert body.teacher.outcome.lessons[1].touches[0].cell == 3


def test_a_cell_behind_something_is_not_used(tmp_path):
    """A wall 3 cm beside the arm: no place for the finger between them."""
    wall = '<body name="wall" pos="0.35 {y} 1.05"><geom type="box" size="0.2 0.01 0.2"/></body>'
    for y_m, outcome in ((0.10, 2), (0.075, None)):
        body = arm(tmp_path, lesson(tip_m(-0.4, 0.0)), more=wall.format(y=y_m))
        body.advance(200 * MS)
        touches = body.teacher.outcome.lessons[0].touches
        assert [touch.cell for touch in touches] == ([] if outcome is None else [outcome])
        assert not body.stimulus()[:, :3].any()
        assert body.data.ncon == 0


def test_by_force_the_finger_pushes(tmp_path):
    body = arm(tmp_path, lesson(tip_m(-0.3, 0.25), clearance_m=None, depth_m=0.007))
    Evader(body, force_gain=1.0, proximity_gain=0.0).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "reached"
    assert truth.contact_ns is not None
    assert -0.007 < truth.min_height_m < -0.005
    assert 0.6 < truth.peak_force_n < 4.0


def on_ring(name, body, radius_m, angle_deg):
    """A cell around a limb; 0° points to the front of a hanging arm, 90° to its outer side."""
    angle = np.radians(angle_deg)
    normal = (float(np.cos(angle)), float(np.sin(angle)) * (1 if name.startswith("left") else -1), 0.0)
    cell = CellPoseSpec(
        position_m=(radius_m * normal[0], radius_m * normal[1], -0.125), normal=normal, x_axis=(0, 0, 1)
    )
    return PatchSpec(name=name, body=body, cells=(cell,), interfaces=(InterfaceSpec(cell=0, port=0),))


def hrp2_with_skin_all_around(lessons):
    """The HRP-2 with four cells around each upper arm and forearm."""
    deployment = load(body_scenes.HRP2, ())
    patches = tuple(
        on_ring(f"{side}_{part}_{angle}", f"{side}_{part}", radius_m, angle)
        for side in ("left", "right")
        for part, radius_m in (("upper_arm", 0.050), ("forearm", 0.045))
        for angle in (0, 90, 180, 270)
    )
    teacher = TeacherSpec(lessons=lessons)
    deployment = msgspec.structs.replace(deployment, patches=patches, cell_processes=1, teacher=teacher)
    return BodySimulation(deployment, body_scenes.DEPLOYMENTS)


def arms_at(elbow_m, wrist_m):
    """Goals of both arms, mirror images of one another."""
    return tuple(
        GoalSpec(body=f"{side}_{body}", position_m=(at_m[0], y * at_m[1], at_m[2]))
        for side, y in (("left", 1), ("right", -1))
        for body, at_m in (("forearm", elbow_m), ("hand", wrist_m))
    )


def test_both_arms_of_a_humanoid_are_led_into_a_pose():
    """Elbows and wrists come within 15 mm, though each cell moves several joints, by the map of home."""
    goals = arms_at((0.196, 0.385, 1.090), (0.437, 0.444, 1.063))
    body = hrp2_with_skin_all_around(
        (LessonSpec(stage="guide", goals=goals, clearance_m=0.002, start_s=0.1),)
    )
    body.begin_stage("guide")
    Evader(body, fixed_map=True).run(60 * S)
    (truth,) = body.teacher.outcome.lessons
    assert truth.outcome == "reached"
    assert max(truth.begin_error_m) > 0.15
    assert max(truth.error_m) <= 0.015
    assert truth.contact_ns is None
    assert truth.min_height_m > 0.0015
