"""Scripted body without physics: ideal velocity-controlled joints, and prescribed skin stimuli."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.actuation import is_valid_command
from skinnet.body.contact.point_kinematics import Motion, motion_views, point_above_cell
from skinnet.body.contact.skin_surface import SkinSurface, build_skin_surface, rows_by_patch
from skinnet.body.ground_truth.recorder import GroundTruthRecorder
from skinnet.body.model import load_model
from skinnet.body.plant import GroundTruth
from skinnet.body.scripted.presses import build_press_schedule, presses_before, write_press_stimulus
from skinnet.body.stimulus import write_proper_acceleration
from skinnet.body.sway import Sway
from skinnet.clock import NS_PER_S
from skinnet.compilation import compiled
from skinnet.deployment.deployment import Deployment
from skinnet.pinned_linalg import matmul
from skinnet.protocol.messages import N_FORCE_CHANNELS, STIMULUS_NAMES
from skinnet.skin.placement import place_patch

__all__ = ["ScriptedBody"]

Floats = NDArray[np.float64]


class ScriptedBody:
    """Robot with skin whose stimuli are prescribed by a script.

    Joints move at constant velocities between two stimulus samples, so accelerations are the mean over the
    last sampling period: the change of velocity by its length. Sway tilts the robot against gravity; its
    far smaller accelerations are neglected.

    Attributes:
        t_ns: Present time [ns].
        cells: Rows of each patch's cells in the stimulus, by the name of the patch.
        model: The compiled model.
        data: MuJoCo's state: configuration and derivatives, never stepped.
        surface: All cells, on the bodies that carry them.
        press_schedule: The scripted presses.
        refused_commands: Number of refused commands.
        recorder: Ground truth of threshold crossings and of the largest forces on force cells.
    """

    def __init__(self, deployment: Deployment, base_dir: Path) -> None:
        """Initialise the body in its home configuration at time 0.

        Raises:
            ModelError: the model does not compile or lacks something.
            DeploymentError: the deployment contradicts itself or the model.
        """
        assert deployment.scripted_stimuli is not None
        spec = deployment.body
        self.t_ns = 0
        self.refused_commands = 0
        self.model = load_model(deployment, base_dir, with_environment=False)
        patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
        self.surface = build_skin_surface(self.model.mj, patches, deployment.cells, spec.model)
        self.cells = rows_by_patch(patches)
        sizes = {patch.name: patch.n_cells for patch in patches}
        self.press_schedule = build_press_schedule(deployment.scripted_stimuli, deployment.seed, sizes)
        self.recorder = GroundTruthRecorder(deployment, spec.stimulus_period_ns)
        self.data = mujoco.MjData(self.model.mj)
        self.data.qpos[:] = self.model.home_qpos
        self._motion = motion_views(self.model.mj, self.data)
        self._sway = Sway(spec.sway, deployment.seed)
        self._sway_neutral_rad = self.data.qpos[self.model.sway_qpos_address]
        self._thickness_m = spec.foam.thickness_m
        self._body_temperature_c = self.model.temperature_c[self.surface.body_id]
        self._speed_limit_rad_s = self.model.speed_limit_rad_s
        self._position_rad: Floats = self.data.qpos[self.model.qpos_address]
        self._command_rad_s = self._velocity_rad_s = np.zeros(self.n_dofs)
        self._commanded_ns, self._commanded_rad = 0, self._position_rad
        self._stimulus_period_ns = spec.stimulus_period_ns
        self._previous_velocity_rad_s = np.zeros(self.n_dofs)
        self._moving = True
        self._stimulus = np.zeros((len(self.surface.body_id), len(STIMULUS_NAMES)))
        self._sample_stimulus()
        self.ground_truth()  # compiles what the end of a run needs

    @property
    def range_rad(self) -> NDArray[np.float64]:
        """Position limits (D, 2) of the controlled joints, infinite without a limit."""
        return self.model.range_rad

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self.model.joint_id)

    def set_command(self, velocity_rad_s: Sequence[float] | Floats) -> bool:
        """Set the velocity command (D,) [rad/s] from now on; return False if it is refused."""
        velocity = np.asarray(velocity_rad_s, dtype=np.float64)
        accepted = is_valid_command(velocity, self.n_dofs, self._speed_limit_rad_s)
        self._command_rad_s = velocity.copy() if accepted else np.zeros(self.n_dofs)
        self._commanded_ns, self._commanded_rad = self.t_ns, self._position_rad
        self._integrate()
        self.refused_commands += not accepted
        return accepted

    def begin_stage(self, name: str) -> None:
        """Begin stage `name`: peak forces are recorded by stage; the script depends on time only."""
        self.recorder.begin_stage(name)

    def advance(self, until_ns: int) -> None:
        """Advance to `until_ns` [ns]: move the joints within their limits, sample stimuli at each period."""
        while self.t_ns < until_ns:
            next_frame_ns = (self.t_ns // self._stimulus_period_ns + 1) * self._stimulus_period_ns
            self.t_ns = min(next_frame_ns, until_ns)
            self._integrate()
            if self.t_ns == next_frame_ns:
                self._sample_stimulus()

    def stimulus(self) -> Floats:
        """Stimulus of all cells at the last sample: (n_cells, 8) in `STIMULUS_NAMES` order, a copy."""
        return self._stimulus.copy()

    def pressures(self) -> NDArray[np.float64]:
        """Sheet pressures: none, (0,); a script does not press sheets."""
        return np.zeros(0)

    def joints(self) -> Floats:
        """Joint positions (D,) of the controlled joints now [rad], a copy."""
        return self._position_rad.copy()

    def free_bodies(self) -> dict[str, list[float]]:
        """Free-body poses: none, as contacts are prescribed."""
        return {}

    def ground_truth(self) -> GroundTruth:
        """Ground truth: threshold crossings, refused commands, peak forces, and the presses that began."""
        truth = self.recorder.ground_truth(self.refused_commands)
        presses = presses_before(self.press_schedule, self.t_ns)
        return GroundTruth(truth.facts, {"presses": presses} | truth.arrays)

    def _integrate(self) -> None:
        """Integrate the velocity command to the present time; a joint stops at its limit."""
        if not self._command_rad_s.any():
            self._velocity_rad_s = self._command_rad_s
            return
        wanted = self._commanded_rad + (self.t_ns - self._commanded_ns) / NS_PER_S * self._command_rad_s
        self._position_rad = np.clip(wanted, *self.model.range_rad.T)
        self._velocity_rad_s = np.where(wanted == self._position_rad, self._command_rad_s, 0.0)

    def _sample_stimulus(self) -> None:
        """Sample the stimulus of all cells at the present time."""
        self._update_accelerations()
        stimulus = self._stimulus
        active = write_press_stimulus(self.press_schedule, self.t_ns, self._body_temperature_c, stimulus) > 0
        force_n = stimulus[:, :N_FORCE_CHANNELS]
        recorder, period_ns = self.recorder, self._stimulus_period_ns
        recorder.crossings.observe_forces(self.t_ns, period_ns, force_n, active)
        recorder.record(self.t_ns, period_ns / NS_PER_S, float(force_n.max()) if active else 0.0)
        recorder.crossings.observe_stimulus(self.t_ns, stimulus)

    def _update_accelerations(self) -> None:
        """Compute accelerations of all cells, if the motion has changed."""
        velocity, before = self._velocity_rad_s, self._previous_velocity_rad_s
        moving = bool(self._sway.spec.joints or velocity.any() or before.any())
        if not moving and not self._moving:
            return
        self._moving, self._previous_velocity_rad_s = moving, velocity
        data, model = self.data, self.model
        data.qpos[model.qpos_address] = self._position_rad
        data.qpos[model.sway_qpos_address] = self._sway_neutral_rad + self._sway.offsets_rad(self.t_ns)
        change = (velocity - before) * (NS_PER_S / self._stimulus_period_ns)
        if model.mj.neq:
            model.follow(data.qpos)
            motion = model.motion_at(data.qpos)
            data.qvel[:], data.qacc[:] = matmul(velocity, motion), matmul(change, motion)
        else:
            data.qvel[model.dof_address], data.qacc[model.dof_address] = velocity, change
        mujoco.mj_kinematics(model.mj, data)
        mujoco.mj_comPos(model.mj, data)
        mujoco.mj_comVel(model.mj, data)
        mujoco.mj_rnePostConstraint(model.mj, data)
        _write_accelerations(self.surface, self._motion, data.cacc, self._thickness_m, self._stimulus)


@compiled
def _write_accelerations(
    surface: SkinSurface, motion: Motion, cacc: Floats, height_m: float, stimulus: Floats
) -> None:
    """Write the accelerations of all cells [m/s²] into `stimulus`."""
    for i in range(len(stimulus)):
        x, y, z = point_above_cell(surface, motion, i, height_m)
        write_proper_acceleration(surface, motion, cacc, i, x, y, z, stimulus)
