"""Every finding: a small model that shows it, and the same model mended, which does not."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest
from locations import ROOT

from skinnet.body.step_cost import StepCost
from skinnet.deployment import Deployment
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.deployment.robot import BodySpec, FoamCurveSpec, FoamSpec
from skinnet.deployment.servo import ServoSpec
from skinnet.deployment.skin.patches import CellPoseSpec, InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.diagnosis.at_rest import speed_finding
from skinnet.diagnosis.diagnose import diagnose
from skinnet.diagnosis.finding import (
    SEVERITIES,
    Code,
    Finding,
    as_documents,
    has_errors,
    in_order,
    listed,
)

MS = 1_000_000

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="{gravity}"/>
  {head}
  <worldbody>
    <body name="base" pos="0 0 1" quat="{quat}">
      {base_joint}
      <geom name="base" type="box" size=".06 .06 .06" mass="5" {base_geom}/>
      {on_base}
      <body name="arm" pos="0 0 .09">
        <joint name="lift" axis="{axis}" range="{range}" limited="true" {lift}/>
        <geom name="arm" type="box" size=".2 .04 .02" pos="0.2 0 0" mass="{mass}"/>
        {on_arm}
      </body>
    </body>
    {more}
  </worldbody>
</mujoco>
"""
SOUND: dict[str, str] = {
    "gravity": "0 0 -9.81",
    "head": "",
    "quat": "1 0 0 0",
    "base_joint": "",
    "base_geom": "",
    "on_base": "",
    "axis": "0 1 0",
    "range": "-1 1",
    "lift": "",
    "mass": "2",
    "on_arm": "",
    "more": "",
}
"""A box on which an arm lifts, fixed to the world: nothing to be found but its speed."""
FLAT = LatticeSpec(columns=3, rows=2, origin_m=(0.1, -0.02, 0.02), normal=(0, 0, 1), up=(0, 1, 0))
GATEWAY = (InterfaceSpec(cell=0, port=2),)
ROOF = "0 0 0  0.2 0 0  0.2 0.2 0  0 0.2 0  0.1 0.1 0.1"
CLOSED = "0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"
WEDGE = "0 0 0  .1 0 0  .1 .1 0  .05 .03 0  0 0 .1  .1 0 .1  .1 .1 .1  .05 .03 .1"
"""A prism whose hull is 20 mm from it at most: its cross section has a re-entrant corner."""
WEDGE_FACES = "0 3 1 1 3 2 4 5 7 5 6 7 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6 3 0 4 3 4 7"


def mesh(vertices: str, faces: str) -> str:
    return f'<asset><mesh name="m" inertia="shell" vertex="{vertices}" face="{faces}"/></asset>'


def felt_mesh(vertices: str, faces: str) -> dict[str, str]:
    """The arm with a mesh beside it, on the same body."""
    return {"head": mesh(vertices, faces), "on_arm": '<geom type="mesh" mesh="m" pos="0 0 -.3" mass=".1"/>'}


def drawn_up_to(z_m: float) -> dict[str, str]:
    """The arm as it is seen: a visual mesh under its felt box, as high as `z_m`, frame of the body."""
    corners = " ".join(f"{x} {y} {z}" for z in (-0.02, z_m) for x in (-0.2, 0.2) for y in (-0.04, 0.04))
    shape = f'<asset><mesh name="m" vertex="{corners}"/></asset>'
    seen = '<geom type="mesh" mesh="m" pos=".2 0 0" mass="0" contype="0" conaffinity="0"/>'
    return {"head": shape, "on_arm": seen}


def cell(x_m: float, y_m: float, z_m: float) -> CellPoseSpec:
    return CellPoseSpec(position_m=(x_m, y_m, z_m), normal=(0, 0, 1), x_axis=(0, 1, 0))


