"""Meshes of ROS packages: where they are looked for, in which order, and what is said if one is missing."""

from pathlib import Path

import mujoco
import pytest
from onboarding_models import write_package

from skinnet.body.model_file import compile_spec, parse_model, read_model
from skinnet.body.package_files import package_folders
from skinnet.deployment.load import read_document
from skinnet.errors import ModelError


def mesh_files(spec: mujoco.MjSpec) -> set[str]:
    return {mesh.file for mesh in spec.meshes}


def test_above_the_model(tmp_path: Path) -> None:
    model = write_package(tmp_path)
    spec = read_model(model)
    assert mesh_files(spec) == {str(tmp_path / "my_arm" / "meshes" / "block.stl")}
    assert compile_spec(spec, model).nmesh == 1
    assert package_folders(parse_model(model), model, []) == []


def test_a_path_comes_before_the_model_and_the_environment_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = write_package(tmp_path / "own")
    write_package(tmp_path / "other")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "other"))
    assert mesh_files(read_model(model)) == {str(tmp_path / "own" / "my_arm" / "meshes" / "block.stl")}
    other = {str(tmp_path / "other" / "my_arm" / "meshes" / "block.stl")}
    assert mesh_files(read_model(model, [tmp_path / "other"])) == other
    assert package_folders(parse_model(model), model, [tmp_path / "other"]) == [tmp_path / "other"]


def test_a_package_is_known_by_its_manifest(tmp_path: Path) -> None:
    model = write_package(tmp_path)
    (tmp_path / "my_arm").rename(tmp_path / "checked_out_elsewhere")
    model = tmp_path / "checked_out_elsewhere" / "urdf" / "arm.urdf"
    assert mesh_files(read_model(model)) == {str(tmp_path / "checked_out_elsewhere" / "meshes" / "block.stl")}


def test_the_bodies_of_a_urdf_are_not_fused(tmp_path: Path) -> None:
    model = write_package(tmp_path)
    mj = compile_spec(read_model(model), model)
    assert [mj.body(body).name for body in range(1, mj.nbody)] == ["base_link", "upper_link"]


def test_a_missing_mesh_says_where_it_was_looked_for(tmp_path: Path) -> None:
    model = write_package(tmp_path, mesh="block.obj")
    with pytest.raises(ModelError) as error:
        read_model(model, [tmp_path / "more"])
    assert "mesh package://my_arm/meshes/block.stl: not found" in str(error.value)
    for place in (tmp_path / "more", tmp_path / "my_arm", tmp_path):
        assert str(place) in str(error.value)
    assert "--package-path" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_kind_of_mesh_that_mujoco_does_not_read(tmp_path: Path) -> None:
    model = write_package(tmp_path)
    model.write_text(model.read_text("utf-8").replace("block.stl", "block.ply"), "utf-8")
    with pytest.raises(ModelError, match=r"block\.ply: MuJoCo reads \.stl, \.obj, \.msh"):
        read_model(model)


def test_a_base_deployment_in_another_folder(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "arm.toml").write_text('[body]\npackage_paths = ["ros", "../src"]\n', "utf-8")
    (tmp_path / "touch.toml").write_text('extends = "robots/arm.toml"\n', "utf-8")
    assert read_document(tmp_path / "touch.toml")["body"]["package_paths"] == ["robots/ros", "src"]
