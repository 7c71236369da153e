"""Onboarding: for every trait that a model may have, a deployment that a run accepts as it is written."""

from pathlib import Path
from typing import Any

import pytest
from onboarding_models import TRAITS, write_package, write_trait, write_two_arms
from rich.console import Console

from skinnet.body.model import load_model
from skinnet.body.servo_response import servo_response
from skinnet.deployment import load
from skinnet.deployment.robot import FoamSpec
from skinnet.deployment.skin.patches import CellPoseSpec, PatchSpec
from skinnet.errors import ModelError, UsageError
from skinnet.onboarding import skin_choice
from skinnet.onboarding.arms import find_arms
from skinnet.onboarding.onboard import onboard
from skinnet.onboarding.program import Template
from skinnet.onboarding.robot_survey import survey_robot
from skinnet.onboarding.skin_choice import SIDE_M
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import PreparedRun, RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay

JOINTS = {
    "no_keyframe": ("shoulder", "elbow"),
    "free_base_without_name": ("hip",),
    "default_classes": ("hinge",),
    "mimic_joint": ("shoulder", "elbow"),
    "tendon": ("shoulder", "elbow"),
    "gravity_aligned_wrist": ("shoulder", "elbow", "wrist_roll"),
    "names_to_quote": ("shoulder", '"elbow" é # 1'),
    "slide_joint": ("lift", "tilt"),
    "wheels": ("tilt",),
    "light_links": ("bend", "curl"),
    "terrain": ("hip",),
    "keyframe": ("shoulder", "elbow"),
}


@pytest.fixture(scope="module")
def coverings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Coverings that a test of this module made; the same model is not covered again."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def cache_folder(coverings: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(coverings))


def made(model: Path, template: Template = Template.TOUCH) -> PreparedRun:
    """A deployment for `model` in another folder, prepared for a run from what the file says."""
    out = model.parent / "new" / "robot.toml"
    out.parent.mkdir()
    onboard(model, out, template, ())
    return prepare_run(RunOptions(out))


def test_every_trait_has_its_joints() -> None:
    assert set(JOINTS) == set(TRAITS)


@pytest.mark.parametrize("trait", TRAITS)
def test_a_run_accepts_what_is_written(trait: str, tmp_path: Path) -> None:
    deployment = made(write_trait(tmp_path, trait)).deployment
    assert deployment.body.joints == JOINTS[trait]
    assert set(deployment.body.home_rad) == set(JOINTS[trait])
    assert deployment.body.model == f"../{trait}.xml"
    assert deployment.body.reference_body in {patch.body for patch in deployment.patches}
    assert deployment.teacher.touches
    assert deployment.controller.map.tilt_frequency_hz == 2.0  # or cells near an axis get wrong signs
    assert len(deployment.controller.program) == 2 + 2 * len(deployment.teacher.touches)


def test_a_free_base_is_held_and_a_driving_one_locked(tmp_path: Path) -> None:
    assert made(write_trait(tmp_path, "free_base_without_name")).deployment.body.fixed_base
    cart = made(write_trait(tmp_path / "cart", "wheels")).deployment
    assert not cart.body.fixed_base
    assert cart.body.locked == ("drive_x", "drive_yaw")
    assert {patch.body for patch in cart.patches} == {"cart", "arm"}  # neither the wheel nor the ball


def test_light_links_have_stiffer_servos_and_thinner_foam(tmp_path: Path) -> None:
    run = made(write_trait(tmp_path, "light_links"))
    body, usual = run.deployment.body, FoamSpec()
    ratio = run.deployment.cells.side_m / 0.014
    assert ratio < 1.0
    assert body.foam.thickness_m == pytest.approx(ratio * usual.thickness_m, rel=0.01)
    material_pa = usual.thickness_m * usual.stiffness_pa_per_m
    assert body.foam.thickness_m * body.foam.stiffness_pa_per_m == pytest.approx(material_pa, rel=0.02)
    assert all(spec.frequency_hz > 12.0 for spec in body.joint_servos.values())
    model = load_model(run.deployment, tmp_path / "new")
    deflection_rad = servo_response(model, is_compensated=True).sag_pushed_rad
    assert (deflection_rad[[joint in body.joint_servos for joint in body.joints]] < 0.02).all()
    assert body.joint_servos


