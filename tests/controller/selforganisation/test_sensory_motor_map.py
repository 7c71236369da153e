"""The sensory-motor map against the analytic Jacobian of an arm, and the laws of equations (2) and (3)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_robot import G_M_S2, Floats, SkinnedArms, run

from controller.selforganisation.deflections import Deflections
from controller.selforganisation.exploration import PositionControl
from controller.selforganisation.lock_in import LockIn
from controller.selforganisation.map_exploration import MapExploration, MapExplorationConfig
from controller.selforganisation.sensory_motor_map import (
    SensoryMotorMap,
    compare_maps,
    fuse_with_activity,
    normal_weights,
)

NOISE_G = LSB_G = 0.004


def analytic_weights(J: Floats) -> Floats:
    """Equation (2) with the Jacobian in the place of the deflections; positive moves inwards."""
    total = np.abs(J).sum(axis=2)
    return np.where(total > 1e-9, -J[:, :, 2] / np.maximum(total, 1e-9), 0.0)


def unit_rows(W: Floats) -> Floats:
    norm = np.linalg.norm(W, axis=1, keepdims=True)
    return np.where(norm > 0.1, W / np.maximum(norm, 1e-9), 0.0)


@pytest.fixture(scope="module")
def arm() -> SkinnedArms:
    return SkinnedArms(n_arms=1, cells_per_part=20)


@pytest.fixture(scope="module")
def J(arm: SkinnedArms) -> Floats:
    return arm.jacobian(arm.home_rad)


@pytest.fixture(scope="module")
def explored(arm: SkinnedArms) -> MapExploration:
    program = MapExploration(MapExplorationConfig(), arm.n_dofs, arm.n_cells, 0)
    servos = run(program, arm, noise_g=NOISE_G, lsb_g=LSB_G, lag_s=0.005)
    assert np.abs(servos.q - arm.home_rad).max() < 1e-6  # the sine does not drift
    return program


def test_the_map_agrees_with_the_jacobian(arm: SkinnedArms, J: Floats, explored: MapExploration) -> None:
    assert explored.result.problems == ()
    W = fuse_with_activity(arm.activity, normal_weights(explored.result.deflection_m))

    same_form = compare_maps(W, unit_rows(analytic_weights(J)))
    assert same_form.n_entries > 200
    assert same_form.sign_fraction >= 0.97
    assert same_form.correlation >= 0.97

    normal_jacobian = compare_maps(
        W, -J[:, :, 2] / np.maximum(np.linalg.norm(J[:, :, 2], axis=1), 1e-9)[:, None]
    )
    assert normal_jacobian.sign_fraction >= 0.97
    assert normal_jacobian.correlation >= 0.9


def test_every_reaction_evades(arm: SkinnedArms, J: Floats, explored: MapExploration) -> None:
    W = fuse_with_activity(arm.activity, normal_weights(explored.result.deflection_m))
    normal_velocity = np.einsum("sd,sd->s", J[:, :, 2], W)
    reacts = W.any(axis=1)
    assert reacts.sum() >= 0.9 * arm.n_arm_cells
    assert (normal_velocity[reacts] < 0.0).all()


def test_without_the_activity_matrix_cells_at_rest_would_react(
    arm: SkinnedArms, explored: MapExploration
) -> None:
    weights = normal_weights(explored.result.deflection_m)
    unrelated = ~arm.activity
    assert np.abs(weights[unrelated]).mean() > 0.2  # the ratio of noise to noise
    assert not fuse_with_activity(arm.activity, weights)[unrelated].any()


@pytest.mark.parametrize(("frequency_hz", "lag_s"), [(4.0, 0.005), (8.0, 0.02)])
def test_deflection_is_inertia_minus_gravity_tilt_whatever_the_servo_lag(
    frequency_hz: float, lag_s: float
) -> None:
    arm = SkinnedArms(n_arms=1, cells_per_part=3, torso_cells=1)
    program = MapExploration(MapExplorationConfig(frequency_hz=frequency_hz), arm.n_dofs, arm.n_cells, 0)
    run(program, arm, noise_g=0.0, lag_s=lag_s)

    def up(q: Floats) -> Floats:
        return arm.accelerometers_g(q, 0 * q, 0 * q)

    step = 1e-6 * np.eye(arm.n_dofs)
    turn = ((up(arm.home_rad + step) - up(arm.home_rad - step)) / 2e-6).transpose(1, 0, 2)
    tilt = turn * G_M_S2 / (2 * math.pi * frequency_hz) ** 2
    expected = arm.jacobian(arm.home_rad) - tilt
    # one percent: the lag moves the ramp into the window, and samples alias harmonics of the velocity steps
    np.testing.assert_allclose(program.result.deflection_m, expected, rtol=1e-2, atol=3e-4)
    assert np.abs(tilt).max() > 10 * 3e-4


def test_a_second_frequency_removes_the_tilt_of_gravity() -> None:
    arm = SkinnedArms(n_arms=1, cells_per_part=1, torso_cells=1)
    J = arm.jacobian(arm.home_rad)

    def error_m(tilt_frequency_hz: float | None) -> float:
        config = MapExplorationConfig(tilt_frequency_hz=tilt_frequency_hz, periods=2)
        program = MapExploration(config, arm.n_dofs, arm.n_cells, 0)
        run(program, arm, noise_g=0.0)
        assert program.result.problems == ()
        return float(np.abs(program.result.deflection_m - J).max())

    assert error_m(2.0) < 1.5e-3
    assert error_m(None) > 10e-3


def test_noise_is_known_and_moves_no_cell() -> None:
    """Parts out of phase tell the noise of a small sine, in which half of the cells at rest seem to move."""
    arm = SkinnedArms(n_arms=1, cells_per_part=12, torso_cells=40)
    config = MapExplorationConfig(amplitude_rad_s=0.05, tilt_frequency_hz=2.0)
    program = MapExploration(config, arm.n_dofs, arm.n_cells, 0)
    run(program, arm, noise_g=0.003)
    found, still = program.result, ~arm.activity
    spread_m = [found.deflection_m[still[:, dof], dof].std() for dof in range(arm.n_dofs)]
    np.testing.assert_allclose(found.noise_m, spread_m, rtol=0.25)
    assert (found.lever_arms_m() > 0.005)[still].mean() > 0.3
    assert not found.accelerates(0.005)[still].any()
    assert found.accelerates(0.005)[arm.activity].mean() > 0.8


def test_motion_by_reaction_belongs_to_the_joint_that_yields() -> None:
    rng = np.random.default_rng(5)
    J = rng.uniform(-0.5, 0.5, (4, 3, 3))
    J[2:, 1] = 0.0  # cells proximal to joint 1
    coupling = np.array([[1.0, -0.2, 0.05], [0.1, 1.0, 0.0], [0.0, 0.3, 1.0]])
    in_phase = np.einsum("sdx,de->sex", J, coupling)
    found = Deflections(np.zeros(3), in_phase, coupling, np.array([True, True, False]), np.zeros(3), ())
    assert np.linalg.norm(in_phase[2:, 1], axis=1).min() > 0.005
    lever_m = found.lever_arms_m()
    np.testing.assert_allclose(lever_m[:, :2], np.linalg.norm(J, axis=2)[:, :2], atol=1e-12)
    assert not lever_m[2:, 1].round(12).any()
    assert not lever_m[:, 2].any()


def test_the_command_has_no_jump_and_returns() -> None:
    config = MapExplorationConfig()
    program = MapExploration(config, 2, 1, 0)
    position, commands, t_ns = np.zeros(2), [], 0
    while not program.done:
        commands.append(program.step(t_ns, position))
        position = position + commands[-1] * 5e-3
        t_ns += 5_000_000
    velocity = np.array(commands)
    assert velocity.max() == pytest.approx(config.amplitude_rad_s, rel=1e-2)
    largest_change = config.amplitude_rad_s * 2 * math.pi * config.frequency_hz * 5e-3
    assert np.abs(np.diff(velocity, axis=0)).max() <= largest_change * 1.001
    # nor has its acceleration: what a sine without fading would begin with is the largest change itself
    assert np.abs(np.diff(velocity, n=2, axis=0)).max() < largest_change / 4
    assert np.abs(velocity[-1]).max() == 0.0
    assert np.abs(position).max() < 1e-9
    assert not (velocity[:, 0] * velocity[:, 1]).any()  # one after the other


def test_a_joint_without_rest_is_told_with_the_sine_that_it_disturbs() -> None:
    """The elbow's sine begins off home: the robot has to rest there, too."""
    limits_rad = np.array([[-1.0, 0.0], [-1.0, 1.0]])
    config = MapExplorationConfig(
        position_control=PositionControl(range_rad=limits_rad), rest_timeout_ns=500_000_000
    )
    program = MapExploration(config, 2, 1, 0, dof_names=("elbow", "wrist"))
    position_rad = np.zeros(2)
    for t_ns in range(0, 20_000_000_000, 5_000_000):
        shaken_rad = position_rad + np.array([0.0, 0.01 * np.sin(15.0 * t_ns * 1e-9)])
        program.add_positions(t_ns, shaken_rad)
        position_rad = position_rad + 5e-3 * program.step(t_ns, shaken_rad)
    says = [problem for problem in program.result.problems if "come to rest" in problem]
    before = ["before the sine of DoF elbow"] * 2 + ["before the sine of DoF wrist"] * 2
    assert says == [f"DoF wrist did not come to rest {when}" for when in [*before, "after the last sine"]]