def pair(first: CellPoseSpec, second: CellPoseSpec) -> PatchSpec:
    ends = (InterfaceSpec(cell=0, port=2), InterfaceSpec(cell=1, port=3))
    return PatchSpec(name="skin", body="arm", cells=(first, second), interfaces=ends)


def at(origin_m: tuple[float, float, float]) -> dict[str, Any]:
    return {"lattice": msgspec.structs.replace(FLAT, origin_m=origin_m)}


@dataclass(frozen=True)
class Case:
    """What differs from the sound model: in its text, its patch, its body, and the program."""

    model: dict[str, str] = field(default_factory=dict)
    patch: PatchSpec | dict[str, Any] = field(default_factory=dict)
    body: dict[str, Any] = field(default_factory=dict)
    stages: tuple[str, ...] = ("guide",)
    settle_ms: int = 0
    joints: tuple[str, ...] = ("lift",)


BASE_TURNS = {"base_joint": '<joint name="turn" axis="0 0 1" range="-1 1" limited="true"/>'}
WALL = '<body name="wall" pos="0 0 1"><geom name="wall" type="box" size=".1 .1 .01" pos=".1 0 {z}"/></body>'
BOX_ABOVE = '<geom name="lid" type="box" size=".05 .05 .01" pos=".2 0 {z}" mass="1"/>'
FAR = '<body name="far" pos="{x} 0 0"><joint name="far" axis="1 0 0"/><geom type="sphere" size=".05"/></body>'
CURVE = FoamCurveSpec(strain=(0.0, 0.5, 1.0), loading_kpa=(0.0, 4.0, 20.0))
STRUCTURE = ("structure",)


def undamped(torque_limit_nm: float, mass: str) -> Case:
    """A servo without damping, pressed a little; explicit stiffness is stable for kp h² / M < 4."""
    servo = ServoSpec(kv_nm_s_per_rad=0.0, torque_limit_nm=torque_limit_nm)
    model = {"mass": mass, "more": WALL.format(z=".125")}
    return Case(model, body={"servo": servo}, settle_ms=100)


def at_limit(*, compensated: bool) -> Case:
    """Home at the limit, beyond which a servo without compensation would have its target."""
    servo = ServoSpec(gravity_compensation=compensated)
    return Case({"mass": "10"}, body={"servo": servo, "home_rad": {"lift": -1.0}})


