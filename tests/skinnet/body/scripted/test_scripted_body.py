"""A body without physics: exact joints, accelerations by independent differences, the same node around it."""

import json
from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import pytest
from launching import run
from locations import ROOT

from skinnet.body.ground_truth.cell_kinematics import cell_poses
from skinnet.body.process import build
from skinnet.body.scripted.scripted_body import ScriptedBody
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import load
from skinnet.deployment.checks import check
from skinnet.deployment.load import from_document, read_document
from skinnet.errors import DeploymentError
from skinnet.protocol.messages import STIMULUS_NAMES
from skinnet.skin.placement import place_patches

MS = 1_000_000
FRAME_S = 0.004
ACCELERATION = slice(4, 7)
UR5, H1 = (ROOT / "deployments" / f"{name}.toml" for name in ("ur5_260", "h1_1260"))
ARM = ROOT / "deployments" / "two_link_arm.toml"


def scripted(*overrides: str, file: Path = UR5) -> ScriptedBody:
    return ScriptedBody(load(file, overrides), file.parent)


def poses_at(body: ScriptedBody, world: BodySimulation, position_rad):
    """Where the cells are in a pose, by the physical twin."""
    world.data.qpos[world.model.qpos_address] = position_rad
    mujoco.mj_kinematics(world.model.mj, world.data)
    return cell_poses(world)


@pytest.mark.parametrize("file", [UR5, H1, body_scenes.HRP2], ids=lambda path: path.stem)
def test_at_rest_it_feels_what_physics_feels(file):
    deployment = load(file, ("scripted_stimuli.stimulated_fraction=0.0",))
    still = ScriptedBody(deployment, file.parent).stimulus()
    real = BodySimulation(deployment, file.parent).stimulus()
    np.testing.assert_allclose(still[:, ACCELERATION], real[:, ACCELERATION], atol=1e-6)
    np.testing.assert_array_equal(still[:, 7], real[:, 7])
    assert not still[:, :3].any()
    assert np.isinf(still[:, 3]).all()


def test_joints_follow_their_command_and_stop_at_their_limits():
    body = scripted()
    start, limit = body.joints(), body.model.range_rad[2, 1]
    velocity = np.array([0.3, -0.2, 1.0, 0.0, 0.1, -1.5])
    assert body.set_command(velocity)
    body.advance(999 * MS)
    np.testing.assert_allclose(body.joints(), start + 0.999 * velocity, atol=1e-12)
    body.advance(2000 * MS)
    assert body.joints()[2] == limit
    np.testing.assert_array_equal(body.range_rad, body.model.range_rad)
    assert not body.set_command(np.full(6, 1.6))
    assert not body.set_command(np.full(6, np.nan))
    assert not body.set_command(np.zeros(5))
    held = body.joints()
    body.advance(2100 * MS)
    np.testing.assert_array_equal(body.joints(), held)
    assert body.ground_truth().facts["refused_commands"] == 3


@pytest.mark.parametrize("chunk_ms", [1, 4, 5, 20])
def test_chunks_and_readings_change_nothing(chunk_ms):
    body, other = scripted(), scripted()
    for start_ms in range(0, 800, 20):
        for one, step_ms in ((body, 20), (other, chunk_ms)):
            one.set_command(np.full(6, 0.3 - 0.001 * start_ms))
            for end_ms in range(start_ms + step_ms, start_ms + 21, step_ms):
                one.advance(end_ms * MS)
                one.stimulus()
        np.testing.assert_array_equal(other.joints(), body.joints())
        np.testing.assert_array_equal(other.stimulus(), body.stimulus())


def test_accelerations_are_those_of_the_motion():
    """Second differences of the cells' positions by MuJoCo's kinematics, and gravity, in their frames."""
    deployment = load(UR5, ("scripted_stimuli.stimulated_fraction=0.0",))
    body, world = ScriptedBody(deployment, UR5.parent), BodySimulation(deployment, UR5.parent)
    velocity = np.array([1.2, -0.9, 0.7, 1.4, -1.1, 0.5])
    body.set_command(velocity)
    body.advance(40 * MS)
    middle, R_world_cell = poses_at(body, world, body.joints())
    h = 1e-3
    ahead, _ = poses_at(body, world, body.joints() + h * velocity)
    behind, _ = poses_at(body, world, body.joints() - h * velocity)
    expected = (ahead - 2 * middle + behind) / h**2 + [0, 0, 9.81]
    in_cell = np.einsum("nji,nj->ni", R_world_cell, expected)
    assert np.abs(expected - [0, 0, 9.81]).max() > 1.0, "something must move"
    np.testing.assert_allclose(body.stimulus()[:, ACCELERATION], in_cell, atol=1e-4)


def test_a_change_of_velocity_is_felt_as_its_mean_over_a_frame():
    deployment = load(UR5, ("scripted_stimuli.stimulated_fraction=0.0",))
    body, world = ScriptedBody(deployment, UR5.parent), BodySimulation(deployment, UR5.parent)
    change = np.array([0.01, 0.02, -0.01, 0.005, 0.01, 0.02])
    body.set_command(change)
    body.advance(4 * MS)
    h = 1e-6
    ahead, _ = poses_at(body, world, body.joints() + h * change)
    behind, _ = poses_at(body, world, body.joints() - h * change)
    _, R_world_cell = poses_at(body, world, body.joints())
    expected = (ahead - behind) / (2 * h) / FRAME_S + [0, 0, 9.81]
    in_cell = np.einsum("nji,nj->ni", R_world_cell, expected)
    np.testing.assert_allclose(body.stimulus()[:, ACCELERATION], in_cell, atol=2e-3)
    body.set_command(np.zeros(6))
    body.advance(12 * MS)
    assert np.linalg.norm(body.stimulus()[:, ACCELERATION], axis=1) == pytest.approx(9.81)


