"""Thin links: cells feel what presses their own face, and nothing of the other."""

from pathlib import Path

import body_scenes
import numpy as np
import pytest

from skinnet.body.contact.link_thickness import start_depths_m
from skinnet.deployment.skin.patches import CellPoseSpec

MASS_KG = 10.0
PLATE = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 {half}" pos="0 0 -{half}"/></body>
    <body name="box" pos="0 0 1.042">
      <freejoint/><geom type="{shape}" size="0.1 0.1 0.03" mass="10"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("thickness_m", [0.001, 0.002, 0.004, 0.02])
def test_cells_below_a_plate_do_not_feel_what_lies_on_it(tmp_path: Path, thickness_m: float) -> None:
    below = [
        CellPoseSpec(position_m=(x, y, -thickness_m), normal=(0, 0, -1), x_axis=(1, 0, 0))
        for x in (-0.05, 0.0, 0.05)
        for y in (-0.05, 0.0, 0.05)
    ]
    patches = (
        body_scenes.lattice_patch("above", "base", 12, 14),
        body_scenes.patch("below", "base", *below),
    )
    mjcf = PLATE.format(half=0.5 * thickness_m, shape="box")
    body = body_scenes.body_of(tmp_path, mjcf, patches, ("turn",))
    body.advance(1_000_000_000)
    force_n = body.stimulus()[:, :3]
    assert force_n[body.cells["above"]].sum() == pytest.approx(MASS_KG * 9.81, rel=1e-3)
    assert not force_n[body.cells["below"]].any()
    sunk_m = 1.042 - body.data.qpos[2]
    assert sunk_m == pytest.approx(MASS_KG * 9.81 / (1.5e6 * 0.2**2), rel=0.05)


@pytest.mark.parametrize(
    ("deepest_m", "expected_m"),
    [
        (0.004, [0.004, 0.004, 0.004]),
        (0.03, [0.015, 0.03, 0.03]),
        (0.1, [0.015, 0.055, 0.1]),
    ],
)
def test_rays_start_before_the_far_face_of_a_link(
    tmp_path: Path, deepest_m: float, expected_m: list[float]
) -> None:
    """The arm is 20 mm thick under its top and 60 mm across; nothing is under a cell beside it."""
    cells = (
        body_scenes.ARM_CELLS[0],
        body_scenes.ARM_CELLS[2],
        CellPoseSpec(position_m=(0.3, 0.2, 0.01), normal=(0, 0, 1), x_axis=(1, 0, 0)),
    )
    mjcf = body_scenes.ARM.format(more="", sensors="")
    body = body_scenes.body_of(tmp_path, mjcf, (body_scenes.patch("skin", "arm", *cells),), ("turn", "lift"))
    found = body.cell_foundation
    depths_m = start_depths_m(found.surface, found.scene, found.motion, deepest_m)
    assert depths_m == pytest.approx(np.array(expected_m), abs=1e-9)


@pytest.mark.parametrize("half_m", [0.001, 0.003])
def test_rays_start_in_the_middle_of_a_thin_link(tmp_path: Path, half_m: float) -> None:
    mjcf = PLATE.format(half=half_m, shape="box")
    skin = (body_scenes.lattice_patch("above", "base", 2, 2),)
    found = body_scenes.body_of(tmp_path, mjcf, skin, ("turn",)).cell_foundation
    depths_m = start_depths_m(found.surface, found.scene, found.motion, 0.004)
    assert depths_m == pytest.approx(np.full(4, half_m), abs=1e-9)
