"""The foam of tactile sheets: statics in any pose, flat and bent, and no energy out of nothing."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from body_scenes import CONTROLLER
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from skinnet.body.simulation import BodySimulation
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.robot import BodySpec, FoamSpec
from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import DeploymentError, ModelError

Floats = NDArray[np.float64]

PITCH_M, K, THICK_M = 0.0215, 1.5e6, 0.012
BASE_M = np.array([0.3, -0.2, 1.0])
FLAT = {"name": "skin", "body": "base", "origin_m": (0.0, 0.0, 0.0), "normal": (0, 0, 1), "up": (0, 1, 0)}
ROUND = FLAT | {"radius_m": 0.05475}
SEMI_FLAT = FLAT | {"radius_m": 0.041, "flat_m": 0.086}
BOX = '<geom type="box" size="0.15 0.15 0.02" pos="0 0 0.02" mass="1"/>'
CYLINDER = '<geom type="cylinder" size="0.07 0.14" pos="0 0 0.07" euler="90 0 0" mass="1"/>'
SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="base" pos="0.3 -0.2 1" quat="{quat}">
      <geom type="box" size="0.01 0.01 0.01" pos="0 0 -0.2"/>
    </body>
    <body name="tool"><freejoint/>{geom}</body>
    <body name="far" pos="5 5 5"><joint name="turn" axis="1 0 0"/><geom type="sphere" size="0.05"/></body>
  </worldbody>
</mujoco>
"""


class Scene:
    """A full sheet on a fixed base in any pose, and a tool whose underside is at its origin."""

    def __init__(
        self,
        folder: Path,
        geom: str = BOX,
        seed: int = 0,
        surface: dict[str, Any] = FLAT,
        **foam: float,
    ) -> None:
        self.R = Rotation.random(random_state=seed)
        x, y, z, w = self.R.as_quat().tolist()
        mjcf = SCENE.format(quat=f"{w} {x} {y} {z}", geom=geom)
        (folder / "scene.xml").write_text(mjcf)
        self.body = BodySimulation(
            Deployment(
                name="scene",
                robot="scene",
                body=BodySpec(
                    model="scene.xml", reference_body="base", joints=("turn",), foam=FoamSpec(**foam)
                ),
                surfaces=(SurfaceSpec(**surface),),
                sheets=(SheetSpec(name="skin", surface="skin"),),
                controller=CONTROLLER,
            ),
            folder,
        )
        self.data, self.sheet = self.body.data, self.body.sheets[0]
        self.tool = int(self.body.model.mj.body("tool").id)

    def put(self, position_m: Any, rotation_rad: Any = (0, 0, 0), velocity: Any = (0, 0, 0, 0, 0, 0)) -> None:
        """Pose of the tool, frame of the base; velocity: linear in that frame, angular in the tool's."""
        self.data.qpos[:3] = BASE_M + self.R.apply(position_m)
        x, y, z, w = (self.R * Rotation.from_rotvec(rotation_rad)).as_quat()
        self.data.qpos[3:7] = (w, x, y, z)
        self.data.qvel[:3], self.data.qvel[3:6] = self.R.apply(velocity[:3]), velocity[3:]

    def press(self) -> tuple[Floats, Floats]:
        """Force [N] and moment [N m] about the base's origin on the tool at the present state, base frame."""
        self.body.dynamics.compute_contact()
        return self.on(self.tool)

    def on(self, body: int) -> tuple[Floats, Floats]:
        wrench = self.data.xfrc_applied[body]
        arm_m = self.data.xipos[body] - BASE_M
        moment = wrench[3:] + np.cross(arm_m, wrench[:3])
        return self.R.inv().apply(wrench[:3]), self.R.inv().apply(moment)

    def force_n(self) -> Floats:
        return self.body.sheet_foundation.element_force_n()

    def centre_m(self) -> Floats:
        """Centre of pressure ξ, as a board finds it."""
        force_n = self.force_n()
        return force_n @ self.sheet.xi_m / force_n.sum()


@pytest.mark.parametrize(("seed", "position_m"), [(0, (0.0, 0.0)), (1, (0.02, -0.015)), (2, (-0.01, 0.025))])
def test_a_plate_pressed_at_a_point_in_any_pose(
    tmp_path: Path, seed: int, position_m: tuple[float, float]
) -> None:
    """60 N along the normal at a known point: total within 1 %, centre within 1 mm."""
    scene = Scene(tmp_path, seed=seed, damping_pa_s_per_m=4e4)
    scene.put((0.0, 0.0, THICK_M))
    load_n = scene.R.apply((0.0, 0.0, -60.0))
    for _ in range(800):
        arm_m = BASE_M + scene.R.apply((*position_m, THICK_M)) - scene.data.xpos[scene.tool]
        scene.data.qfrc_applied[:3] = load_n
        scene.data.qfrc_applied[3:6] = scene.data.xmat[scene.tool].reshape(3, 3).T @ np.cross(arm_m, load_n)
        scene.body.advance(scene.body.t_ns + 1_000_000)
    assert np.abs(scene.data.qvel[:6]).max() < 1e-4, "at rest"
    pressure_kpa = scene.body.pressures()
    assert pressure_kpa.sum() * 1e3 * PITCH_M**2 == pytest.approx(60.0, rel=0.01)
    assert scene.centre_m() == pytest.approx(np.array(position_m), abs=1e-3)