def test_a_joint_without_rest_disturbs_the_mirrored_sine_of_the_same_joint() -> None:
    program = MapExploration(MapExplorationConfig(rest_timeout_ns=500_000_000), 2, 1, 0)
    position_rad = np.zeros(2)
    for t_ns in range(0, 20_000_000_000, 5_000_000):
        shaken_rad = position_rad + np.array([0.0, 0.01 * np.sin(15.0 * t_ns * 1e-9)])
        touches = position_rad[0] > 0.005
        program.add_touch(np.zeros(1, dtype=np.int64), np.array([[0.3 * touches, 0.0, 0.0, 0.0]]))
        program.add_positions(t_ns, shaken_rad)
        position_rad = position_rad + 5e-3 * program.step(t_ns, shaken_rad)
    says = [problem for problem in program.result.problems if "come to rest" in problem]
    before = ["before the sine of DoF 0"] * 2 + ["before the sine of DoF 1"]
    assert says == [f"DoF 1 did not come to rest {when}" for when in [*before, "after the last sine"]]


def test_a_mirrored_sine_that_presses_as_much_is_stopped_too() -> None:
    """The contact that stopped the first sine ends on the way back, and is no reading at rest."""
    program = MapExploration(MapExplorationConfig(), 1, 1, 0)
    position_rad, widest_rad, t_ns = np.zeros(1), 0.0, 0
    while not program.done:
        touches = abs(position_rad[0]) > 0.005
        program.add_touch(np.zeros(1, dtype=np.int64), np.array([[0.3 * touches, 0.0, 0.0, 0.0]]))
        program.add_positions(t_ns, position_rad)
        position_rad = position_rad + 5e-3 * program.step(t_ns, position_rad)
        widest_rad = max(widest_rad, abs(float(position_rad[0])))
        t_ns += 5_000_000
    assert widest_rad < 0.01
    assert program.result.problems == (
        "DoF 0 did not complete its sine: something touched or came near cell 0",
    )


