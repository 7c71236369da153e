"""Thickness of links whose least width is known."""

import numpy as np
import pytest
from link_models import BOX, CAPSULE, CYLINDER, PLATE, SPHERE, TEE, ground_of, hull_of_points, model_of

from skinnet.covering.link_thickness import thickness_m

TURNED = '<geom type="box" size=".06 .04 .025" euler="31 17 63"/>'
ELLIPSOID = '<geom type="ellipsoid" size=".03 .06 .09" euler="31 17 63"/>'
TWO = '<geom type="sphere" size=".02"/><geom type="sphere" size=".03" pos="0 .1 0"/>'
HULL_ASSET, HULL = hull_of_points(400)


@pytest.mark.parametrize(
    ("geoms", "asset", "expected_m"),
    [
        (BOX, "", 0.1),
        (PLATE, "", 0.01),
        (SPHERE, "", 0.12),
        (CAPSULE, "", 0.1),
        (CYLINDER, "", 0.08),
        (TURNED, "", 0.05),
        (ELLIPSOID, "", 0.06),
        (TWO, "", 0.06),
        (TEE, "", 0.08),
        (HULL, HULL_ASSET, 0.1),
    ],
)
def test_thickness_is_the_least_width(geoms: str, asset: str, expected_m: float) -> None:
    ground = ground_of(model_of(geoms, asset)).ground
    assert thickness_m(ground.solids, ground.samples) == pytest.approx(expected_m, rel=0.02)


def test_flat_faces_are_exact() -> None:
    corners = np.array([(x, y, z) for x in (0, 0.2) for y in (0, 0.1) for z in (0, 0.05)])
    text = " ".join(f"{value:.3f}" for value in corners.ravel())
    asset = f'<asset><mesh name="m" vertex="{text}"/></asset>'
    for geoms, mesh in ((TURNED, ""), ('<geom type="mesh" mesh="m" euler="31 17 63"/>', asset)):
        ground = ground_of(model_of(geoms, mesh)).ground
        assert thickness_m(ground.solids, ground.samples) == pytest.approx(0.05, abs=1e-6)
