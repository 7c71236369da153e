"""Body simulation: MuJoCo physics, skin contact, servos and teacher, without its process."""

import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.actuation import Actuation
from skinnet.body.contact.contact_margins import clear_contact_margins
from skinnet.body.contact.sheet_foundation import SheetFoundation, sheet_surface
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.contact.skin_surface import build_skin_surface, rows_by_patch
from skinnet.body.dynamics import Dynamics
from skinnet.body.environment.free_bodies import FreeBodies
from skinnet.body.environment.grip import GripController, close_grip
from skinnet.body.environment.payload import Payload
from skinnet.body.environment.stand import Stand
from skinnet.body.environment.stand_model import place_object
from skinnet.body.ground_truth.grasp_outcome import GraspGroundTruth
from skinnet.body.ground_truth.payload_outcome import PayloadGroundTruth
from skinnet.body.ground_truth.recorder import GroundTruthRecorder
from skinnet.body.ground_truth.unsensed_force import UnsensedForce
from skinnet.body.model import BodyModel, load_model
from skinnet.body.plant import GroundTruth
from skinnet.body.proximity.field_of_view import FieldOfView
from skinnet.body.stimulus import StimulusSampler
from skinnet.body.sway import Sway, SwayActuation
from skinnet.body.teacher.teacher import Teacher, TeacherSkin
from skinnet.clock import NS_PER_S
from skinnet.deployment.deployment import Deployment
from skinnet.errors import ModelError
from skinnet.skin.placement import place_patch
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["BodySimulation"]

_RANGE_FACTOR = 1.5
"""Ratio of simulated to nominal proximity range: the sensor law is smooth beyond its nominal range."""