def test_crossings_of_scripted_touches_are_exact():
    """A raised cosine of 2 N in 0.2 s passes 0.6 N where its share is 0.3."""
    raw = read_document(ARM)
    touch = {"cells": ["fore_link/1"], "start_s": 0.1, "force_n": 2.0, "approach_s": 0.3, "rise_s": 0.2}
    body = ScriptedBody(from_document(raw | {"scripted_stimuli": {"presses": [touch]}}, "arm"), ARM.parent)
    body.advance(1000 * MS)
    forces = [fact for fact in body.ground_truth().facts["threshold_crossings"] if fact[2] < 3]
    assert len(forces) == 3
    expected_ns = (0.4 + 0.2 * np.arccos(1 - 2 * 0.3) / np.pi) * 1e9
    for t_ns, cell, _, reading in forces:
        assert t_ns == pytest.approx(expected_ns, abs=0.05 * MS)
        assert (cell, reading) == (6 + 6 + 1, 0.05)


def test_the_node_is_the_same_and_scripted_by_its_table(tmp_path):
    physical, script = (
        build(from_document(raw, "arm"), "body", ARM.parent, None)
        for raw in (read_document(ARM), read_document(ARM) | {"scripted_stimuli": {}})
    )
    assert type(physical) is type(script)
    sent: dict[str, list[str]] = {"physical": [], "script": []}
    for node, name in ((physical, "physical"), (script, "script")):
        node.start(lambda key, payload, name=name: sent[name].append(f"{key} {len(payload)}"))
    assert [line.split()[0] for line in sent["script"]] == [line.split()[0] for line in sent["physical"]]
    facts = [node.result() for node in (physical, script)]
    of_physics_only = {"unsensed_force"}  # a scripted body has no contact of its own
    assert facts[0].facts.keys() - facts[1].facts.keys() == of_physics_only
    assert facts[1].facts.keys() <= facts[0].facts.keys()
    assert facts[1].arrays.keys() - facts[0].arrays.keys() == {"presses"}


def test_a_bad_script_is_refused_by_the_check():
    raw = read_document(ARM)
    touch = {"cells": ["elbow/0"], "start_s": 0.0, "force_n": 1.0}
    with pytest.raises(
        DeploymentError, match=r"scripted_stimuli.presses\[0\].cells: 'elbow/0': unknown patch"
    ):
        check(from_document(raw | {"scripted_stimuli": {"presses": [touch]}}, "arm"))


@pytest.mark.parametrize(("file", "cells", "patches", "touched"), [(UR5, 260, 10, 130), (H1, 1260, 47, 693)])
@pytest.mark.parametrize("with_script", [True, False])
def test_shipped_skins_hold_with_and_without_script(file, cells, patches, touched, with_script):
    raw = read_document(file)
    if not with_script:
        del raw["scripted_stimuli"]
    deployment = from_document(raw, file.name)
    check(deployment)
    placed = place_patches(deployment.patches, deployment.cells)
    assert len(placed) == patches
    assert sum(patch.n_cells for patch in placed) == cells
    assert len(deployment.patches_by_process()) == 2
    if with_script:
        assert len(ScriptedBody(deployment, file.parent).press_schedule.cell_row) == touched
    else:
        body = BodySimulation(deployment, file.parent)
        body.advance(100 * MS)
        stimulus = body.stimulus()
        assert body.data.ncon == 0
        assert not stimulus[:, : STIMULUS_NAMES.index("distance_m")].any(), "nothing presses it at home"


@pytest.mark.timeout(300)
def test_the_robot_finds_itself_without_physics(tmp_path):
    """Structure and map of the two-link arm from kinematics alone, and a reaction to a scripted touch."""
    settings = (
        "scripted_stimuli.stimulated_fraction=0.0",
        "controller.structure.settle_s=0.2",
        "controller.structure.averaging_s=0.1",
    )
    figures = run(ARM, tmp_path, "--in-process", settings=settings)["metrics"]
    assert figures["structure.wrong_entries"] == 0
    assert figures["structure.is_tree"]
    assert figures["smm.sign_agreement"] == 1.0
    assert figures["smm.correlation"] >= 0.98


@pytest.mark.timeout(300)
def test_the_largest_skin_says_everything_by_the_clock_and_loses_nothing(tmp_path):
    settings = ("run.max_s=0.2", "cells.encoding.kind=periodic")
    figures = run(H1, tmp_path, "--in-process", settings=settings)["metrics"]
    assert figures["formation.unreached_cells"] == 0
    frames = round((200 - figures["formation.duration_ms"]) / 4)  # of the patch that was formed last
    assert 1260 * frames <= figures["network.data_packets"] < 1260 * 50
    assert figures["network.dropped"] == 0
    assert figures["network.conserved"]


@pytest.mark.processes
@pytest.mark.timeout(300)
def test_one_process_and_many_feel_the_same(tmp_path):
    settings = (
        "run.max_s=0.8",
        "scripted_stimuli.random_presses.start_s=0.1",
        "scripted_stimuli.stimulated_fraction=1.0",
        "cells.encoding.kind=send_on_delta",
    )
    one = run(UR5, tmp_path / "one", "--in-process", settings=settings)
    many = run(UR5, tmp_path / "many", settings=settings)
    assert many["log_sha256"] == one["log_sha256"]
    assert many["metrics"] == one["metrics"]
    assert one["metrics"]["network.data_packets"] > 2000
    assert json.loads((tmp_path / "one" / "summary.json").read_text())["outcome"] == "completed"
