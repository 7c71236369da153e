"""One evaluation of contact, and of the implicit step, against the law point by point and dense algebra.

Small enough to run as plain Python: `tests/support/mutants.py` tries faults of the contact code with them.
"""

import itertools
from pathlib import Path
from typing import NamedTuple

import body_scenes
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from skinnet.body.contact.compliant_layer import CompliantLayer
from skinnet.body.contact.contact_scene import build_contact_scene, may_intersect_sphere
from skinnet.body.contact.foam_response import add_pairs, add_response, elastic_energy_j
from skinnet.body.contact.implicit_step import ImplicitContact
from skinnet.body.contact.loaded_points import LoadedPoints
from skinnet.body.contact.pair_response import PairResponse, no_pairs
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.simulation import BodySimulation
from skinnet.deployment.robot import FoamSpec

Floats = NDArray[np.float64]

THICK_M, K_PA_PER_M, C_PA_S_PER_M, STEP_S = 0.012, 1.5e6, 1e4, 1e-3
TOOL = '<body name="tool" pos="0 0 3"><freejoint/><geom type="box" size="0.1 0.06 0.02" mass="1.3"/></body>'


RIGID = CompliantLayer(1.0)


class Point(NamedTuple):
    """A sample of the foam under a plane: where it is, how deep, and the relative velocity there.

    Attributes:
        cell: Row of its cell.
        taxel: Force cell that it belongs to.
        place_m: (3,) the point at which forces act, world [m].
        axes: (3, 3) columns are the cell's axes, world.
        depth_m: Overlap of foam and plane [m].
        velocity_m_s: (3,) velocity of the tool relative to the arm, frame of the cell [m/s].
        jacobian: (3, nv) of this velocity.
        area_m2: Area that it stands for [m²].
    """

    cell: int
    taxel: int
    place_m: Floats
    axes: Floats
    depth_m: float
    velocity_m_s: Floats
    jacobian: Floats
    area_m2: float