class BodySimulation:
    """Simulation of a robot with skin, its teacher and its environment.

    Deterministic in the deployment, its seed and the sequence of commands and stages; reading stimulus,
    pressures and joints has no side effect.

    Attributes:
        t_ns: Present time [ns].
        model: The compiled model.
        data: MuJoCo's state; read-only for callers.
        patches: The placed cells of each patch.
        surface: All cells, on the bodies that carry them.
        cells: Rows of each patch's cells in the stimulus, by the name of the patch.
        sheets: The tactile sheets with their elements, in the order of the deployment.
        cell_foundation: Elastic foundation of the cells.
        sheet_foundation: Elastic foundation of the sheets.
        actuation: Servos of the controlled joints.
        teacher: The teacher with its finger.
        payload: The payload in the robot's arms, if there is one.
        stand: The stand in front of the robot, if there is one.
        dynamics: Contact, accelerations and integration of one step.
        unsensed_force: Load on the rigid shell under skin.
        recorder: Ground truth of all of these.
    """

    def __init__(self, deployment: Deployment, base_dir: Path) -> None:
        """Build the simulation in the home configuration at time 0.

        Raises:
            ModelError: the model does not compile or lacks something.
            DeploymentError: the deployment contradicts itself or the model.
        """
        spec = deployment.body
        self.t_ns, self._step_ns = 0, spec.timestep_ns
        self.patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
        self.sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self.cells = rows_by_patch(self.patches)
        self.model = load_model(deployment, base_dir)
        self.surface = build_skin_surface(self.model.mj, self.patches, deployment.cells, spec.model)
        on_sheets = sheet_surface(self.model.mj, self.sheets, spec.model)
        skinned = np.concatenate([self.surface.patch_body_id, on_sheets.patch_body_id])
        clear_contact_margins(self.model.mj, skinned)

        sway = Sway(spec.sway, deployment.seed)
        self.data = _home_data(self.model, sway)
        self._sway = SwayActuation(sway, self.model, self.data)
        self.actuation = Actuation(self.model, self.data, bool(spec.servo.gravity_compensation))
        self.cell_foundation = Foundation.build(self.surface, self.model, self.data, deployment)
        self.sheet_foundation = SheetFoundation.build(on_sheets, self.model, self.data, deployment)
        skin = TeacherSkin(self.cell_foundation, self.cells, deployment.cells)
        self.teacher = Teacher(self.model, self.data, skin, deployment.teacher, spec.model)
        self.dynamics = Dynamics(
            self.model,
            self.data,
            spec.timestep_ns / NS_PER_S,
            self.actuation,
            (self.cell_foundation, self.sheet_foundation),
            self.teacher.finger,
        )
        self._free_bodies = FreeBodies(self.data)
        proximity = deployment.cells.proximity
        view = FieldOfView.build(
            self.model.mj,
            self.cell_foundation.scene,
            _RANGE_FACTOR * proximity.range_m,
            math.radians(proximity.half_angle_deg),
        )
        self._sampler = StimulusSampler(self.model.mj, self.dynamics, view)
        self._evaluated = self._recorded = False
        self._stimulus: NDArray[np.float64] | None = None
        self.stand, grasp = self._build_stand(deployment)
        self.payload, carried = self._build_payload(deployment)
        self.unsensed_force = UnsensedForce(self.model.mj, (self.surface, on_sheets), spec.foam.thickness_m)
        self.recorder = GroundTruthRecorder(
            deployment,
            spec.joint_state_period_ns,
            teaching=self.teacher.outcome,
            grasp=grasp,
            payload=carried,
            unsensed=self.unsensed_force,
        )

    def _build_stand(self, deployment: Deployment) -> tuple[Stand | None, GraspGroundTruth | None]:
        """Build the stand and ground truth of the grasp, if the deployment has a stand.

        Raises:
            DeploymentError: object or stand touch the robot.
        """
        placed_object = place_object(deployment)
        if placed_object is None:
            return None, None
        stand, contact = Stand(self.data, placed_object.stand), self.cell_foundation.contact
        grasp = GraspGroundTruth(
            self.data, placed_object, stand, contact, deployment.body.joint_state_period_ns
        )
        self.dynamics.compute_contact()
        grasp.require_clear()
        return stand, grasp

    def _build_payload(self, deployment: Deployment) -> tuple[Payload | None, PayloadGroundTruth | None]:
        """Build the payload in the closed arms and its ground truth, if the deployment has a payload.

        Raises:
            DeploymentError: the arms do not close on it.
        """
        spec = deployment.payload
        if spec is None:
            return None, None
        payload = Payload(self.data, spec, self.dynamics.step_s)
        period_ns = deployment.body.joint_state_period_ns
        truth = PayloadGroundTruth(self.data, payload, self.sheet_foundation, spec, period_ns)
        joints, step_s = deployment.body.joints, self.dynamics.step_s
        close_grip(self.dynamics, GripController(self.model, joints, spec, step_s), payload)
        payload.update(0)
        truth.record(0)
        return payload, truth

    @property
    def range_rad(self) -> NDArray[np.float64]:
        """Position limits (D, 2) of the controlled joints, infinite without a limit."""
        return self.model.range_rad

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self.model.joint_id)

    @property
    def thickness_m(self) -> float:
        """Foam thickness between the rigid surface and the outer face [m]."""
        return self.cell_foundation.foam.thickness_m

    @property
    def n_cells(self) -> int:
        """Number of cells of all patches."""
        return len(self.surface.body_id)

    @property
    def n_elements(self) -> int:
        """Number of elements of all sheets."""
        return self.sheet_foundation.n_elements

    def set_command(self, velocity_rad_s: Sequence[float] | NDArray[np.float64]) -> bool:
        """Set the velocity command (D,) [rad/s] from now on; return False if it is refused."""
        accepted = self.actuation.command(velocity_rad_s)
        self.recorder.motion.begin_command(self.t_ns, self.actuation.velocity_rad_s, self._joint_velocity())
        return accepted

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self.teacher.begin_stage(name, self.t_ns)
        self.recorder.begin_stage(name)
        if self.stand is not None:
            self.stand.begin_stage(name, self.t_ns)
        if self.payload is not None:
            self.payload.begin_stage(name, self.t_ns)

    def advance(self, until_ns: int) -> None:
        """Advance to `until_ns` [ns], a whole number of physics steps away.

        Raises:
            ModelError: the simulation became unstable.
        """
        assert (until_ns - self.t_ns) % self._step_ns == 0
        while self.t_ns < until_ns:
            self._evaluate()
            self._integrate()
        if not self.dynamics.is_finite:
            raise ModelError(
                f"the simulation became unstable before t = {self.t_ns / NS_PER_S:.3f} s; "
                "take a shorter body.timestep_ms, softer servos or softer foam"
            )

    def stimulus(self) -> NDArray[np.float64]:
        """Stimulus of all cells now: (n_cells, 8) in `STIMULUS_NAMES` order, a copy."""
        if self._stimulus is None:
            self._evaluate()
            self._stimulus = self._sampler.sample()
            self.recorder.crossings.observe_stimulus(self.t_ns, self._stimulus)
        return self._stimulus.copy()

    def pressures(self) -> NDArray[np.float64]:
        """Sheet pressures (n_elements,) on all elements now [kPa], a copy."""
        self._evaluate()
        return self.sheet_foundation.pressure_kpa()

    def joints(self) -> NDArray[np.float64]:
        """Joint positions (D,) of the controlled joints now [rad], a copy."""
        positions: NDArray[np.float64] = self.data.qpos[self.model.qpos_address]
        return positions

    def free_bodies(self) -> dict[str, list[float]]:
        """Free-body poses now: position [m] and quaternion (w, x, y, z), world, by name."""
        return self._free_bodies.poses()

    def ground_truth(self) -> GroundTruth:
        """Ground truth: teacher's tasks, threshold crossings, refused commands, forces, motion of objects."""
        self._evaluate()
        self._record()
        return self.recorder.ground_truth(self.actuation.refused_commands)

    def _joint_velocity(self) -> NDArray[np.float64]:
        velocity_rad_s: NDArray[np.float64] = self.data.qvel[self.model.dof_address]
        return velocity_rad_s

    def _evaluate(self) -> None:
        """Evaluate poses, contact forces and accelerations at the present time, at most once per step."""
        if self._evaluated:
            return
        self.dynamics.compute_contact()
        force_n, touching = self.cell_foundation.contact.force_n, self.cell_foundation.n_in_contact > 0
        self.recorder.crossings.observe_forces(self.t_ns, self._step_ns, force_n, touching)
        self.dynamics.compute_accelerations()
        self._evaluated = True

    def _record(self) -> None:
        """Record ground truth at the present time under the active stage, at most once per step."""
        if not self._recorded:
            peak_force_n = float(self.cell_foundation.contact.peak_force_n[0])
            self.unsensed_force.observe(self.data)
            self.recorder.record(self.t_ns, self.dynamics.step_s, peak_force_n)
            self._recorded = True

    def _integrate(self) -> None:
        """Integrate one physics step under the active command."""
        self._record()
        self.teacher.step(self.t_ns, self._step_ns)
        self.dynamics.integrate()
        self.t_ns += self._step_ns
        motion = self.recorder.motion
        if motion.is_pending and motion.observe(self.t_ns, self._step_ns, self._joint_velocity()):
            self.teacher.record_motion_onset()
        self._sway.advance(self.t_ns)
        if self.payload is not None and self.recorder.payload is not None:
            self.payload.update(self.t_ns)
            self.recorder.payload.record(self.t_ns)
        if self.stand is not None:
            self.stand.step(self.t_ns, self.dynamics.step_s)
        self._evaluated = self._recorded = False
        self._stimulus = None


def _home_data(model: BodyModel, sway: Sway) -> mujoco.MjData:
    """State of `model` in its home configuration, swayed as at time zero."""
    data = mujoco.MjData(model.mj)
    data.qpos[:] = model.home_qpos
    data.qpos[model.sway_qpos_address] += sway.offsets_rad(0)
    mujoco.mj_forward(model.mj, data)
    return data
