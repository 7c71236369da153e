"""The whole body: the same calls give the same bits, reading changes nothing, ground truth is exact."""

import math

import body_scenes
import numpy as np
import pytest

from skinnet.body.ground_truth.contact_onsets import (
    CrossingDetector,
    distance_thresholds_m,
    force_thresholds_n,
)
from skinnet.deployment.environment.teacher import TouchSpec
from skinnet.deployment.skin.cells import ForceSpec, ProximitySpec
from skinnet.errors import ModelError
from skinnet.protocol.messages import STIMULUS_NAMES, Modality

MS = 1_000_000
TOUCH = TouchSpec(cell="skin/0", stage="guide", start_s=0.0, approach_m=0.08, speed_m_s=0.1, depth_m=0.010)


def history(body, until_ms, chunk_ms, read_every=1):
    """Joints and stimuli at common times, under a command that varies with time only."""
    rows = []
    for k in range(until_ms // 4):
        body.set_command([0.5 * math.sin(k / 7)] * body.n_dofs)
        for end_ms in range(4 * k + chunk_ms, 4 * k + 5, chunk_ms):
            body.advance(end_ms * MS)
            if read_every and end_ms % read_every == 0:
                body.stimulus()
                body.joints()
        rows.append(np.concatenate([body.joints(), body.data.qvel, body.data.ctrl]).tobytes())
    return rows, body.stimulus().tobytes(), list(body.recorder.crossings.crossings)


def touched_arm(folder):
    body = body_scenes.arm(folder, touches=(TOUCH,))
    body.begin_stage("guide")
    return body


def test_the_same_calls_give_the_same_bits(tmp_path):
    one, two = (history(touched_arm(tmp_path), 1200, 4, 4) for _ in range(2))
    assert one == two
    assert len(one[2]) >= 4, "something must have happened"


@pytest.mark.parametrize(("chunk_ms", "read_every"), [(1, 1), (2, 4), (4, 0)])
def test_chunks_and_readings_change_nothing(tmp_path, chunk_ms, read_every):
    reference = history(touched_arm(tmp_path), 1200, 4, 4)
    other = history(touched_arm(tmp_path), 1200, chunk_ms, read_every)
    assert len(reference[2]) >= 4, "the finger rubs over the skin meanwhile"
    assert other[0] == reference[0]
    assert other[1] == reference[1]


def test_the_seed_moves_the_sway_and_nothing_else():
    one, two = body_scenes.hrp2(), body_scenes.hrp2("seed=2")
    for body in (one, two):
        body.advance(100 * MS)
    sway = one.model.sway_qpos_address
    assert np.abs(one.data.qpos[sway] - two.data.qpos[sway]).max() > 1e-5
    np.testing.assert_allclose(one.joints(), two.joints(), atol=1e-3)


def test_force_crossings_are_exact_between_physics_steps(tmp_path):
    """Against the same touch with steps of 0.1 ms: the crossing lies within a hundredth of a step or so."""
    coarse, fine = touched_arm(tmp_path), body_scenes.arm(tmp_path, touches=(TOUCH,), timestep_ms=0.1)
    fine.begin_stage("guide")
    for body in (coarse, fine):
        body.advance(1200 * MS)
    ours, theirs = (
        {
            (c.cell, c.channel, c.level): c.t_ns
            for c in body.recorder.crossings.crossings
            if c.modality is Modality.FORCE
        }
        for body in (coarse, fine)
    )
    assert len(ours) >= 3  # all force cells of the cell that is touched
    assert ours.keys() == theirs.keys()
    for key, t_ns in ours.items():
        assert t_ns == pytest.approx(theirs[key], abs=0.3 * MS), key


def test_crossings_are_upward_only_and_interpolated():
    truth = CrossingDetector(np.array([1.0, 2.0]), np.array([0.05, 0.02]))
    for t_ms, force in enumerate([0.0, 0.5, 2.5, 0.0, 1.5]):
        truth.observe_forces(t_ms * MS, MS, np.array([[0.0, force, 0.0]]), force > 0)
    found = [(c.t_ns, c.cell, c.channel, c.level) for c in truth.crossings]
    assert found == [
        (1 * MS + MS // 4, 0, 1, 1),
        (1 * MS + 3 * MS // 4, 0, 1, 2),
        (3 * MS + round(MS / 1.5), 0, 1, 1),
    ]
    truth.crossings.clear()
    for t_ms, distance in ((0, math.inf), (4, 0.06), (8, 0.03), (12, 0.06), (16, math.inf), (20, 0.01)):
        stimulus = np.zeros((1, len(STIMULUS_NAMES)))
        stimulus[0, STIMULUS_NAMES.index("distance_m")] = distance
        truth.observe_stimulus(t_ms * MS, stimulus)
    found = [(c.t_ns, c.level) for c in truth.crossings]
    assert found == [(4 * MS + 4 * MS // 3, 1), (20 * MS, 1), (20 * MS, 2)]


def test_thresholds_are_those_of_table_1():
    """0.05 ≈ 0.6 N lies between the lowest two levels; 0.01 is the reading at 5 cm [M14]."""
    force_n = force_thresholds_n(ForceSpec())
    assert force_n[0] < 0.6 < force_n[1] < 1.0
    assert np.all(np.diff(force_n) > 0)
    distance_m = distance_thresholds_m(ProximitySpec())
    assert distance_m[0] == pytest.approx(0.05)
    assert np.all(np.diff(distance_m) < 0)
    assert distance_m[-1] > 0


def test_a_simulation_that_blows_up_says_so(tmp_path):
    body = body_scenes.arm(tmp_path)
    body.data.qvel[0] = 1e200
    with pytest.raises(ModelError, match="unstable"):
        body.advance(100 * MS)


def test_every_touch_of_the_shipped_deployment_reaches_its_cell():
    """On a robot that does not evade: the script touches what it names, and stops short where it says so."""
    body = body_scenes.hrp2()
    touches = body_scenes.load(body_scenes.HRP2).teacher.touches
    for stage in ("force_guidance", "proximity_guidance"):
        body.begin_stage(stage)
        body.advance(body.t_ns + 45_000 * MS)
        script = [index for index, touch in enumerate(touches) if touch.stage == stage]
        done = [truth for truth in body.teacher.outcome.touches if truth.stage == stage]
        assert [truth.touch for truth in done] == script
        for truth in done:
            assert truth.end_ns is not None
            assert (truth.contact_ns is not None) == (stage == "force_guidance")
            if truth.contact_ns is not None:
                assert truth.target_peak_force_n > 0.9
