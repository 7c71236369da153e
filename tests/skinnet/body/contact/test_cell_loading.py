"""Loading of cells: forces of tips and edges against the closed forms of a Winkler foundation.

The cells of a lattice tile the plane, and a cell's samples tile the cell: so the sum of all cells is the
integral over the plane, wherever a solid presses.
"""

import math
from pathlib import Path

import body_scenes
import mujoco
import numpy as np
import pytest

from skinnet.body.simulation import BodySimulation

K_PA_PER_M, FACE_M, PITCH_M = 1.5e6, 1.012, 0.014 * math.sqrt(3.0)
SCENE = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><geom type="box" size="0.3 0.3 0.01" pos="0 0 -0.01"/></body>
    <body name="tip" mocap="true" pos="0 0 2">{geom}</body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""
PLACES = [(u, v) for u in np.linspace(0.0, 1.0, 9) for v in np.linspace(0.0, 1.0, 8)]
"""Places in a parallelogram of the lattice: centres, edges between cells, corners where three meet."""


class Press:
    """A lattice of cells, and a solid that is put somewhere on it, at rest."""

    def __init__(self, folder: Path, geom: str) -> None:
        patch = body_scenes.lattice_patch("skin", "base", 9, 9)
        self.body = body_scenes.body_of(folder, SCENE.format(geom=geom), (patch,), ("turn",))
        self.mocap = int(self.body.model.mj.body("tip").mocapid[0])
        positions_m = self.body.surface.position_m[:, :2]
        middle = np.argmin(np.linalg.norm(positions_m - positions_m.mean(axis=0), axis=1))
        self.origin_m = positions_m[middle]

    def force_n(
        self, place: tuple[float, float], height_m: float, quat: tuple[float, ...] = (1, 0, 0, 0)
    ) -> float:
        """Sum of all cells with the solid at `place`, in pitches, and its origin `height_m` over the foam."""
        u, v = place
        across_m = PITCH_M * np.array([u + 0.5 * v, 0.5 * math.sqrt(3.0) * v])
        body: BodySimulation = self.body
        body.data.mocap_pos[self.mocap] = (*(self.origin_m + across_m), FACE_M + height_m)
        body.data.mocap_quat[self.mocap] = quat
        mujoco.mj_fwdPosition(body.model.mj, body.data)
        mujoco.mj_fwdVelocity(body.model.mj, body.data)
        body.cell_foundation.compute_contact(0.001)
        return float(body.cell_foundation.contact.force_n.sum())


@pytest.mark.parametrize(
    ("radius_m", "tolerance"), [(0.005, 0.05), (0.008, 0.03), (0.015, 0.03), (0.04, 0.03), (0.08, 0.03)]
)
def test_a_tip_reads_the_closed_form_wherever_it_presses(
    tmp_path: Path, radius_m: float, tolerance: float
) -> None:
    """F = k × volume of the cap, k π d² (r - d / 3), from a depth of 0.2 mm on."""
    press = Press(tmp_path, f'<geom type="sphere" size="{radius_m}"/>')
    for depth_m in (0.0002, 0.0005, 0.001, 0.002, min(0.75 * radius_m, 0.0058)):
        exact_n = K_PA_PER_M * math.pi * depth_m**2 * (radius_m - depth_m / 3.0)
        read_n = [press.force_n(place, radius_m - depth_m) for place in PLACES]
        np.testing.assert_allclose(read_n, exact_n, rtol=tolerance)
        assert np.mean(read_n) == pytest.approx(exact_n, rel=0.005)