CASES: dict[str, tuple[Case, Case]] = {
    "gravity_zero": (Case({"gravity": "0 0 0"}), Case()),
    "gravity_tilted": (Case({"gravity": "0 5 -9.81"}), Case({"gravity": "0 0 -9.78"})),
    "free_base": (Case({"base_joint": "<freejoint/>"}), Case()),
    "axis_along_gravity": (
        Case(BASE_TURNS, joints=("turn", "lift"), stages=STRUCTURE),
        Case(BASE_TURNS | {"quat": "1 .06 0 0"}, joints=("turn", "lift"), stages=STRUCTURE),
    ),
    "limit_near_home": (
        Case({"range": "-.05 1"}, stages=STRUCTURE),
        Case({"range": "-.11 1"}, stages=STRUCTURE),
    ),
    "cells_off_surface": (Case(patch=at((0.1, -0.02, 0.03))), Case(patch=at((0.1, -0.02, 0.025)))),
    "cells_off_drawn": (Case(drawn_up_to(0.007)), Case(drawn_up_to(0.009))),
    "cells_buried": (Case(patch=at((0.1, -0.02, 0.015))), Case(patch=at((0.1, -0.02, 0.0195)))),
    "cells_intruded": (
        Case({"on_arm": BOX_ABOVE.format(z=".031"), "more": ""}, patch=at((0.13, -0.02, 0.02))),
        Case({"on_arm": BOX_ABOVE.format(z=".06")}, patch=at((0.13, -0.02, 0.02))),
    ),
    "cells_overlap": (
        Case(patch=pair(cell(0.1, 0, 0.02), cell(0.1225, 0, 0.02))),
        Case(patch=pair(cell(0.1, 0, 0.02), cell(0.13, 0, 0.02))),
    ),
    "cells_unreached": (
        Case(
            patch=PatchSpec(
                name="skin",
                body="arm",
                cells=(cell(0.1, 0, 0.02), cell(0.2, 0, 0.02)),
                interfaces=(InterfaceSpec(cell=0, port=2),),
            )
        ),
        Case(patch=pair(cell(0.1, 0, 0.02), cell(0.2, 0, 0.02))),
    ),
    "contacts_disabled": (Case({"head": '<option><flag contact="disable"/></option>'}), Case()),
    "skin_without_contact": (
        Case({"base_geom": 'contype="0" conaffinity="0"'}, patch={"body": "base"} | at((-0.02, -0.02, 0.06))),
        Case(patch={"body": "base"} | at((-0.02, -0.02, 0.06))),
    ),
    "margins_cleared": (Case({"more": WALL.format(z=".5").replace("<geom", '<geom margin=".01"')}), Case()),
    "foam_curve": (Case(body={"foam": FoamSpec(curve=CURVE)}), Case()),
    "hull_gap": (Case(felt_mesh(WEDGE, WEDGE_FACES)), Case(felt_mesh(ROOF, CLOSED))),
    "mesh_open": (Case(felt_mesh(ROOF, CLOSED.removesuffix(" 3 0 4"))), Case(felt_mesh(ROOF, CLOSED))),
    "mesh_inward": (
        Case(felt_mesh(ROOF, " ".join(reversed(CLOSED.split())))),
        Case(felt_mesh(ROOF, CLOSED)),
    ),
    "links_collide": (Case({"on_arm": FAR.format(x="0")}), Case({"on_arm": FAR.format(x=".6")})),
    "cells_pressed": (Case({"more": WALL.format(z=".125")}), Case({"more": WALL.format(z=".14")})),
    "base_drift": (Case({"base_joint": "<freejoint/>"}, settle_ms=60), Case(settle_ms=60)),
    "joint_drift": (
        Case({"mass": "40"}, body={"servo": ServoSpec(torque_limit_nm=10.0)}, settle_ms=100),
        Case({"mass": "40"}, settle_ms=100),
    ),
    "passive_joint_drift": (
        Case(BASE_TURNS | {"quat": "1 1 0 0"}, settle_ms=150),
        Case(BASE_TURNS | {"quat": "1 1 0 0"}, settle_ms=150, body={"locked": ("turn",)}),
    ),
    "energy_grows": (undamped(400.0, ".005"), undamped(400.0, ".05")),
    "servo_oscillates": (undamped(400.0, ".005"), undamped(400.0, ".05")),
    "unstable": (undamped(1e300, ".005"), undamped(1e300, ".05")),
    "servo_slow": (
        Case(body={"servo": ServoSpec(frequency_hz=7.9)}),
        Case(body={"servo": ServoSpec(frequency_hz=8.1)}),
    ),
    "servo_overloaded": (
        Case({"mass": "40"}, body={"servo": ServoSpec(torque_limit_nm=75.0)}),
        Case({"mass": "40"}, body={"servo": ServoSpec(torque_limit_nm=80.0)}),
    ),
    "servo_sags": (at_limit(compensated=False), at_limit(compensated=True)),
    "servo_yields": (
        Case(body={"servo": ServoSpec(frequency_hz=5.0)}),
        Case(body={"servo": ServoSpec(frequency_hz=12.0)}),
    ),
    "speed": (Case(settle_ms=20), Case()),
}
"""By code: a case that shows the finding, and one that does not."""