@pytest.mark.parametrize("silent_sine", [0, 1])
def test_a_cell_without_samples_at_one_of_two_frequencies_is_not_measured(silent_sine: int) -> None:
    program = MapExploration(MapExplorationConfig(tilt_frequency_hz=2.0, periods=2), 1, 2, 0)
    position_rad, speed_rad_s, t_ns = np.zeros(1), 0.0, 0
    while not program.done:
        program.add_positions(t_ns, position_rad)
        command_rad_s = program.step(t_ns, position_rad)
        acceleration = (command_rad_s[0] - speed_rad_s) / 5e-3
        position_rad, speed_rad_s = position_rad + 5e-3 * command_rad_s, float(command_rad_s[0])
        t_ns += 5_000_000
        sine = round(3 * program.progress) - 1
        cells = np.array([0] if sine == silent_sine else [0, 1])
        readings_g = np.tile([0.0, 0.3 * acceleration / G_M_S2, 1.0], (len(cells), 1))
        program.add_samples(cells, np.full(len(cells), t_ns), readings_g)
    assert program.result.problems == ("DoF 0: cell 1 with too few samples",)
    assert program.result.deflection_m[0, 0, 1] == pytest.approx(0.3, abs=0.03)
    assert not program.result.deflection_m[1].any()


def test_dead_cells_and_stuck_joints_are_reported_and_weigh_nothing() -> None:
    arm = SkinnedArms(n_arms=1, cells_per_part=2, torso_cells=1)
    config = MapExplorationConfig(periods=2, min_samples=20)
    program = MapExploration(config, arm.n_dofs, arm.n_cells, 0)
    with pytest.raises(RuntimeError, match="not done"):
        _ = program.result
    run(program, arm, noise_g=NOISE_G, dead_cells=(1,), stuck_dof=2)
    found = program.result
    assert any(problem.startswith("DoF 2 did not follow its sine") for problem in found.problems)
    assert "DoF 0: cell 1 with too few samples" in found.problems
    assert not found.deflection_m[1].any()
    assert not found.deflection_m[:, 2].any()
    assert found.deflection_m[0, 0].any()