class Pressed:
    """An arm in any state with two cells under a plate that covers both of them."""

    def __init__(
        self, folder: Path, layer: CompliantLayer = RIGID, *, is_led: bool = False, **foam: float
    ) -> None:
        """A free plate, or one that is led as the teacher's finger is: without joints, with a velocity."""
        tool = TOOL.replace('"tool"', '"tool" mocap="true"').replace("<freejoint/>", "") if is_led else TOOL
        self.is_led = is_led
        self.body: BodySimulation = body_scenes.arm(folder, more=tool, foam=FoamSpec(**foam))
        self.mj, self.data, self.layer = self.body.model.mj, self.body.data, layer
        self.tool, self.arm = (int(self.mj.body(name).id) for name in ("tool", "arm"))
        given = self.body.cell_foundation
        self.foundation = Foundation(
            given.surface,
            build_contact_scene(self.mj, given.surface, {self.tool: layer}),
            given.foam,
            given.motion,
            given.temperature_c,
            given.applied_wrench,
        )

    def put(self, seed: int, depth_m: float, tilt_rad: float = 0.03, speed: float = 0.1) -> None:
        """A random state: the plate's underside about `depth_m` in the foam."""
        random = np.random.default_rng(seed)
        self.data.qpos[:2] = random.uniform(-0.5, 0.5, 2)
        mujoco.mj_kinematics(self.mj, self.data)
        R_arm = Rotation.from_matrix(self.data.xmat[self.arm].reshape(3, 3))
        R_tool = R_arm * Rotation.from_rotvec(
            [*random.uniform(-tilt_rad, tilt_rad, 2), random.uniform(-0.1, 0.1)]
        )
        x, y, z, w = R_tool.as_quat().tolist()
        face_m = self.data.xpos[self.arm] + R_arm.apply([0.35, 0.0, 0.01 + THICK_M - depth_m])
        position_m, rotation = face_m + R_tool.apply([0.0, 0.0, 0.02]), (w, x, y, z)
        if self.is_led:
            self.data.mocap_pos[0], self.data.mocap_quat[0] = position_m, rotation
        else:
            self.data.qpos[2:5], self.data.qpos[5:9] = position_m, rotation
        self.data.qvel[:] = speed * random.normal(size=self.mj.nv)
        mujoco.mj_forward(self.mj, self.data)
        if self.is_led:
            self.data.cvel[self.tool] = speed * random.normal(size=6)
        self.data.xfrc_applied[:] = 0.0

    def points(self) -> list[Point]:
        """The samples of both cells."""
        surface, found = self.foundation.surface, []
        grid, R_world_arm = surface.grid, self.data.xmat[self.arm].reshape(3, 3)
        up = self.data.xmat[self.tool].reshape(3, 3)[:, 2]
        plane_m = self.data.xpos[self.tool] - 0.02 * up
        for cell, s in itertools.product((0, 1), range(grid.n_samples)):
            axes = R_world_arm @ surface.R_body_cell[cell]
            i = grid.n_nodes + s
            below_m = self.data.xpos[self.arm] + R_world_arm @ surface.position_m[cell]
            below_m = below_m + axes[:, 0] * grid.x_m[i] + axes[:, 1] * grid.y_m[i]
            depth_m = THICK_M - float((plane_m - below_m) @ up / (axes[:, 2] @ up))
            pressed_m = max(depth_m, 0.0)
            indented_m = min((1.0 - self.layer.foam_fraction) * pressed_m, self.layer.max_indentation_m)
            place_m = below_m + (THICK_M - pressed_m + indented_m) * axes[:, 2]
            J = axes.T @ (self._jacobian(self.tool, place_m) - self._jacobian(self.arm, place_m))
            velocity_m_s = J @ self.data.qvel + axes.T @ self._led_velocity_m_s(place_m)
            found.append(Point(cell, s // 9, place_m, axes, depth_m, velocity_m_s, J, grid.area_m2))
        return found

    def _led_velocity_m_s(self, place_m: Floats) -> Floats:
        """Velocity of a point of the plate that no joint gives it."""
        if not self.is_led:
            return np.zeros(3)
        twist, root = self.data.cvel[self.tool], self.mj.body_rootid[self.tool]
        led_m_s: Floats = twist[3:] + np.cross(twist[:3], place_m - self.data.subtree_com[root])
        return led_m_s

    def _jacobian(self, body: int, place_m: Floats) -> Floats:
        J = np.zeros((3, self.mj.nv))
        mujoco.mj_jac(self.mj, self.data, J, None, place_m, body)
        return J

    def wrench(self, points: list[Point], forces_n: Floats) -> tuple[Floats, Floats]:
        """Force and moment about its centre of mass on the tool, and on the arm, of forces (·, 3) [N]."""
        world_n = np.array([p.axes @ f for p, f in zip(points, forces_n, strict=True)])
        place_m = np.array([p.place_m for p in points])
        on_tool = np.cross(place_m - self.data.xipos[self.tool], world_n).sum(axis=0)
        on_arm = -np.cross(place_m - self.data.xipos[self.arm], world_n).sum(axis=0)
        return np.append(world_n.sum(axis=0), on_tool), np.append(-world_n.sum(axis=0), on_arm)


def cells_of(points: LoadedPoints) -> NDArray[np.int64]:
    """Row of the cell of each loaded point."""
    n, runs = int(points.total[0]), int(points.n_runs[0])
    return np.repeat(points.run_cell[:runs], np.diff(points.run_first[:runs], append=n))


def friction_n(shear_m: Floats, slip_m_s: Floats, area_m2: float, limit_n: float) -> Floats:
    """Half of k and c in shear, at most μ N."""
    force_n = -0.5 * area_m2 * (K_PA_PER_M * shear_m + C_PA_S_PER_M * slip_m_s)
    size_n = float(np.linalg.norm(force_n))
    return force_n * limit_n / size_n if size_n > limit_n else force_n


@pytest.mark.parametrize("friction", [0.6, 0.02], ids=["sticks", "slides"])
@pytest.mark.parametrize(
    "layer",
    [CompliantLayer(1.0), CompliantLayer(0.6, 0.006), CompliantLayer(0.6, 0.001)],
    ids=["rigid", "soft", "thin"],
)
def test_forces_are_those_of_the_law_at_every_point(
    tmp_path: Path, layer: CompliantLayer, friction: float
) -> None:
    scene = Pressed(tmp_path, layer, friction=friction)
    contact, tool, share = scene.foundation.contact, scene.tool, layer.foam_fraction
    scene.foundation.temperature_c[tool] = 31.0
    slid = stuck = 0
    for seed in range(4):
        scene.put(seed, depth_m=0.004)
        points = scene.points()
        shear_m, forces_n = np.zeros((54, 2)), np.zeros((54, 3))
        contact.shear_m[:] = 0.0
        for _ in range(2):  # the second goes on from the shear of the first
            taxel_n, work_n_m = np.zeros((3, 3)), 0.0
            scene.data.xfrc_applied[:] = 0.0
            scene.foundation.compute_contact(STEP_S)
            for m, p in enumerate(points):
                area_m2 = share * p.area_m2
                pressure_pa = K_PA_PER_M * p.depth_m - C_PA_S_PER_M * p.velocity_m_s[2]
                normal_n, slip = area_m2 * max(0.0, pressure_pa), p.velocity_m_s[:2]
                shear_m[m] += STEP_S * slip
                forces_n[m] = (*friction_n(shear_m[m], slip, area_m2, friction * normal_n), normal_n)
                held_m, length_m = (
                    friction * normal_n / (0.5 * K_PA_PER_M * area_m2),
                    np.linalg.norm(shear_m[m]),
                )
                if length_m > held_m:
                    work_n_m += normal_n * (length_m - held_m)
                    shear_m[m] *= held_m / length_m
                slid, stuck = slid + bool(length_m > held_m), stuck + bool(length_m <= held_m)
                taxel_n[p.cell, p.taxel] += normal_n
            assert contact.force_n == pytest.approx(taxel_n, rel=1e-9, abs=1e-12)
            assert contact.shear_m[:2].transpose(0, 2, 1).reshape(54, 2) == pytest.approx(
                shear_m, rel=1e-9, abs=1e-15
            )
            on_tool, on_arm = scene.wrench(points, forces_n)
            assert scene.data.xfrc_applied[tool] == pytest.approx(on_tool, rel=1e-8, abs=1e-9)
            assert scene.data.xfrc_applied[scene.arm] == pytest.approx(on_arm, rel=1e-8, abs=1e-9)
            total_n = pytest.approx(taxel_n.sum())
            assert contact.body_normal_force_n[tool] == contact.patch_body_force_n[0, tool] == total_n
            assert contact.peak_force_n[0] == pytest.approx(taxel_n.max())
            assert contact.force_weighted_slip_n_m[tool] == pytest.approx(work_n_m, abs=1e-15)
            assert contact.contact_temperature_c[:2] == pytest.approx([31.0, 31.0])
            assert contact.in_contact.tolist() == [True, True, False]
            assert scene.foundation.n_in_contact == 2
            assert np.isnan(contact.contact_temperature_c[2])
            energy_j = sum(
                0.5 * K_PA_PER_M * share * p.area_m2 * (p.depth_m**2 + 0.5 * s @ s)
                for p, s in zip(points, shear_m, strict=True)
            )
            assert elastic_energy_j(scene.foundation.problem) == pytest.approx(energy_j, rel=1e-6)
    assert slid > 20 if friction < 0.1 else stuck > 20
    scene.data.qpos[4] += 1.0
    mujoco.mj_forward(scene.mj, scene.data)
    scene.data.xfrc_applied[:] = 0.0
    scene.foundation.compute_contact(STEP_S)
    assert not contact.force_n.any()
    assert not contact.shear_m.any(), "foam that is let go forgets its shear"
    assert not scene.data.xfrc_applied.any()


def response(scene: Pressed, twist: Floats, *, with_stiffness: bool = True) -> PairResponse:
    """Response of the loaded foam at a relative twist about its origin."""
    pairs = no_pairs(scene.mj.nbody, 4)
    add_pairs(scene.foundation.problem, pairs)
    assert pairs.total[0] == 1
    assert pairs.body[0].tolist() == [scene.arm, scene.tool]
    pairs.twist[0] = twist
    add_response(scene.foundation.problem, pairs, STEP_S, with_stiffness)
    return pairs


@pytest.mark.parametrize("share", [1.0, 0.6])
@pytest.mark.parametrize("damping", [1e4, 0.0])
@pytest.mark.parametrize("friction", [50.0, 0.05], ids=["sticks", "slides"])
@pytest.mark.parametrize("depth_m", [0.004, -0.0002], ids=["in contact", "before it"])
def test_wrench_and_stiffness_of_a_pair(
    tmp_path: Path, share: float, damping: float, friction: float, depth_m: float
) -> None:
    """Wrench: the law at the end of the step, point by point. Stiffness: its central differences.

    Where foam slides, the stiffness leaves out that friction grows with pressure: only motions that leave the
    pressure as it is are compared.
    """
    scene = Pressed(tmp_path, CompliantLayer(share, 0.02), friction=friction, damping_pa_s_per_m=damping)
    random = np.random.default_rng(0)
    for seed in range(3):
        scene.put(seed, depth_m, tilt_rad=0.0, speed=0.0)
        data_velocity = scene.data.cvel[scene.tool, 3:]
        data_velocity[:] = 0.5  # so fast that what is 0.2 mm away is looked for
        scene.foundation.compute_contact(STEP_S)
        data_velocity[:] = 0.0
        scene.foundation.contact.shear_m[:2] = random.normal(0.0, 1e-4, (2, 2, 27))
        twist = random.normal(0.0, 0.05, 6) * (1, 1, 1, 10, 10, 10)
        twist[:3] -= scene.data.xmat[scene.arm].reshape(3, 3)[:, 2] * (0.5 if depth_m < 0.0 else 0.0)
        pairs, points = response(scene, twist), scene.points()
        shear_m = scene.foundation.contact.shear_m[:2].transpose(0, 2, 1).reshape(54, 2)
        slope, expected = max(damping, STEP_S * K_PA_PER_M), np.zeros(6)
        for p, strain_m in zip(points, shear_m, strict=True):
            u = p.axes.T @ (twist[:3] + np.cross(twist[3:], p.place_m - pairs.origin_m))
            area_m2 = share * p.area_m2
            elastic_pa = p.depth_m * (K_PA_PER_M if p.depth_m > 0.0 else slope / STEP_S)
            normal_n = area_m2 * max(0.0, elastic_pa - slope * u[2])
            rate = slope - STEP_S * K_PA_PER_M
            sheared_n = -0.5 * area_m2 * (K_PA_PER_M * (strain_m + STEP_S * u[:2]) + rate * u[:2])
            size_n = np.linalg.norm(sheared_n)
            sheared_n *= min(1.0, friction * normal_n / size_n)
            force_n = p.axes @ (*sheared_n, normal_n)
            expected += (*force_n, *np.cross(p.place_m - pairs.origin_m, force_n))
        assert pairs.wrench[0] == pytest.approx(expected, rel=1e-9, abs=1e-10)
        again = response(scene, twist, with_stiffness=False)
        assert again.wrench[0] == pytest.approx(pairs.wrench[0])
        assert not again.stiffness.any()
        axes = points[0].axes
        turn = np.append(np.cross(-axes[:, 2], np.zeros(3)), axes[:, 2])
        ways = (
            np.eye(6) if friction > 1.0 else np.array([[*axes[:, 0], 0, 0, 0], [*axes[:, 1], 0, 0, 0], turn])
        )
        for way in ways:
            reach = 1e-6
            low, high = (response(scene, twist + sign * reach * way).wrench[0] for sign in (-1, 1))
            slope_n = (high - low) / (2.0 * reach)
            assert -pairs.stiffness[0] @ way == pytest.approx(
                slope_n, rel=1e-4, abs=1e-4 * np.abs(slope_n).max()
            )


def test_the_stiffness_under_an_edge_is_the_derivative(tmp_path: Path) -> None:
    """Cells of which a part is pressed: no moment of their points vanishes by symmetry."""
    scene, reach = Pressed(tmp_path, friction=50.0), 1e-6
    for seed, along_m in ((0, 0.05), (1, 0.055), (2, -0.055)):
        scene.put(seed, 0.004, tilt_rad=0.0, speed=0.0)
        scene.data.qpos[2:5] += along_m * scene.data.xmat[scene.arm].reshape(3, 3)[:, 0]
        mujoco.mj_forward(scene.mj, scene.data)
        scene.foundation.compute_contact(STEP_S)
        points = scene.foundation.problem.points
        n = int(points.total[0])
        pressed_m2 = [
            points.area_m2[:n][(cells_of(points) == c) & (points.depth_m[:n] > 0)].sum() for c in (0, 1)
        ]
        assert 0.05 < min(pressed_m2) / max(pressed_m2) < 0.95, "an edge lies across one of the cells"
        stiffness = response(scene, np.zeros(6)).stiffness[0]
        for way in np.eye(6):
            low, high = (response(scene, sign * reach * way).wrench[0] for sign in (-1, 1))
            slope = (high - low) / (2.0 * reach)
            assert -stiffness @ way == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("damping", [1e4, 0.0])
@pytest.mark.parametrize("is_led", [False, True], ids=["free", "led"])
@pytest.mark.parametrize(("tilt_rad", "accuracy", "n_iterations"), [(0.0, 1e-9, 2), (0.03, 1e-3, 6)])
def test_forces_of_a_step_solve_the_dense_system(
    tmp_path: Path, tilt_rad: float, accuracy: float, n_iterations: int, damping: float, is_led: bool
) -> None:
    """M̂ (v⁺ - v) = h (Q + Σ Jᵀ f(J v⁺)) with all samples and joints at once; the foam sticks, so f is linear.

    Under a plate that is parallel the matrix is exact: the second correction finds nothing.
    """
    slope = max(damping, STEP_S * K_PA_PER_M)
    for seed in range(3):
        scene = Pressed(tmp_path, is_led=is_led, friction=50.0, damping_pa_s_per_m=damping)
        mj, data = scene.mj, scene.data
        implicit = ImplicitContact(mj, data, (scene.foundation, scene.body.sheet_foundation))
        scene.put(seed, depth_m=0.004, tilt_rad=tilt_rad)
        scene.foundation.compute_contact(STEP_S)
        scene.foundation.contact.shear_m[:], data.qacc[:] = 0.0, 0.0
        inertia = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, data, inertia)
        data.qfrc_smooth[:] = smooth = np.random.default_rng(seed).normal(0.0, 2.0, mj.nv)
        servo = np.zeros(mj.nv)
        for actuator in range(mj.nu):
            dof = mj.jnt_dofadr[mj.actuator_trnid[actuator, 0]]
            servo[dof] -= mj.actuator_biasprm[actuator, 2] * mj.actuator_gear[actuator, 0] ** 2
        matrix = inertia + STEP_S * np.diag(servo + mj.dof_damping.reshape(mj.nv, -1)[:, 0])
        right = matrix @ data.qvel + STEP_S * smooth
        for p in scene.points():
            by_axis = p.area_m2 * slope * np.array([0.5, 0.5, 1.0])
            matrix = matrix + STEP_S * p.jacobian.T @ (by_axis[:, None] * p.jacobian)
            right = right + STEP_S * p.jacobian[2] * p.area_m2 * K_PA_PER_M * p.depth_m
            led_m_s = p.velocity_m_s - p.jacobian @ data.qvel
            right = right - STEP_S * p.jacobian.T @ (by_axis * led_m_s)
        after = np.linalg.solve(matrix, right)
        expected = np.zeros(mj.nv)
        for p in scene.points():
            u = p.velocity_m_s + p.jacobian @ (after - data.qvel)
            sheared_n = -0.5 * p.area_m2 * slope * u[:2]
            normal_n = p.area_m2 * (K_PA_PER_M * p.depth_m - slope * u[2])
            assert normal_n > 0.0
            expected += p.jacobian.T @ (*sheared_n, normal_n)
        implicit.add_forces(STEP_S)
        assert 1 <= implicit.n_iterations <= n_iterations
        added, slack = data.qfrc_smooth - smooth, accuracy * np.abs(expected).max()
        assert added == pytest.approx(expected, rel=accuracy, abs=slack)


def test_solids_are_sought_as_far_as_they_may_come(tmp_path: Path) -> None:
    """Twice the way of a step, by translation or turning; a body at rest may fall; at most 10 mm."""
    scene = Pressed(tmp_path)
    for speed_m_s, gap_m, found in (
        (0.0, 3.9e-5, True),
        (0.0, 4.1e-5, False),
        (1.0, 1.9e-3, True),
        (1.0, 2.1e-3, False),
        (40.0, 9.9e-3, True),
        (40.0, 10.1e-3, False),
    ):
        for turns in (False, True):
            scene.put(0, -gap_m, tilt_rad=0.0, speed=0.0)
            normal = scene.data.xmat[scene.arm].reshape(3, 3)[:, 2]
            radius_m = float(np.linalg.norm([0.1, 0.06, 0.02]))
            scene.data.qvel[2:5] = 0.0 if turns else -speed_m_s * normal
            scene.data.qvel[5:8] = (0.0, speed_m_s / radius_m, 0.0) if turns else 0.0
            mujoco.mj_fwdVelocity(scene.mj, scene.data)
            scene.foundation.compute_contact(STEP_S)
            points = scene.foundation.problem.points
            n = int(points.total[0])
            assert n == (54 if found else 0), (speed_m_s, gap_m, turns)
            assert points.depth_m[:n] == pytest.approx(np.full(n, -gap_m), abs=1e-9)
            assert scene.foundation.n_in_contact == 0


def test_a_cell_that_two_bodies_press(tmp_path: Path) -> None:
    """Its temperature is their mean, weighted by area; each body has its own force."""
    other = TOOL.replace("tool", "other")
    body = body_scenes.arm(tmp_path, more=TOOL + other)
    data, foundation = body.data, body.cell_foundation
    arm, tool, second = (int(body.model.mj.body(name).id) for name in ("arm", "tool", "other"))
    foundation.temperature_c[[tool, second]] = 20.0, 50.0
    edge_m = 0.003
    for address, side in ((2, -1.0), (9, 1.0)):
        data.qpos[address : address + 3] = (
            0.30 + edge_m + side * 0.1,
            0.0,
            1.05 + 0.01 + THICK_M - 0.004 + 0.02,
        )
        data.qpos[address + 3 : address + 7] = (1.0, 0.0, 0.0, 0.0)
    mujoco.mj_forward(body.model.mj, data)
    foundation.compute_contact(STEP_S)
    points, contact = foundation.problem.points, foundation.contact
    n = int(points.total[0])
    of = foundation.scene.body_id[points.solid[:n]]
    in_cell = cells_of(points) == 0
    area_m2 = [points.area_m2[:n][in_cell & (of == each)].sum() for each in (tool, second)]
    assert sum(area_m2) == pytest.approx(1.5 * 3**0.5 * 0.014**2)
    assert area_m2[0] > 1.1 * area_m2[1] > 0.0
    assert contact.contact_temperature_c[0] == pytest.approx(np.average([20.0, 50.0], weights=area_m2))
    for each in (tool, second):
        pressed_n = K_PA_PER_M * 0.004 * points.area_m2[:n][of == each].sum()
        assert contact.body_normal_force_n[each] == pytest.approx(pressed_n, rel=1e-6)
    assert contact.force_n.sum() == pytest.approx(contact.body_normal_force_n[[tool, second]].sum())
    assert contact.patch_body_force_n[0] == pytest.approx(contact.body_normal_force_n)
    assert data.xfrc_applied[arm, 2] == pytest.approx(-contact.force_n.sum())


def test_the_broad_phase_of_every_solid_is_safe_and_of_use(tmp_path: Path) -> None:
    """Never apart where MuJoCo's distance is below the radius, and apart where it is far above."""
    kinds = ("sphere", "box", "capsule", "cylinder", "ellipsoid")
    size = (0.05, 0.03, 0.02)
    more = "".join(
        f'<body name="{kind}" pos="0.1 0.2 3"><freejoint/>'
        f'<geom name="{kind}" type="{kind}" size="0.05 0.03 0.02"/></body>'
        for kind in kinds
    )
    more += (
        '<body name="probe" mocap="true"><geom name="probe" size="1e-6" contype="0" conaffinity="0"/></body>'
    )
    body = body_scenes.arm(tmp_path, more=more)
    mj, data, scene = body.model.mj, body.data, body.cell_foundation.scene
    random, probe, told = np.random.default_rng(0), int(mj.geom("probe").id), {True: 0, False: 0}
    for _ in range(150):
        for kind in kinds:
            data.joint(int(mj.body(kind).jntadr[0])).qpos[3:] = random.normal(size=4)
        centre_m = np.array([0.1, 0.2, 3.0]) + random.uniform(-0.09, 0.09, 3)
        data.mocap_pos[0], radius_m = centre_m, random.uniform(0.001, 0.03)
        mujoco.mj_kinematics(mj, data)
        for kind in kinds:
            geom = int(mj.geom(kind).id)
            k = int(np.flatnonzero(scene.geom_id == geom)[0])
            apart_m = mujoco.mj_geomDistance(mj, data, geom, probe, 1.0, None)
            near = bool(may_intersect_sphere(scene, body.cell_foundation.motion, k, *centre_m, radius_m))
            if apart_m < 0.999 * radius_m:
                assert near, kind
            if apart_m > 1.74 * radius_m + (max(size) if kind in ("capsule", "ellipsoid") else 1e-3):
                assert not near, kind
            told[near] += 1
    assert min(told.values()) > 30