def findings(folder: Path, case: Case) -> tuple[Finding, ...]:
    (folder / "scene.xml").write_text(MODEL.format(**(SOUND | case.model)))
    patch = PatchSpec(name="skin", body="arm", lattice=FLAT, interfaces=GATEWAY)
    patch = case.patch if isinstance(case.patch, PatchSpec) else msgspec.structs.replace(patch, **case.patch)
    deployment = Deployment(
        name="scene",
        robot="scene",
        body=BodySpec(model="scene.xml", reference_body="base", joints=case.joints, **case.body),
        patches=(patch,),
        controller=ControllerSpec(
            program=case.stages, stages={name: StageSpec(kind=name) for name in case.stages}
        ),
    )
    return diagnose(deployment, folder, case.settle_ms * MS).findings


@pytest.mark.parametrize("code", CASES)
def test_a_finding_is_there_with_its_fault_and_only_then(tmp_path: Path, code: str) -> None:
    faulty, sound = CASES[code]
    found = [finding for finding in findings(tmp_path, faulty) if finding.code == code]
    assert found, findings(tmp_path, faulty)
    for finding in found:
        assert finding.severity in SEVERITIES
        assert finding.subject
        assert finding.mend
        assert "\n" not in finding.text + finding.mend
    assert code not in {finding.code for finding in findings(tmp_path, sound)}


@pytest.mark.parametrize(
    ("stages", "severity"),
    [(("structure",), "warning"), (("map", "structure"), "warning"), (("structure", "map"), "remark")],
)
def test_a_map_after_the_structure_tells_what_gravity_does_not(
    tmp_path: Path, stages: tuple[str, ...], severity: str
) -> None:
    case = Case(BASE_TURNS, joints=("turn", "lift"), stages=stages)
    found = [each for each in findings(tmp_path, case) if each.code == "axis_along_gravity"]
    assert [(each.subject, each.severity) for each in found] == [("turn", severity)]


@pytest.mark.parametrize("active", [True, False])
def test_only_an_active_equality_holds_a_joint_without_a_servo(tmp_path: Path, active: bool) -> None:
    equality = f'<equality><joint joint1="turn" active="{str(active).lower()}"/></equality>'
    case = Case(BASE_TURNS | {"quat": "1 1 0 0", "head": equality}, settle_ms=150)
    codes = {finding.code for finding in findings(tmp_path, case)}
    assert ("passive_joint_drift" in codes) is not active


def test_every_code_has_its_models_and_its_row_in_the_docs() -> None:
    codes = set(get_args(Code))
    assert set(CASES) == codes
    rows = [
        line for line in (ROOT / "docs/check.md").read_text(encoding="utf-8").splitlines() if "| `" in line
    ]
    assert set(re.findall(r"`([a-z_]+)`", " ".join(row.split("|")[1] for row in rows))) == codes


def test_the_sound_model_has_nothing_but_its_speed(tmp_path: Path) -> None:
    program = ("structure", "map")
    assert findings(tmp_path, Case(stages=program)) == ()
    assert [finding.code for finding in findings(tmp_path, Case(stages=program, settle_ms=50))] == ["speed"]


def test_findings_are_ordered_listed_and_written() -> None:
    remark = Finding("remark", "speed", "a", "text", "mend")
    error = Finding("error", "gravity_zero", "b", "text", "mend", ("skin/1",))
    warning = Finding("warning", "hull_gap", "c", "text", "mend")
    assert in_order([remark, error, warning]) == (error, warning, remark)
    assert has_errors([remark, error])
    assert not has_errors([remark, warning])
    (document,) = as_documents([error])
    assert document == {
        "severity": "error",
        "code": "gravity_zero",
        "subject": "b",
        "text": "text",
        "mend": "mend",
        "cells": ["skin/1"],
    }
    assert listed(list("abcde")) == "a, b, c, d, e"
    assert listed(list("abcdef")) == "a, b, c, d and 2 more"


def test_the_speed_names_what_costs_most() -> None:
    finding = speed_finding(StepCost(0.1, 1.5, 0.2, 0.2))
    assert "0.5 × real time" in finding.text
    assert "contact of the skin 75 %" in finding.text
    assert "fewer cells, or fewer geoms near them" in finding.mend
