"""Small scenes for the tests of the body: MJCF text, patches by hand, and a deployment around them."""

from pathlib import Path

from locations import DEPLOYMENTS

from skinnet.body.simulation import BodySimulation
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.deployment.controller.stages import StageSpec
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.teacher import TeacherSpec, TouchSpec
from skinnet.deployment.load import load
from skinnet.deployment.robot import BodySpec
from skinnet.deployment.skin.cells import CellSpec
from skinnet.deployment.skin.patches import CellPoseSpec, InterfaceSpec, LatticeSpec, PatchSpec

HRP2 = DEPLOYMENTS / "hrp2_touch.toml"

CONTROLLER = ControllerSpec(program=("guide",), stages={"guide": StageSpec(kind="guide")})

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <joint name="turn" axis="0 0 1"/>
      <geom type="box" size="0.05 0.05 0.05" mass="5"/>
      <body name="arm" pos="0 0 0.05">
        <joint name="lift" axis="0 1 0" range="-1 1" limited="true" armature="0.1"/>
        <geom name="arm" type="box" size="0.2 0.03 0.01" pos="0.25 0 0" mass="2"/>
      </body>
    </body>
    {more}
  </worldbody>
  {sensors}
</mujoco>
"""
"""An arm that turns and lifts, with a flat top at z = 0.01 of its frame."""

ARM_CELLS = (
    CellPoseSpec(position_m=(0.30, 0.0, 0.01), normal=(0, 0, 1), x_axis=(0, 1, 0)),
    CellPoseSpec(position_m=(0.40, 0.0, 0.01), normal=(0, 0, 1), x_axis=(1, 0.3, 0)),
    CellPoseSpec(position_m=(0.35, 0.03, 0.0), normal=(0, 1, 0), x_axis=(0.2, 0, 1)),
)


def patch(name: str, body: str, *cells: CellPoseSpec) -> PatchSpec:
    return PatchSpec(name=name, body=body, cells=cells, interfaces=(InterfaceSpec(cell=0, port=0),))


def lattice_patch(name: str, body: str, columns: int, rows: int, origin_m=(0.0, 0.0, 0.0)) -> PatchSpec:
    lattice = LatticeSpec(columns=columns, rows=rows, origin_m=origin_m, normal=(0, 0, 1), up=(0, 1, 0))
    return PatchSpec(name=name, body=body, lattice=lattice, interfaces=(InterfaceSpec(cell=0, port=2),))


def body_of(
    folder: Path,
    mjcf: str,
    patches: tuple[PatchSpec, ...],
    joints: tuple[str, ...],
    touches: tuple[TouchSpec, ...] = (),
    cells: CellSpec | None = None,
    teacher: TeacherSpec | None = None,
    **body: object,
) -> BodySimulation:
    """Body of `mjcf`, which is written into `folder`; `touches`, or all that a teacher does."""
    (folder / "scene.xml").write_text(mjcf)
    return BodySimulation(
        deployment_of(patches, joints, touches, cells or CellSpec(), teacher, **body), folder
    )


def deployment_of(
    patches: tuple[PatchSpec, ...],
    joints: tuple[str, ...],
    touches: tuple[TouchSpec, ...] = (),
    cells: CellSpec | None = None,
    teacher: TeacherSpec | None = None,
    **body: object,
) -> Deployment:
    keys: dict = {"model": "scene.xml", "reference_body": "base", **body}
    return Deployment(
        name="scene",
        robot="scene",
        body=BodySpec(joints=joints, **keys),
        cells=cells or CellSpec(),
        patches=patches,
        teacher=teacher or TeacherSpec(touches=touches),
        controller=CONTROLLER,
    )


def arm(folder: Path, more: str = "", touches: tuple[TouchSpec, ...] = (), **body: object) -> BodySimulation:
    """The arm with three cells: two on its flat top, one on its side."""
    mjcf = ARM.format(more=more, sensors="")
    return body_of(folder, mjcf, (patch("skin", "arm", *ARM_CELLS),), ("turn", "lift"), touches, **body)


def hrp2(*overrides: str) -> BodySimulation:
    """The body of the HRP-2 touch deployment."""
    return BodySimulation(load(HRP2, overrides), DEPLOYMENTS)
