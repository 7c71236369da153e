"""Command `skinnet init`: a deployment from a model, and one line for what is no model of a robot."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from onboarding_models import write_package, write_trait
from typer.testing import CliRunner

from skinnet.cli.main import app
from skinnet.errors import SkinnetError
from skinnet.onboarding.program import (
    Template,
)  # and with it the cache of compiled code, before that of a test

NO_JOINTS = '<mujoco><worldbody><body name="b"><geom size=".1"/></body></worldbody></mujoco>'
BALL_ONLY = (
    '<mujoco><worldbody><body name="b"><joint name="neck" type="ball"/><geom size=".1"/></body>'
    '<body name="c"><joint name="turn"/><geom size=".1"/></body></worldbody>'
    '<equality><joint joint1="turn"/></equality></mujoco>'
)
NO_MASS = (
    '<mujoco><worldbody><body name="b"><geom size=".1"/><body name="arm"><joint name="j"/></body></body>'
    "</worldbody></mujoco>"
)
NO_GEOMETRY = (
    '<mujoco><worldbody><body name="b"><joint name="j"/><geom size=".1" contype="0" conaffinity="0"/></body>'
    "</worldbody></mujoco>"
)
TOO_THIN = (
    '<mujoco><worldbody><body name="b"><joint name="j"/><geom size=".0005" mass="1"/></body>'
    "</worldbody></mujoco>"
)
NO_MESH = (
    '<mujoco><asset><mesh name="m" file="gone.stl"/></asset><worldbody><body name="b"><joint name="j"/>'
    '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
)
NO_UTF_8 = (
    '<mujoco><worldbody><body name="b"><joint name="Hüfte"/><geom size=".1"/></body></worldbody></mujoco>'
)
BAD = {
    "no joints": ("m.xml", NO_JOINTS, ["has no joints", "at least one hinge or slide joint"]),
    "no joint to control": (
        "m.xml",
        BALL_ONLY,
        ["no hinge or slide joint that a controller could move", "neck"],
    ),
    "no mass": ("m.xml", NO_MASS, ["arm", "has no mass", "<inertial>"]),
    "no geometry": ("m.xml", NO_GEOMETRY, ["no body of the robot has a geom that can be felt", "contype"]),
    "too thin": ("m.xml", TOO_THIN, ["no link takes a cell"]),
    "no mesh": ("m.xml", NO_MESH, ["gone.stl", "looked in"]),
    "no XML": ("m.xml", "robot, please", ["XML"]),
    "another XML": ("m.xml", "<html/>", ["html"]),
    "no UTF-8": ("m.xml", NO_UTF_8, ["not UTF-8", "save the file"]),
    "no model": ("m.toml", "x = 1", ["no model that MuJoCo reads", "MJCF (.xml) or URDF (.urdf)"]),
}


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def refused(*arguments: str) -> str:
    """Text of the error with which `init` ends."""
    done = CliRunner().invoke(app, ["init", *arguments])
    assert isinstance(done.exception, SkinnetError), done.output
    return str(done.exception)


@pytest.mark.parametrize(("name", "text", "said"), BAD.values(), ids=BAD)
def test_bad_models_are_one_line(name: str, text: str, said: list[str], tmp_path: Path) -> None:
    model = tmp_path / name
    model.write_text(text, "latin-1")
    line = refused(str(model), "--out", str(tmp_path / "robot.toml"))
    assert "\n" not in line
    assert line.startswith(str(model))
    assert all(part in line for part in said), line
    assert not (tmp_path / "robot.toml").exists()


def test_what_is_written_is_said(tmp_path: Path) -> None:
    model, out = write_trait(tmp_path, "slide_joint"), tmp_path / "robot.toml"
    done = CliRunner().invoke(app, ["init", str(model), "--out", str(out), "--template", Template.NETWORK])
    assert done.exit_code == 0, done.output
    assert f"{out}: 2 joints, " in done.output
    assert "joint lift: a slide turns no cell against gravity" in done.output
    assert "no skin on carriage: other links reach all of the surface" in done.output
    assert f"skinnet run {out}" in done.output


def test_names_of_a_model_do_not_break_a_line(tmp_path: Path) -> None:
    text = write_trait(tmp_path, "slide_joint").read_text("utf-8").replace('"lift"', '"li&quot;&#10;ft"')
    model, out = tmp_path / "odd.xml", tmp_path / "odd.toml"
    model.write_text(text, "utf-8")
    done = CliRunner().invoke(app, ["init", str(model), "--out", str(out), "--template", Template.NETWORK])
    assert done.exit_code == 0, done.output
    assert 'joint li"?ft: a slide turns no cell against gravity' in done.output
    assert '"li\\"\\nft"' in out.read_text("utf-8")


def test_a_file_that_may_not_be_written_is_refused_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "robot.toml"
    out.write_text("mine")
    access = os.access  # modes do not bind every user, so that one of the file would not do

    def no_writing(path: Path, mode: int) -> bool:
        return access(path, mode) and (Path(path), mode) != (out, os.W_OK)

    monkeypatch.setattr(os, "access", no_writing)
    line = refused(str(tmp_path / "none.xml"), "--out", str(out), "--force")
    assert line == f"--out {out}: {out} may not be written; change its mode, or name another file"
    assert out.read_text() == "mine"


def test_a_package_path_reaches_the_meshes(tmp_path: Path) -> None:
    model = write_package(tmp_path / "src").rename(tmp_path / "arm.urdf")
    out = tmp_path / "robot.toml"
    assert "package://my_arm" in refused(str(model), "--out", str(out))
    arguments = ["init", str(model), "--out", str(out), "--package-path", str(tmp_path / "src")]
    done = CliRunner().invoke(app, [*arguments, "--template", Template.NETWORK])
    assert done.exit_code == 0, done.output
    assert 'package_paths = ["src"]' in out.read_text("utf-8")


def test_the_exit_code_of_bad_input(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "skinnet.cli", "init", str(tmp_path / "none.xml"), "--out", "robot.toml"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=120, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "none.xml: there is no such file" in done.stderr