@settings(deadline=None)
@given(
    amplitude=st.floats(0.01, 10),
    phase=st.floats(-3, 3),
    offset=st.floats(-5, 5),
    frequency_hz=st.floats(0.5, 20),
    seed=st.integers(0, 99),
)
def test_lock_in_finds_any_sine_at_any_times(
    amplitude: float, phase: float, offset: float, frequency_hz: float, seed: int
) -> None:
    t_s = np.random.default_rng(seed).uniform(0, 1.7, 60)
    lock_in = LockIn(2, 1, frequency_hz)
    values = offset + amplitude * np.cos(2 * np.pi * frequency_hz * t_s + phase)
    for part in (slice(0, 17), slice(17, 60)):
        lock_in.add(np.ones(len(t_s[part]), dtype=np.int64), t_s[part], values[part, None])
    found = lock_in.amplitude(min_samples=60)
    assert np.isnan(found[0, 0])
    assert found[1, 0] == pytest.approx(
        amplitude * np.exp(1j * phase), abs=1e-7 * (1 + abs(offset) + amplitude)
    )


def test_lock_in_has_no_bias_from_noise_and_knows_when_it_is_blind() -> None:
    rng = np.random.default_rng(1)
    rows = np.repeat(np.arange(400), 250)
    t_s = np.tile(np.linspace(0.0, 1.0, 250, endpoint=False), 400)
    lock_in = LockIn(401, 1, 4.0)
    lock_in.add(
        rows, t_s, 0.004 * np.sin(2 * np.pi * 4.0 * t_s)[:, None] + 0.004 * rng.standard_normal((len(t_s), 1))
    )
    lock_in.add(np.full(30, 400), np.linspace(0.0, 7.5, 31)[:30], np.ones((30, 1)))  # once a period
    found = lock_in.amplitude(min_samples=25)[:, 0]
    assert -found[:400].imag.mean() == pytest.approx(0.004, rel=0.02)  # largest samples would say about 0.014
    assert -found[:400].imag.std() == pytest.approx(-0.004 * math.sqrt(2 / 250), rel=0.15)
    assert np.isnan(found[400])


def test_weights_and_fusion_by_hand() -> None:
    deflection: Floats = np.array(
        [[[1.0, -1, 2], [0, 0, -3.0]], [[0, 0, 0], [9, 0.5, 0.5]], [[1, 0, 1], [1, 0, 1]]]
    )
    weights = normal_weights(deflection)
    np.testing.assert_allclose(weights, np.array([[-0.5, 1], [0, -0.05], [-0.5, -0.5]]))
    activity = np.array([[True, True], [True, True], [False, True]])
    fused = fuse_with_activity(activity, weights, min_row_norm=0.1)
    np.testing.assert_allclose(fused, np.array([[-math.sqrt(0.2), math.sqrt(0.8)], [0, 0], [0, -1]]))
    assert fuse_with_activity(activity, weights, min_row_norm=0.0)[1].tolist() == [0.0, -1.0]


def test_the_closest_pose_decides() -> None:
    skin_map = SensoryMotorMap()
    with pytest.raises(LookupError, match="explore a pose first"):
        skin_map.closest(np.zeros(2))
    poses = np.array([[0.0, 0], [1, 0], [0, 2]])
    for number, pose in enumerate(poses):
        skin_map.add(pose, np.full((3, 2), float(number)))
    assert len(skin_map) == 3
    np.testing.assert_array_equal(skin_map.poses_rad, poses)
    for at, number in (([0.4, 0.0], 0), ([0.6, 0.1], 1), ([0.0, 1.1], 2), ([0.5, 0.0], 0)):
        assert skin_map.closest(np.array(at))[0, 0] == number
    with pytest.raises(ValueError, match="do not match"):
        skin_map.add(np.zeros(3), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="do not match"):
        skin_map.add(np.zeros(2), np.zeros((4, 2)))


def test_agreement_has_its_fixed_points() -> None:
    W = np.array([[0.5, -0.5], [0.05, 0.9]])
    assert compare_maps(W, W).sign_fraction == 1.0
    assert compare_maps(W, W).correlation == pytest.approx(1.0)
    assert compare_maps(W, W).n_entries == 3
    assert compare_maps(-W, W).sign_fraction == 0.0
    assert compare_maps(-W, W).correlation == pytest.approx(-1.0)
    assert math.isnan(compare_maps(W, np.zeros((2, 2))).sign_fraction)
    assert math.isnan(compare_maps(W, np.zeros((2, 2))).correlation)