def test_a_link_that_takes_only_larger_cells_is_left_out_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def why_no_cell(mj: Any, link: Any, body: str, cover: Any, side_m: float, *rest: Any) -> str:
        takes = side_m == SIDE_M if body == "trunk" else side_m < SIDE_M and body.endswith("_3")
        return "" if takes else f"no cell of side {1e3 * side_m:g} mm fits"

    monkeypatch.setattr(skin_choice, "why_no_cell", why_no_cell)
    deployment = made(write_two_arms(tmp_path), Template.NETWORK).deployment
    assert {patch.body for patch in deployment.patches} == {"left_3", "right_3"}
    assert f"no cell of side {1e3 * deployment.cells.side_m:g} mm fits" in (
        tmp_path / "new" / "robot.toml"
    ).read_text("utf-8")


def test_terrain_that_skin_does_not_feel_is_left_out_with_the_reason(tmp_path: Path) -> None:
    model = write_trait(tmp_path, "terrain")
    assert made(model).deployment.body.leave_out == ("geom1",)  # the other one is visual
    assert "does not feel height fields" in (tmp_path / "new" / "robot.toml").read_text()


def test_meshes_of_a_package_are_found_from_where_the_model_lies(tmp_path: Path) -> None:
    deployment = made(write_package(tmp_path)).deployment
    assert deployment.body.package_paths == ()
    assert {patch.body for patch in deployment.patches} == {"base_link", "upper_link"}


def test_packages_that_the_environment_names_are_written_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = write_package(tmp_path / "ros" / "src")
    (tmp_path / "models").mkdir()
    alone = model.rename(tmp_path / "models" / "arm.urdf")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros" / "src"))
    out = tmp_path / "robot.toml"
    onboard(alone, out, Template.NETWORK, ())
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    assert prepare_run(RunOptions(out)).deployment.body.package_paths == ("ros/src",)


def test_comments_are_the_reasons(tmp_path: Path) -> None:
    model, out = write_trait(tmp_path, "slide_joint"), tmp_path / "robot.toml"
    onboard(model, out, Template.TOUCH, ())
    text = out.read_text("utf-8")
    assert '"tilt",  # hinge of "arm", -1.000 to 1.000 rad' in text
    assert "lift = 0.0  # a slide turns no cell against gravity: not found by gravity" in text
    assert '#     "carriage": 1 kg' in text


@pytest.mark.parametrize("option", ['gravity="0 0 0"/>', '><flag gravity="disable"/></option>'])
def test_without_gravity_no_axis_is_turned_away_from_it(option: str, tmp_path: Path) -> None:
    model, out = write_trait(tmp_path, "gravity_aligned_wrist"), tmp_path / "robot.toml"
    text = model.read_text("utf-8")
    model.write_text(text.replace("<worldbody>", f"<option {option}<worldbody>"), "utf-8")
    made_of = onboard(model, out, Template.NETWORK, ()).plan
    assert set(made_of.home.faults.blind.values()) == {"the model has no gravity"}
    assert set(made_of.home.position.values()) == {0.0}