def test_depth_times_stiffness_times_area_is_the_force(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    scene.put((0.0, 0.0, THICK_M - 0.003))
    force_n, moment_nm = scene.press()
    assert force_n == pytest.approx([0.0, 0.0, K * 0.003 * (8 * PITCH_M) ** 2], abs=1e-6)
    assert moment_nm == pytest.approx(0.0, abs=1e-6)
    assert scene.force_n() == pytest.approx(K * 0.003 * PITCH_M**2)
    sheet = scene.body.sheet_foundation
    assert sheet.pressure_kpa() == pytest.approx(1e-3 * K * 0.003)
    assert sheet.body_force_n()[scene.body.model.mj.body("base").id] == pytest.approx(scene.force_n().sum())
    assert sheet.surface.grid.n_nodes == 8, "the corners of an element's three pieces, in a strip"


@pytest.mark.parametrize("surface", [FLAT, ROUND, SEMI_FLAT], ids=["flat", "round", "semi_flat"])
@pytest.mark.parametrize("geom", [BOX, CYLINDER], ids=["box", "cylinder"])
def test_action_equals_reaction_on_every_surface(tmp_path: Path, surface: dict[str, Any], geom: str) -> None:
    scene = Scene(tmp_path, geom, 3, surface)
    base = int(scene.body.model.mj.body("base").id)
    random = np.random.default_rng(0)
    for _ in range(20):
        place_m = (*random.uniform(-0.015, 0.015, 2), THICK_M - random.uniform(0.003, 0.008))
        scene.put(place_m, random.uniform(-0.1, 0.1, 3), random.uniform(-0.2, 0.2, 6))
        force_n, moment_nm = scene.press()
        back_n, back_nm = scene.on(base)
        assert scene.force_n().sum() > 0.1
        assert force_n == pytest.approx(-back_n, abs=1e-10)
        assert moment_nm == pytest.approx(-back_nm, abs=1e-10)


@pytest.mark.parametrize("depth_m", [0.002, 0.006])
def test_a_plate_on_a_round_sheet_is_the_integral_over_the_circle(tmp_path: Path, depth_m: float) -> None:
    """Σ p A and the force on the plate against quadrature: columns of foam stand on the circle, radially."""
    scene = Scene(tmp_path, surface=ROUND)
    radius_m, length_m = ROUND["radius_m"], 8 * PITCH_M
    height_m = radius_m + THICK_M - depth_m
    edge = math.acos(height_m / (radius_m + THICK_M))

    def column_n(angle: float) -> float:
        return K * (radius_m + THICK_M - height_m / math.cos(angle)) * radius_m * length_m

    found = []
    for tilt in np.linspace(0.0, PITCH_M / radius_m, 12, endpoint=False):  # around the sheet by one element
        normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
        scene.put(np.array([0.0, 0.0, -radius_m]) + height_m * normal, (0.0, tilt, 0.0))
        force_n, _ = scene.press()
        found.append((scene.force_n().sum(), force_n @ normal))
    exact_n = [quad(column_n, -edge, edge)[0], quad(lambda a: column_n(a) * math.cos(a), -edge, edge)[0]]
    assert np.mean(found, axis=0) == pytest.approx(exact_n, rel=0.005)
    assert np.array(found) == pytest.approx(np.tile(exact_n, (12, 1)), rel=0.05), "three points an element"


def test_a_cylinder_that_rolls_over_the_sheet(tmp_path: Path) -> None:
    """Under 60 N: the sum stays the load and the centre of pressure below its axis, over many elements."""
    scene = Scene(tmp_path, CYLINDER)
    scene.put((-0.015, 0.0, THICK_M - 0.004))
    data, axis, speed_m_s = scene.data, scene.R.apply((0.0, 1.0, 0.0)), 0.05
    sums_n, errors_m = [], []
    for step in range(1000):
        load_n, arm_m = scene.R.apply((0.0, 0.0, -60.0)), data.xipos[scene.tool] - data.xpos[scene.tool]
        R_world_tool = data.xmat[scene.tool].reshape(3, 3)
        data.qfrc_applied[:3] = load_n
        data.qfrc_applied[3:6] = R_world_tool.T @ np.cross(arm_m, load_n)
        if step > 200:  # it rolls as if a hand led its axis, and is free to rise and sink
            spin = axis * speed_m_s / 0.07
            sinking = (data.qvel[:3] + np.cross(spin, arm_m)) @ scene.R.apply((0.0, 0.0, 1.0))
            data.qvel[:3] = scene.R.apply((speed_m_s, 0.0, sinking)) - np.cross(spin, arm_m)
            data.qvel[3:6] = R_world_tool.T @ spin
        scene.body.advance(scene.body.t_ns + 1_000_000)
        if step > 300:
            scene.body.pressures()
            place_m = scene.R.inv().apply(data.xipos[scene.tool] - BASE_M)
            sums_n.append(scene.force_n().sum())
            errors_m.append(scene.centre_m() - place_m[:2])
    assert place_m[0] > 0.02, "it came over the middle; damping puts the centre c / k × speed = 0.3 mm ahead"
    assert np.mean(sums_n) == pytest.approx(60.0, rel=0.01)
    assert np.abs(errors_m).max() < 1e-3


def loop(scene: Scene, path: Callable[[float], tuple[float, ...]], steps: int = 2000) -> tuple[float, float]:
    """Work [J] that the foam does on a tool led around a closed path, and the largest that it stored."""
    work_j = stored_j = 0.0
    for i in range(steps):
        now, after = np.array(path(i / steps)), np.array(path((i + 1) / steps))
        velocity = (after - now) / 1e-3
        scene.put(0.5 * (now + after)[:3], (0, 0, 0), (*velocity, 0, 0, 0))
        force_n, _ = scene.press()
        work_j += float(force_n @ velocity) * 1e-3
        stored_j = min(stored_j, work_j)
    return work_j, -stored_j


@pytest.mark.parametrize("turns", [1, 3])
def test_the_foam_is_passive(tmp_path: Path, turns: int) -> None:
    """Around any closed path it takes energy; without damping and friction it gives back what it took."""

    def path(t: float) -> tuple[float, float, float]:
        angle = 2 * math.pi * t
        return (
            0.004 * math.sin(turns * angle),
            0.003 * math.sin(2 * angle),
            THICK_M + 0.001 - 0.0035 * (1 - math.cos(angle)),
        )

    work_j, stored_j = loop(Scene(tmp_path, CYLINDER), path)
    assert work_j < -0.1 * stored_j
    work_j, stored_j = loop(Scene(tmp_path, CYLINDER, damping_pa_s_per_m=0.0), path)
    assert work_j < -0.02 * stored_j, "friction alone"
    work_j, stored_j = loop(Scene(tmp_path, CYLINDER, damping_pa_s_per_m=0.0, friction=0.0), path)
    assert stored_j > 1e-3
    assert abs(work_j) < 1e-3 * stored_j


def test_sliding_is_counted_and_sticking_is_not(tmp_path: Path) -> None:
    """Pushed sideways a little, the foam only strains; pulled on, μ N × slip is the lost work."""
    scene = Scene(tmp_path, damping_pa_s_per_m=0.0)
    pressed = scene.body.sheet_foundation.contact
    slid, work_j, speed_m_s = [], 0.0, 0.05
    for i in range(200):
        scene.put((speed_m_s * 1e-3 * i, 0.0, THICK_M - 0.003), (0, 0, 0), (speed_m_s, 0, 0, 0, 0, 0))
        force_n, _ = scene.press()
        slid.append(pressed.force_weighted_slip_n_m[scene.tool] / pressed.body_normal_force_n[scene.tool])
        work_j += float(force_n[0]) * speed_m_s * 1e-3
    stick_m = 0.6 * 0.003 / 0.5  # μ k d / (half of k)
    first = int(stick_m / (speed_m_s * 1e-3))
    assert max(slid[: first - 1]) == 0.0
    assert sum(slid) == pytest.approx(200 * speed_m_s * 1e-3 - stick_m, rel=0.01)
    assert force_n[0] == pytest.approx(-0.6 * force_n[2])
    elastic_j = 0.5 * 0.6 * force_n[2] * stick_m
    assert work_j == pytest.approx(-0.6 * force_n[2] * sum(slid) - elastic_j, rel=0.02)


def test_sheets_need_one_pitch_and_a_body(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE.format(quat="1 0 0 0", geom=BOX))

    def build(body: str, *pitches_m: float) -> None:
        BodySimulation(
            Deployment(
                name="scene",
                robot="scene",
                body=BodySpec(model="scene.xml", reference_body="base", joints=("turn",)),
                surfaces=tuple(
                    SurfaceSpec(**(FLAT | {"name": f"s{i}", "body": body, "origin_m": (0.3 * i, 0, 0)}))
                    for i in range(len(pitches_m))
                ),
                sheets=tuple(
                    SheetSpec(name=f"s{i}", surface=f"s{i}", pitch_m=pitch_m)
                    for i, pitch_m in enumerate(pitches_m)
                ),
                controller=CONTROLLER,
            ),
            tmp_path,
        )

    with pytest.raises(DeploymentError, match=r"0\.01, 0\.0215"):
        build("base", 0.0215, 0.01)
    with pytest.raises(ModelError, match=r"surfaces\.s0\.body"):
        build("knee", 0.0215)