def test_a_tip_that_is_a_mesh_reads_as_much(tmp_path: Path) -> None:
    spec = mujoco.MjSpec()
    spec.add_mesh(name="ball").make_sphere(subdivision=4)
    spec.mesh("ball").scale = [0.008, 0.008, 0.008]
    spec.worldbody.add_body(name="base", pos=[0, 0, 1]).add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.3, 0.01], pos=[0, 0, -0.01]
    )
    spec.worldbody.add_body(name="tip", mocap=True).add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ball")
    far = spec.worldbody.add_body(name="far", pos=[5, 5, 5])
    far.add_joint(name="turn")
    far.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0])
    spec.compile()
    press = Press(tmp_path, "")
    (tmp_path / "mesh").mkdir()
    patch = body_scenes.lattice_patch("skin", "base", 9, 9)
    press.body = body_scenes.body_of(tmp_path / "mesh", spec.to_xml(), (patch,), ("turn",))
    press.mocap = int(press.body.model.mj.body("tip").mocapid[0])
    exact_n = K_PA_PER_M * math.pi * 0.0058**2 * (0.008 - 0.0058 / 3.0)
    read_n = [press.force_n(place, 0.008 - 0.0058) for place in PLACES]
    np.testing.assert_allclose(read_n, exact_n, rtol=0.03)


def test_a_flat_end_with_a_straight_edge_across_cells(tmp_path: Path) -> None:
    """A box of 5 × 3 cm, flat: F = k d × its area, wherever its edges cross the cells."""
    press = Press(tmp_path, '<geom type="box" size="0.025 0.015 0.02"/>')
    for turn in (0.0, 0.2, math.pi / 6.0):
        quat = (math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn))
        read_n = [press.force_n(place, 0.02 - 0.003, quat) for place in PLACES]
        np.testing.assert_allclose(read_n, K_PA_PER_M * 0.003 * 0.05 * 0.03, rtol=0.03)


def test_a_wedge_reads_its_own_volume(tmp_path: Path) -> None:
    """A box with an edge down, at 45°: F = k d² × its length, less than a sample's width deep."""
    press = Press(tmp_path, '<geom type="box" size="0.03 0.02 0.02"/>')
    quat = (math.cos(math.pi / 8.0), math.sin(math.pi / 8.0), 0.0, 0.0)
    for depth_m in (0.0005, 0.001, 0.003, 0.006):
        read_n = [press.force_n(place, 0.02 * math.sqrt(2.0) - depth_m, quat) for place in PLACES]
        np.testing.assert_allclose(read_n, K_PA_PER_M * depth_m**2 * 0.06, rtol=0.05)


def test_the_end_of_a_capsule_and_its_side(tmp_path: Path) -> None:
    """End: the sphere's; side: k × length × circular segment, and the two half caps."""
    press, r, d = Press(tmp_path, '<geom type="capsule" size="0.008 0.02"/>'), 0.008, 0.004
    cap_n = K_PA_PER_M * math.pi * d**2 * (r - d / 3.0)
    np.testing.assert_allclose([press.force_n(p, 0.028 - d) for p in PLACES], cap_n, rtol=0.03)
    segment_m2 = r * r * math.acos(1.0 - d / r) - (r - d) * math.sqrt(2.0 * r * d - d * d)
    lying = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    exact_n = cap_n + K_PA_PER_M * 0.04 * segment_m2
    np.testing.assert_allclose([press.force_n(p, r - d, lying) for p in PLACES], exact_n, rtol=0.03)


def test_the_moment_is_that_of_the_centre_of_pressure(tmp_path: Path) -> None:
    """A tip beside all sample points pushes through its own centre: no moment about it, without friction."""
    press = Press(tmp_path, '<geom type="sphere" size="0.008"/>')
    tip = int(press.body.model.mj.body("tip").id)
    for place in PLACES:
        press.body.data.xfrc_applied[:] = 0.0
        force_n = press.force_n(place, 0.006)
        wrench = press.body.data.xfrc_applied[tip]
        assert wrench[2] == pytest.approx(force_n, rel=1e-12)
        assert np.linalg.norm(wrench[3:5]) < 2e-4 * force_n, "off by less than 0.2 mm"


def test_a_plate_that_hovers_above_the_foam_presses_nothing(tmp_path: Path) -> None:
    """Cells that seek it within their reach, and do not meet it, add no points of the step before."""
    press = Press(tmp_path, '<geom type="box" size="0.3 0.3 0.02"/>')
    assert press.force_n((0.0, 0.0), 0.02 - 0.003) > 1.0
    assert press.force_n((0.0, 0.0), 0.02 + 0.003) == 0.0