def test_equal_models_give_equal_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each covered anew."""
    model = write_trait(tmp_path, "gravity_aligned_wrist")
    files = [tmp_path / "robot.toml", tmp_path / "again" / "robot.toml"]
    files[1].parent.mkdir()
    for file in files:
        monkeypatch.setenv("XDG_CACHE_HOME", str(file.parent / "cache"))
        onboard(model, file, Template.TOUCH, ())
    one, other = (file.read_text("utf-8") for file in files)
    assert one == other.replace('"../gravity', '"gravity')


def test_a_network_alone_runs(tmp_path: Path) -> None:
    prepared = made(write_trait(tmp_path, "default_classes"), Template.NETWORK)
    summary = ran(prepared, tmp_path)
    assert summary["outcome"] == "completed"
    assert summary["metrics"]["formation.unreached_cells"] == 0
    assert summary["metrics"]["network.data_packets"] > 0


@pytest.mark.long
def test_a_touch_is_evaded_after_exploration(tmp_path: Path) -> None:
    summary = ran(made(write_trait(tmp_path, "no_keyframe")), tmp_path)
    assert summary["outcome"] == "completed"
    assert summary["metrics"]["structure.wrong_entries"] == 0
    assert summary["metrics"]["smm.sign_agreement"] >= 0.97
    assert summary["metrics"]["contact.peak_force_n"] < 20.0


def ran(prepared: PreparedRun, folder: Path) -> dict[str, Any]:
    options = RunOptions(prepared.options.deployment_file, in_process=True, plots=False)
    return run_once(prepare_run(options), folder / "run", ProgressDisplay(Console(quiet=True), quiet=True))


def test_nothing_is_replaced_unless_asked(tmp_path: Path) -> None:
    model, out = write_trait(tmp_path, "no_keyframe"), tmp_path / "robot.toml"
    out.write_text("mine", "utf-8")
    with pytest.raises(UsageError, match=r"robot\.toml: is there already; --force"):
        onboard(model, out, Template.NETWORK, ())
    assert out.read_text("utf-8") == "mine"
    onboard(model, out, Template.NETWORK, (), overwrite=True)
    assert load(out).name == "robot"
    with pytest.raises(UsageError, match="is the model itself"):
        onboard(model, model, Template.NETWORK, (), overwrite=True)


def test_places_that_do_not_do(tmp_path: Path) -> None:
    model = write_trait(tmp_path, "no_keyframe")
    with pytest.raises(UsageError, match=r"there is no folder .*; make it first"):
        onboard(model, tmp_path / "none" / "robot.toml", Template.TOUCH, ())
    with pytest.raises(UsageError, match="is a folder; name the file in it"):
        onboard(model, tmp_path, Template.TOUCH, ())
    with pytest.raises(ModelError, match="there is no such file"):
        onboard(tmp_path / "none.xml", tmp_path / "robot.toml", Template.TOUCH, ())


def test_one_arm_cannot_grasp(tmp_path: Path) -> None:
    model, out = write_trait(tmp_path, "no_keyframe"), tmp_path / "robot.toml"
    with pytest.raises(
        UsageError, match=r"--template grasp: .* has 0 arms with skin .* use touch or network"
    ):
        onboard(model, out, Template.GRASP, ())
    assert not out.exists()


@pytest.mark.parametrize("higher", ["left", "right"])
def test_arms_come_in_the_order_of_the_model(higher: str, tmp_path: Path) -> None:
    path = write_two_arms(tmp_path)
    text, y = path.read_text("utf-8"), {"left": "0.15", "right": "-0.15"}[higher]
    path.write_text(text.replace(f"0 {y} .06", f"0 {y} .5"), "utf-8")
    cells = (CellPoseSpec(position_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), x_axis=(1.0, 0.0, 0.0)),)
    skin = [PatchSpec(name=f"on_{side}", body=f"{side}_3", cells=cells) for side in ("right", "left")]
    assert find_arms(survey_robot(path, ()), skin) == (("on_left/0-0",), ("on_right/0-0",))


def test_two_arms_are_explored_and_stroked(tmp_path: Path) -> None:
    prepared = made(write_two_arms(tmp_path), Template.GRASP).deployment
    assert prepared.controller.program == ("structure", "teach_and_grasp")
    assert prepared.controller.map.tilt_frequency_hz == 2.0
    stroked = {cells.partition("/")[0] for cells in prepared.teacher.strokes[0].cells}
    assert {patch.body for patch in prepared.patches if patch.name in stroked} == {"left_3", "right_3"}
