"""A body that settles at home: forces against statics, drift, energy, and what no cell feels."""

import json
from pathlib import Path
from typing import Any

import pytest
from body_scenes import deployment_of, lattice_patch
from launching import skinnet
from locations import DEPLOYMENTS

from skinnet.body.settling import settle
from skinnet.body.simulation import BodySimulation

MS = 1_000_000
MODEL = """
<mujoco>
  <option gravity="{gravity}">{flag}</option>
  <worldbody>
    <body name="base" pos="0 0 0.5">
      <geom name="plate" type="box" size="0.15 0.15 0.02"/>
      <body name="arm" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0.2 0 0"/>
      </body>
    </body>
    <body name="box" pos="0 0 {height_m}">
      <freejoint/>
      <geom type="box" size="0.04 0.04 0.04" mass="{mass_kg}"/>
    </body>
  </worldbody>
</mujoco>
"""


def settled(
    folder: Path, mass_kg: float, height_m: float = 0.575, *, gravity: str = "0 0 -9.81", flag: str = ""
) -> dict[str, Any]:
    """Metrics of a box that settles on a plate with 10 × 10 cells for 1 s."""
    text = MODEL.format(mass_kg=mass_kg, height_m=height_m, gravity=gravity, flag=flag)
    (folder / "scene.xml").write_text(text)
    skin = lattice_patch("top", "base", 10, 10, origin_m=(0.0, 0.0, 0.02))
    deployment = deployment_of((skin,), ("elbow",))
    return settle(BodySimulation(deployment, folder), deployment, 1000 * MS).metrics


def test_the_cells_carry_what_lies_on_them(tmp_path: Path) -> None:
    metrics = settled(tmp_path, 1.0)
    assert metrics["settle.force_n.top"] == pytest.approx(9.81, rel=1e-3)
    assert metrics["settle.unsensed_n"] == 0.0
    assert metrics["settle.rise_mm.box"] == pytest.approx(0.0, abs=0.1)
    assert abs(metrics["settle.drift_rad.elbow"]) < 0.01
    assert metrics["settle.energy_ratio"] <= 1.01
    assert metrics["settle.left_out"] == []


def test_what_no_cell_feels_is_said(tmp_path: Path) -> None:
    metrics = settled(tmp_path, 60.0)
    both = metrics["settle.force_n.top"] + metrics["settle.unsensed_n"]
    assert metrics["settle.unsensed_n"] > 10.0, "the foam is pressed flat"
    assert both == pytest.approx(60.0 * 9.81, rel=0.01)


def test_a_box_that_falls_does_not_rise_above_its_start(tmp_path: Path) -> None:
    metrics = settled(tmp_path, 0.5, height_m=0.7)
    assert metrics["settle.rise_mm.box"] == 0.0
    assert metrics["settle.energy_ratio"] <= 1.01


def test_foam_that_is_compressed_at_the_start_has_its_energy_then(tmp_path: Path) -> None:
    """A light box that starts 7 mm deep in the foam is thrown up by what the foam had stored."""
    metrics = settled(tmp_path, 0.05, height_m=0.565)
    assert metrics["settle.rise_mm.box"] > 10.0
    assert 0.99 < metrics["settle.energy_ratio"] <= 1.01


def test_gravity_that_is_switched_off_is_no_gravity(tmp_path: Path) -> None:
    none = settled(tmp_path, 0.05, height_m=0.565, gravity="0 0 0")
    assert 0.99 < none["settle.energy_ratio"] <= 1.01
    assert settled(tmp_path, 0.05, height_m=0.565, flag='<flag gravity="disable"/>') == none


def test_the_command_prints_and_writes_it() -> None:
    file = DEPLOYMENTS / "two_link_arm.toml"
    line = ("check", str(file), "--settle", "0.05")
    done = skinnet(*line, "--json", "-")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["settle_s"] == 0.05
    assert {"settle.unsensed_n", "settle.energy_ratio", "settle.left_out"} <= report["metrics"].keys()
    done = skinnet(*line)
    assert done.returncode == 0, done.stderr
    assert "settle.force_n." in done.stdout
    for wrong, why in (
        (["--settle", "0"], "--settle 0: must be above 0"),
        (["--settle", "inf"], "--settle inf: must be above 0"),
        (["--settle", "1", "--resolved"], "--resolved prints TOML"),
    ):
        done = skinnet(*line[:2], *wrong)
        assert done.returncode == 2
        assert why in done.stderr
