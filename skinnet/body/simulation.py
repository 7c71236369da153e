"""Body simulation: MuJoCo physics, skin contact, servos and teacher, without its process."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.actuation import Actuation
from skinnet.body.contact.contact_scene import build_contact_scene, motion_views
from skinnet.body.contact.sheet_foundation import SheetFoundation
from skinnet.body.contact.sheet_surface import sheet_surface
from skinnet.body.contact.skin_foundation import Foundation, compliant_layers, foam_from_spec
from skinnet.body.contact.skin_surface import SkinSurface, build_skin_surface
from skinnet.body.environment.free_bodies import FreeBodies
from skinnet.body.environment.payload import GripController, Payload
from skinnet.body.environment.stand import Stand
from skinnet.body.environment.stand_model import place_object
from skinnet.body.ground_truth.contact_onsets import PeakForceTrace, reaction_crossing_detector
from skinnet.body.ground_truth.grasp_outcome import GraspGroundTruth
from skinnet.body.model import equilibrium_targets_rad, load_model
from skinnet.body.plant import GroundTruth
from skinnet.body.stimulus import StimulusSampler
from skinnet.body.sway import Sway
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
        sheet_foundation: Elastic foundation of the sheets.
        actuation: Servos of the controlled joints.
        teacher: The teacher with its finger, and ground truth of its tasks.
        free_bodies: Method that returns the poses of the free bodies now, by name.
        payload: The payload in the robot's arms, if there is one.
        stand: The stand in front of the robot, if there is one.
        grasp_ground_truth: Ground truth of the grasp, if there is a stand.
        force_trace: Ground truth of the largest forces on force cells.
        crossings: Ground truth of crossings of the reaction thresholds of the program's stages.
    """

    def __init__(self, deployment: Deployment, base_dir: Path) -> None:
        """Build the simulation in the home configuration at time 0.

        Raises:
            ModelError: the model does not compile or lacks something.
            DeploymentError: the deployment contradicts itself or the model.
        """
        spec, teacher = deployment.body, deployment.teacher
        self.t_ns = 0
        self._placed_object = place_object(deployment)
        self.patches = [place_patch(patch, deployment.cells) for patch in deployment.patches]
        self.model = load_model(deployment, base_dir)
        self.surface = build_skin_surface(self.model.mj, self.patches, deployment.cells, spec.model)
        bounds = self.surface.patch_start.tolist()
        self.cells = {p.name: slice(bounds[i], bounds[i + 1]) for i, p in enumerate(self.patches)}

        self._step_ns, self._step_s = spec.timestep_ns, spec.timestep_ns / NS_PER_S
        self._sway = Sway(spec.sway, deployment.seed)
        self.data = self._home_data()
        resting_rad = equilibrium_targets_rad(self.data, self.model.sway_actuator_id)
        self._sway_neutral_rad = resting_rad - self._sway.offsets_rad(0)
        self.data.ctrl[self.model.sway_actuator_id] = resting_rad
        self.actuation = Actuation(self.model, self.data, spec.servo)
        self.sheets = place_sheets(deployment.surfaces, deployment.sheets)
        self._foundation = Foundation(**self._foundation_arguments(self.surface, deployment))
        on_sheets = sheet_surface(self.model.mj, self.sheets, spec.model)
        self.sheet_foundation = SheetFoundation(
            sheets=self.sheets, **self._foundation_arguments(on_sheets, deployment)
        )
        self._touch_specs = teacher.touches
        skin = TeacherSkin(self._foundation, self.cells, deployment.cells)
        self.teacher = Teacher(self.model, self.data, skin, teacher, spec.model)
        reach_m = _RANGE_FACTOR * deployment.cells.proximity.range_m
        self._sampler = StimulusSampler(self.model.mj, self.data, self._foundation, reach_m)
        self.crossings = reaction_crossing_detector(deployment.controller.stages.values(), deployment.cells)
        self.force_trace = PeakForceTrace(spec.joint_state_period_ns)
        self.free_bodies = FreeBodies(self.data).poses
        self._evaluated = self._recorded = False
        self._stimulus: NDArray[np.float64] | None = None
        self.stand: Stand | None = None
        self.grasp_ground_truth: GraspGroundTruth | None = None
        if self._placed_object is not None:
            self.stand = Stand(self.data, self._placed_object.stand)
            pressed = self._foundation.contact
            self.grasp_ground_truth = GraspGroundTruth(
                self.data, self._placed_object, self.stand, pressed, spec.joint_state_period_ns
            )
            self._compute_contact()
            self.grasp_ground_truth.require_clear()
        self.payload: Payload | None = None
        if deployment.payload is not None:
            self.payload = Payload(
                self.data, deployment.payload, self.sheet_foundation.contact, spec.joint_state_period_ns
            )
            self._close_grip(
                GripController(self.model, spec.joints, deployment.payload, self._step_s), self.payload
            )

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""
        return len(self.model.joint_id)

    @property
    def thickness_m(self) -> float:
        """Foam thickness between the rigid surface and the outer face [m]."""
        return self._foundation.foam.thickness_m

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
        return self.actuation.command(velocity_rad_s)

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self.teacher.begin_stage(name, self.t_ns)
        self.force_trace.begin_stage(name)
        if self.stand is not None and self.grasp_ground_truth is not None:
            self.stand.begin_stage(name, self.t_ns)
            self.grasp_ground_truth.begin_stage(name)
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
        if not np.isfinite(self.data.qacc).all() or not np.isfinite(self.data.qpos).all():
            raise ModelError(
                f"the simulation became unstable before t = {self.t_ns / NS_PER_S:.3f} s; "
                "take a shorter body.timestep_ms, softer servos or softer foam"
            )

    def stimulus(self) -> NDArray[np.float64]:
        """Stimulus of all cells now: (n_cells, 8) in `STIMULUS_NAMES` order, a copy."""
        if self._stimulus is None:
            self._evaluate()
            self._stimulus = self._sampler.sample()
            self.crossings.observe_stimulus(self.t_ns, self._stimulus)
        return self._stimulus.copy()

    def pressures(self) -> NDArray[np.float64]:
        """Sheet pressures (n_elements,) on all elements now [kPa], a copy."""
        self._evaluate()
        return self.sheet_foundation.pressure_kpa()

    def joints(self) -> NDArray[np.float64]:
        """Joint positions (D,) of the controlled joints now [rad], a copy."""
        positions: NDArray[np.float64] = self.data.qpos[self.model.qpos_address]
        return positions

    def ground_truth(self) -> GroundTruth:
        """Ground truth: teacher's tasks, threshold crossings, refused commands, forces, motion of objects."""
        self._evaluate()
        self._record_ground_truth()
        facts = {
            "touches": [touch.facts(self._touch_specs) for touch in self.teacher.touches],
            "lessons": [asdict(lesson) for lesson in self.teacher.lessons],
            "strokes": [asdict(stroke) for stroke in self.teacher.strokes],
            "threshold_crossings": self.crossings.facts(),
            "refused_commands": self.actuation.refused_commands,
            "peak_force_by_stage_n": self.force_trace.by_stage_n,
        }
        arrays = self.force_trace.arrays()
        if self.payload is not None:
            facts["payload"] = self.payload.facts()
            arrays |= self.payload.arrays()
        if self.grasp_ground_truth is not None:
            facts |= self.grasp_ground_truth.facts()
            arrays |= self.grasp_ground_truth.arrays()
        return GroundTruth(facts, arrays)

    def _home_data(self) -> mujoco.MjData:
        data = mujoco.MjData(self.model.mj)
        data.qpos[:] = self.model.home_qpos
        data.qpos[self.model.sway_qpos_address] += self._sway.offsets_rad(0)
        mujoco.mj_forward(self.model.mj, data)
        return data

    def _foundation_arguments(self, surface: SkinSurface, deployment: Deployment) -> dict[str, Any]:
        """Arguments of a foundation over `surface`."""
        mj = self.model.mj
        return {
            "surface": surface,
            "scene": build_contact_scene(mj, surface, compliant_layers(mj, deployment)),
            "foam": foam_from_spec(deployment.body.foam),
            "motion": motion_views(mj, self.data),
            "temperature_c": self.model.temperature_c,
            "applied_wrench": self.data.xfrc_applied,
        }

    def _close_grip(self, closing: GripController, payload: Payload) -> None:
        """Close the arms on the payload, before time zero."""
        while True:
            self._compute_contact()
            speeds_rad_s = closing.closing_velocity_rad_s(self.sheet_foundation.body_force_n())
            self.actuation.command(np.zeros(self.n_dofs) if speeds_rad_s is None else speeds_rad_s)
            if speeds_rad_s is None:
                break
            self._accelerate()
            mujoco.mj_implicit(self.model.mj, self.data)
            self.actuation.advance(self._step_s)
            payload.fix_pose()
        self.data.time = 0.0
        payload.update(0)

    def _compute_contact(self) -> None:
        """Compute poses, velocities and skin contact forces at the present state."""
        mujoco.mj_fwdPosition(self.model.mj, self.data)
        mujoco.mj_fwdVelocity(self.model.mj, self.data)
        self.teacher.write_finger_velocity()
        self.data.xfrc_applied[:] = 0.0
        self._foundation.compute_contact(self._step_s)
        self.sheet_foundation.compute_contact(self._step_s)

    def _accelerate(self) -> None:
        """Compute accelerations at the present state, after `_compute_contact`."""
        mujoco.mj_fwdActuation(self.model.mj, self.data)
        mujoco.mj_fwdAcceleration(self.model.mj, self.data)
        mujoco.mj_fwdConstraint(self.model.mj, self.data)

    def _evaluate(self) -> None:
        """Evaluate poses, contact forces and accelerations at the present time, at most once per step."""
        if self._evaluated:
            return
        self._compute_contact()
        force_n, touching = self._foundation.contact.force_n, self._foundation.n_in_contact > 0
        self.crossings.observe_forces(self.t_ns, self._step_ns, force_n, touching)
        self._accelerate()
        self._evaluated = True

    def _record_ground_truth(self) -> None:
        """Record ground truth at the present time under the active stage, at most once per step."""
        if self._recorded:
            return
        self.force_trace.observe(self.t_ns, float(self._foundation.contact.peak_force_n[0]))
        if self.grasp_ground_truth is not None:
            self.grasp_ground_truth.record(self.t_ns, self._step_s)
        self._recorded = True

    def _integrate(self) -> None:
        """Integrate one physics step under the active command."""
        self._record_ground_truth()
        next_ns = self.t_ns + self._step_ns
        self.teacher.step(self.t_ns, self._step_ns)
        mujoco.mj_implicit(self.model.mj, self.data)
        self.actuation.advance(self._step_s)
        self.data.ctrl[self.model.sway_actuator_id] = self._sway_neutral_rad + self._sway.offsets_rad(next_ns)
        self.t_ns = next_ns
        if self.payload is not None:
            self.payload.update(next_ns)
        if self.stand is not None:
            self.stand.step(next_ns, self._step_s)
        self._evaluated = self._recorded = False
        self._stimulus = None
