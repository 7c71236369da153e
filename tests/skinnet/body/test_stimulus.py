"""What cells sense: compared with the motion itself, MuJoCo's own sensors, and statics."""

import math

import body_scenes
import mujoco
import numpy as np
import pytest
from body_scenes import ARM_CELLS

from skinnet.body.contact.contact_scene import build_contact_scene
from skinnet.body.ground_truth.cell_kinematics import cell_poses
from skinnet.body.model import FINGER
from skinnet.deployment.load import load
from skinnet.deployment.skin.cells import CellSpec, ProximitySpec
from skinnet.protocol.messages import STIMULUS_NAMES

DISTANCE = STIMULUS_NAMES.index("distance_m")
ACCELERATION = slice(4, 7)
TEMPERATURE = STIMULUS_NAMES.index("temperature_c")
THICKNESS_M = 0.012
REACH_M = 1.5 * 0.05

OBSTACLES = """
<body name="ball" pos="0.30 0.02 1.20"><joint name="b" axis="1 0 0"/><geom type="sphere" size="0.10"/></body>
<body name="rod" pos="0.42 0 1.15" euler="1.4 0 0">
  <joint name="c" axis="0 1 0"/><geom type="capsule" size="0.03 0.1"/>
</body>
<geom name="wall" type="box" size="0.5 0.01 0.5" pos="0 0.10 1"/>
"""


def with_native_sensors(folder, more=OBSTACLES, **body):
    """The arm with an accelerometer and a rangefinder where each cell is."""
    sites, sensors = "", ""
    for i, cell in enumerate(ARM_CELLS):
        normal, x = np.array(cell.normal, float), np.array(cell.x_axis, float)
        x -= normal * (x @ normal)
        y = np.cross(normal, x)
        at = np.array(cell.position_m) + THICKNESS_M * normal
        sites += '<site name="s{}" pos="{} {} {}" xyaxes="{} {} {} {} {} {}"/>'.format(i, *at, *x, *y)
        sensors += f'<accelerometer site="s{i}"/><rangefinder site="s{i}"/>'
    mjcf = body_scenes.ARM.replace("</body>", f"{sites}</body>", 1)
    mjcf = mjcf.format(more=more, sensors=f"<sensor>{sensors}</sensor>")
    patches = (body_scenes.patch("skin", "arm", *ARM_CELLS),)
    return body_scenes.body_of(folder, mjcf, patches, ("turn", "lift"), **body)


def native(body):
    """Readings of MuJoCo's own sensors at the body's present state."""
    data = mujoco.MjData(body.model.mj)
    mujoco.mj_copyData(data, body.model.mj, body.data)
    mujoco.mj_implicit(body.model.mj, data)
    happens = (data.qvel - body.data.qvel) / body.model.mj.opt.timestep
    mujoco.mj_copyData(data, body.model.mj, body.data)
    data.qacc[:] = happens  # MuJoCo's own is not what the implicit integrator makes of it
    mujoco.mj_sensorPos(body.model.mj, data)
    mujoco.mj_rnePostConstraint(body.model.mj, data)
    mujoco.mj_sensorAcc(body.model.mj, data)
    rows = data.sensordata.reshape(len(ARM_CELLS), -1)
    return rows[:, :3], rows[:, 3]


def test_acceleration_equals_the_native_accelerometer_in_motion(tmp_path):
    body = with_native_sensors(tmp_path)
    largest = 0.0
    for k in range(1, 60):
        body.set_command([math.sin(0.7 * k), 1.2 * math.cos(1.3 * k)])
        body.advance(body.t_ns + 4_000_000)
        stimulus = body.stimulus()
        theirs, _ = native(body)
        np.testing.assert_allclose(stimulus[:, ACCELERATION], theirs, rtol=0, atol=1e-11)
        largest = max(largest, float(np.abs(theirs).max()))
    assert largest > 12.0, "the arm must really move"


