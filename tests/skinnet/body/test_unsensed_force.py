"""Load that the rigid shell takes under skin: with what the cells read, it is the weight."""

from pathlib import Path

import body_scenes
import pytest

SCENE = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.01"/></body>
    <body name="box" pos="{x} 0 {height}">
      <freejoint/><geom type="box" size="0.03 0.03 0.03" mass="10"/>
    </body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("x_m", "height_m", "is_on_skin"), [(0.0, 1.042, True), (0.16, 1.03, False)])
def test_what_cells_do_not_read_passes_the_shell(
    tmp_path: Path, x_m: float, height_m: float, is_on_skin: bool
) -> None:
    """10 kg on 6 x 6 cm press foam of 1.5 MPa/m flat; beside the skin nothing counts as unsensed."""
    patches = (body_scenes.lattice_patch("skin", "base", 8, 8),)
    mjcf = SCENE.format(x=x_m, height=height_m)
    body = body_scenes.body_of(tmp_path, mjcf, patches, ("turn",))
    body.advance(1_000_000_000)
    read_n = body.stimulus()[:, :3].sum()
    facts = body.ground_truth().facts["unsensed_force"]
    if is_on_skin:
        assert 30.0 < body.unsensed_force.now_n < 45.0
        assert read_n + body.unsensed_force.now_n == pytest.approx(98.1, rel=0.01)
        assert facts["peak_n"] >= facts["mean_n"] > 20.0
    else:
        assert read_n == 0.0
        assert facts == {"mean_n": 0.0, "peak_n": 0.0}
