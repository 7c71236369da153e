"""A finger that brushes over cells touches these and no others, in a sensible order, all alike."""

import itertools
import math

import body_scenes
import numpy as np
import pytest

from skinnet.analysis.metrics.teaching import teaching_metrics
from skinnet.body.teacher.finger_task import FingerPhase
from skinnet.body.teacher.strokes import SweepPath, plan_sweeps
from skinnet.deployment.environment.teacher import StrokeSpec, TeacherSpec
from skinnet.deployment.skin.patches import LatticeSpec, PatchSpec
from skinnet.runtime.process_result import ProcessResult

MS = 1_000_000
SIDE_M = 0.014


def brushed(folder, *strokes, radius_m=None):
    """The small arm with two patches: four by three cells on its top, and two below."""
    lattice = LatticeSpec(
        columns=4, rows=3, origin_m=(0.3, 0, 0.05), normal=(0, 0, 1), up=(1, 0, 0), radius_m=radius_m
    )
    top = PatchSpec(name="top", body="arm", lattice=lattice, interfaces=())
    under = LatticeSpec(columns=2, rows=1, origin_m=(0.3, 0, -0.02), normal=(0, 0, -1), up=(1, 0, 0))
    patches = (top, PatchSpec(name="under", body="arm", lattice=under))
    specs = tuple(StrokeSpec(**{"stage": "attend", "start_s": 0.1, **keys}) for keys in strokes)
    body = body_scenes.body_of(
        folder,
        body_scenes.ARM.format(more="", sensors=""),
        patches,
        ("turn", "lift"),
        teacher=TeacherSpec(strokes=specs),
    )
    body.begin_stage("attend")
    return body


def run(body, until_ms, command=(0.0, 0.0)):
    """Forces (n, 14) of all cells over time."""
    body.set_command(command)
    rows = []
    while body.t_ns < until_ms * MS:
        body.advance(body.t_ns + 4 * MS)
        rows.append(body.stimulus()[:, :3].sum(axis=1))
    return np.array(rows)


@pytest.mark.parametrize("radius_m", [None, 0.045], ids=["plane", "around a limb"])
def test_all_cells_of_a_patch_are_touched_and_no_others(tmp_path, radius_m):
    body = brushed(tmp_path, {"cells": ("top",)}, radius_m=radius_m)
    forces_n = run(body, 8000, command=(0.05, -0.03))
    (truth,) = body.teacher.outcome.strokes
    assert sorted(truth.requested_cells) == truth.touched_cells == list(range(12))
    assert truth.end_ns is not None
    assert body.teacher.phase is FingerPhase.PARKED
    total_n = forces_n.sum(axis=1)
    brushing_n = 1.5e6 * math.pi * 0.008 * 0.002**2
    steady = total_n[total_n > 0.5 * brushing_n]
    assert len(steady) > 500
    assert steady.max() < 1.6 * brushing_n, "as deep everywhere, between two cells too"
    assert np.percentile(steady, 5) > 0.8 * brushing_n


def test_some_cells_and_several_patches(tmp_path):
    body = brushed(tmp_path, {"cells": ("top/0-3", "under/1", "top/10")})
    run(body, 8000)
    (truth,) = body.teacher.outcome.strokes
    assert truth.requested_cells == [0, 1, 2, 3, 13, 10]
    assert truth.touched_cells == [0, 1, 2, 3, 10, 13]
    figures = teaching_metrics(ProcessResult("body", "body", body.ground_truth().facts, {}))
    assert figures["strokes.touched_cells"] == [6]
    assert (figures["strokes.missed_cells"], figures["strokes.unintended_cells"]) == (0, 0)
    assert 0.1 < figures["strokes.peak_force_n"] < 0.5


def test_the_next_time_the_next_stroke(tmp_path):
    body = brushed(tmp_path, {"cells": ("top/0",)}, {"cells": ("under",)})
    for stage in ("rest", "attend", "rest", "attend"):
        run(body, body.t_ns // MS + 3000)
        body.begin_stage(stage)
    assert [truth.requested_cells for truth in body.teacher.outcome.strokes] == [[0], [12, 13]]


def test_a_stroke_ends_with_its_stage(tmp_path):
    body = brushed(tmp_path, {"cells": ("top",)})
    run(body, 1500)
    assert body.teacher.phase is FingerPhase.HOLD
    body.begin_stage("rest")
    assert body.teacher.phase is FingerPhase.WITHDRAW
    forces_n = run(body, 2500)
    (truth,) = body.teacher.outcome.strokes
    assert truth.end_ns < 2200 * MS
    assert 0 < len(truth.touched_cells) < 12
    assert not forces_n[-1].any()


def test_the_way_goes_from_a_corner_to_neighbours_and_lifts_over_gaps(tmp_path):
    body = brushed(tmp_path, {"cells": ("top", "top/0-1", "under")})
    spots = [sweep.targets for sweep in body.teacher.sweeps[0]]
    pitch_m = math.sqrt(3) * SIDE_M
    for sweep in spots:
        steps_m = [np.linalg.norm(b.point_m - a.point_m) for a, b in itertools.pairwise(sweep)]
        np.testing.assert_allclose(steps_m, pitch_m, rtol=1e-6)
    assert spots[0][0].row in (0, 3, 8, 11)
    apart = [spots[0][0], spots[0][3]]
    assert [len(sweep) for sweep in plan_sweeps(apart, SIDE_M)] == [1, 1]


def test_between_two_cells_of_a_round_patch_the_way_follows_the_curve(tmp_path):
    body = brushed(tmp_path, {"cells": ("top/0-3",)}, radius_m=0.045)
    (sweep,) = body.teacher.sweeps[0]
    axis_m = np.array([0.0, 0.005])
    for way_m in np.linspace(0.0, sweep.length_m, 50):
        spot = sweep.target_at(way_m)
        outward_m = spot.point_m[1:] - axis_m
        assert np.linalg.norm(outward_m) == pytest.approx(0.057, abs=2e-4)
        np.testing.assert_allclose(spot.normal[1:], outward_m / 0.057, atol=0.02)
    assert SweepPath([sweep.targets[0]]).length_m == 0.0