def sine_motion(body, dof, frequency_hz, n_steps):
    """Joint `dof` follows a sine of 0.3 rad/s: readings (t, n, 3), and second differences of the motion."""
    position, rotation, read = [], [], []
    step_ms = round(1e3 * body.model.mj.opt.timestep, 3)
    for k in range(n_steps):
        wanted = np.zeros(body.n_dofs)
        wanted[dof] = 0.3 * math.sin(2.0 * math.pi * frequency_hz * k * step_ms * 1e-3)
        body.set_command(wanted)
        read.append(body.stimulus()[:, ACCELERATION])
        position_m, R_world_cell = cell_poses(body)
        position.append(position_m)
        rotation.append(R_world_cell)
        body.advance(body.t_ns + round(step_ms * 1e6))
    position, rotation = np.array(position), np.array(rotation)
    happened = (position[2:] - 2.0 * position[1:-1] + position[:-2]) / (1e-3 * step_ms) ** 2
    proper = np.einsum("tnji,tnj->tni", rotation[1:-1], happened - body.model.mj.opt.gravity)
    return np.array(read)[1:-1], proper


@pytest.mark.parametrize("joint", ["left_shoulder_pitch", "left_elbow_pitch", "left_wrist_roll"])
def test_acceleration_is_that_of_the_motion(joint):
    """Against second differences of the cells' positions; `qacc` reads 1.12 × (shoulder) to 2.1 × (wrist)."""
    body = body_scenes.hrp2()
    dof = load(body_scenes.HRP2).body.joints.index(joint)
    read, happened = sine_motion(body, dof, 4.0, 300)
    cells = body.cells["left_hand"]
    read, happened = read[:, cells], happened[:, cells]
    moving = happened - happened.mean(axis=0)
    assert np.abs(moving).max() > 0.15, "the cells must really move"
    error = np.abs(read - happened).max()
    ratio = float(np.vdot(read - read.mean(axis=0), moving) / np.vdot(moving, moving))
    assert ratio == pytest.approx(1.0, abs=0.01)
    assert error < 0.02 * np.abs(moving).max()


def test_acceleration_on_a_free_base_is_that_of_its_motion(tmp_path):
    mjcf = body_scenes.ARM.format(more="", sensors="").replace(
        '<joint name="turn" axis="0 0 1"/>', '<freejoint name="floats"/>'
    )
    patches = (body_scenes.lattice_patch("chest", "base", 2, 2, (0.0, 0.05, 0.0)),)
    body = body_scenes.body_of(tmp_path, mjcf, patches, ("lift",))
    read, happened = sine_motion(body, 0, 4.0, 250)
    reaction = np.abs(happened).max()
    assert reaction > 0.3, "in free fall, only the reaction to the arm is felt"
    assert np.abs(read - happened).max() < 0.02 * reaction


def test_distance_in_a_narrow_cone_equals_the_native_rangefinder(tmp_path):
    narrow = CellSpec(proximity=ProximitySpec(half_angle_deg=1e-4))
    body = with_native_sensors(tmp_path, cells=narrow)
    seen = 0
    for k in range(1, 60):
        body.set_command([0.5 * math.sin(0.2 * k), 0.5 * math.cos(0.2 * k)])
        body.advance(body.t_ns + 4_000_000)
        distance = body.stimulus()[:, DISTANCE]
        _, theirs = native(body)
        theirs = np.where((theirs < 0) | (theirs > REACH_M), np.inf, theirs)
        np.testing.assert_allclose(distance, theirs, rtol=0, atol=1e-6)
        seen += np.isfinite(distance).sum()
    assert seen > 60


def test_what_is_only_drawn_is_not_seen(tmp_path):
    wall = '<geom type="box" size="0.5 0.01 0.5" pos="0 0.08 1" {}/>'
    seen = body_scenes.arm(tmp_path, more=wall.format("")).stimulus()
    unseen = body_scenes.arm(tmp_path, more=wall.format('contype="0" conaffinity="0"')).stimulus()
    assert seen[2, DISTANCE] == pytest.approx(0.07 - 0.03 - THICKNESS_M, abs=1e-6)
    assert np.isinf(unseen[:, DISTANCE]).all()


