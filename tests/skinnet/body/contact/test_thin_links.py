"""Thin links: cells feel what presses their own face, and nothing of the other."""

from pathlib import Path

import body_scenes
import pytest

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