def test_skin_feels_everything_but_its_own_body_and_its_neighbours(tmp_path):
    table = '<body name="table"><geom type="box" size="0.1 0.1 0.1" pos="0 3 0"/></body>'
    plate = '<body name="plate" pos="0 4 0"><geom type="box" size="0.1 0.1 0.01"/></body>'
    ball = '<body name="ball" pos="0 5 0"><freejoint/><geom type="sphere" size="0.1"/></body>'
    tip = '<body name="tip" pos="0.5 0 0"><joint axis="0 0 1"/><geom type="sphere" size="0.02"/></body>'
    mjcf = body_scenes.ARM.format(more=table + plate + ball, sensors="").replace(
        "</body>", f"{tip}</body>", 1
    )
    patches = tuple(body_scenes.lattice_patch(name, name, 1, 1) for name in ("arm", "base", "tip", "plate"))
    body = body_scenes.body_of(tmp_path, mjcf, patches, ("turn",))
    scene = build_contact_scene(body.model.mj, body.surface)
    names = [body.model.mj.body(int(b)).name for b in scene.body_id]
    felt = {
        patch.name: {name for name, may in zip(names, row, strict=True) if may}
        for patch, row in zip(patches, scene.collides, strict=True)
    }
    rest = {"table", "plate", "ball", FINGER}
    assert felt == {
        "arm": rest,
        "base": rest | {"tip"},
        "tip": rest | {"base"},
        "plate": {"base", "arm", "tip", "table", "ball", FINGER},
    }


def test_at_rest_a_cell_reads_gravity_upwards(tmp_path):
    body = body_scenes.arm(tmp_path)
    body.advance(500_000_000)
    acceleration = body.stimulus()[:, ACCELERATION]
    np.testing.assert_allclose(np.linalg.norm(acceleration, axis=1), 9.81, atol=1e-3)
    np.testing.assert_allclose(acceleration[:2, 2], 9.81, atol=1e-3)


def test_temperature_is_that_of_what_touches(tmp_path):
    box = '<freejoint/><geom type="box" size="0.03 0.02 0.02" mass="0.3"/>'
    warm = f'<body name="warm" pos="0.30 0 1.26">{box}</body>'
    body = body_scenes.arm(
        tmp_path, more=warm, ambient_c=20.0, body_temperature_c={"warm": 36.5, "arm": 28.0}
    )
    body.set_command([0.0, 0.0])
    np.testing.assert_array_equal(body.stimulus()[:, TEMPERATURE], 28.0)
    body.advance(800_000_000)
    stimulus = body.stimulus()
    assert stimulus[0, :3].sum() > 1.0, "the box has fallen onto cell 0"
    assert stimulus[0, TEMPERATURE] == 36.5
    assert stimulus[2, TEMPERATURE] == 28.0


@pytest.mark.parametrize("seed", range(4))
def test_turning_the_whole_scene_changes_nothing(tmp_path, seed):
    """Frame equivariance: world, gravity and everything in it turned and moved together."""
    random = np.random.default_rng(seed)
    quaternion = random.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quaternion)
    rotation = rotation.reshape(3, 3)
    start = np.array([0.303, 0.002, 0.15])
    ball = '<body pos="{} {} {}"><freejoint/><geom type="sphere" size="0.03" mass="0.1"/></body>'.format(
        *start
    )

    def scene(position, turn, gravity):
        place, along, down = (" ".join(map(repr, map(float, v))) for v in (position, turn, gravity))
        mjcf = f"""<mujoco><option gravity="{down}"/><worldbody>
          <body name="base" pos="{place}" quat="{along}">
            <geom type="box" size="0.05 0.05 0.05" mass="5"/>
            <body name="arm" pos="0 0 0.08"><joint name="lift" axis="0 1 0" armature="0.1"/>
              <geom type="box" size="0.2 0.03 0.01" pos="0.25 0 0" mass="2"/></body>
          </body>{ball}</worldbody></mujoco>"""
        patches = (body_scenes.patch("skin", "arm", *ARM_CELLS),)
        return body_scenes.body_of(tmp_path, mjcf, patches, ("lift",))

    plain = scene(np.zeros(3), (1, 0, 0, 0), (0, 0, -9.81))
    offset = random.normal(size=3)
    turned = scene(offset, quaternion, rotation @ (0, 0, -9.81))
    turned.data.qpos[1:4] = offset + rotation @ start
    turned.data.qpos[4:8] = quaternion
    pressed = 0.0
    for k in range(1, 50):
        for body in (plain, turned):
            body.set_command([0.3 * math.sin(k)])
            body.advance(k * 4_000_000)
        np.testing.assert_allclose(turned.stimulus(), plain.stimulus(), rtol=1e-8, atol=1e-8)
        assert plain.data.ncon == 0, "MuJoCo's own contacts would depend on the frame"
        pressed = max(pressed, plain.stimulus()[:, :3].sum())
    assert pressed > 0.5
