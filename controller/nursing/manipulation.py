"""Whole-body manipulation of one object: tactile feedback and trajectory generation per control period."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import InitialContacts, Region, Sheet, initial_contacts
from controller.nursing.contacts.contact_tracking import ContactTracker
from controller.nursing.contacts.tactile_feedback import Impedance, TactileFeedback
from controller.nursing.kinematics.joint_limits import JointLimits
from controller.nursing.kinematics.mobility import mobility
from controller.nursing.kinematics.robot_model import Kinematics
from controller.nursing.trajectory_generation import (
    Solver,
    TrajectoryGenerator,
    TrajectoryStep,
    Weights,
    closed_form,
    desired_contacts,
)
from skinnet.deployment.controller.nursing import ContactWeightSpec, ImpedanceSpec, NursingSpec
from skinnet.pinned_linalg import matmul

__all__ = ["Manipulation"]

Floats = NDArray[np.float64]


class Manipulation:
    """Contact manipulation: moves recorded contacts with the object, adjusted by tactile feedback."""

    def __init__(
        self,
        spec: NursingSpec,
        kinematics: Kinematics,
        sheets: Mapping[str, Sheet],
        regions: Sequence[Region],
        t_ns: int,
        q: Floats,
        period_s: float,
    ) -> None:
        """Record the initial contacts `regions` at `t_ns` with measured joint positions `q` (N,) [rad].

        Raises:
            ValueError: a region is outside its sheet, or at the object's centre with position feedback on.
        """
        self._spec = spec
        self.contacts: InitialContacts = initial_contacts(
            kinematics, q, sheets, regions, spec.object_centre_m
        )
        self.contact_tracker = ContactTracker(
            regions, t_ns, spec.contact_threshold_n, spec.association_distance_m
        )
        self.feedback = TactileFeedback(
            self.contacts,
            period_s,
            _impedance(spec.position_feedback) if spec.has_position_feedback else None,
            _impedance(spec.rotation_feedback) if spec.has_rotation_feedback else None,
        )
        n = len(kinematics)
        limits = JointLimits(
            kinematics.joint_range,
            np.full(n, spec.max_joint_speed_rad_s),
            np.full(n, spec.max_joint_acceleration_rad_s2 or np.inf),
        )
        of_contact = [_weights(spec, region.sheet, sheets[region.sheet].body) for region in regions]
        weights = Weights(
            np.array([weight.position for weight in of_contact]),
            np.array([weight.rotation for weight in of_contact]),
            np.full(n, spec.joint_weight),
        )
        self._position_weights = weights.position
        self.generator = TrajectoryGenerator(
            kinematics, self.contacts.points, weights, limits, q, period_s, _solver(spec, kinematics)
        )
        self._x_object_contact_m, self._R_object_contact = (
            self.contacts.x_object_contact_m,
            self.contacts.R_object_contact,
        )
        self._displacement_m, self._R_world_object = np.zeros(3), np.eye(3)

    @property
    def displacement_m(self) -> Floats:
        """Last commanded object displacement (3,) since the contacts were recorded, world frame [m]."""
        return self._displacement_m.copy()

    @property
    def mobility(self) -> float:
        """Mobility of the contacts in the present posture, 0 to 1 (see `mobility`)."""
        return mobility(self.generator.poses.J_x, self._position_weights, self._spec.mobility_lever_m)

    def update_feedback(self, t_ns: int, regions: Sequence[Region] | None) -> NDArray[np.bool_]:
        """Update tactile feedback with all regions (None without tactile input); return lost contacts (C,).

        A contact that is lost or without tactile input keeps its adjustment until it is measured again.
        """
        if regions is not None:
            self.contact_tracker.update(t_ns, regions)
        lost = self.contact_tracker.time_below_threshold_ns(t_ns) > self._spec.contact_timeout_ns
        felt = ~lost if regions is not None else np.zeros_like(lost)
        self.feedback.step(self.contact_tracker.force_n, self.contact_tracker.xi_m, felt)
        return lost

    def move(self, displacement_m: Floats, R_world_object: Floats) -> TrajectoryStep:
        """Compute the next step with the object displaced by (3,) [m] and rotated by (3, 3), world frame."""
        self._displacement_m, self._R_world_object = displacement_m, R_world_object
        return self.hold()

    def hold(self) -> TrajectoryStep:
        """Compute the next step with the object at its last commanded pose."""
        x_object, R_object = self.feedback.adjust(self._x_object_contact_m, self._R_object_contact)
        object_m = self.contacts.object_centre_m + self._displacement_m
        return self.generator.step(*desired_contacts(object_m, self._R_world_object, x_object, R_object))

    def rebase_contacts(self) -> None:
        """Record equation (3) again, so that the desired contact poses equal the present ones.

        From then on `hold` moves the joints by tactile feedback only: earlier tracking errors are dropped.
        """
        poses, R_object_world = self.generator.poses, self._R_world_object.T
        away_m = poses.position_m - (self.contacts.object_centre_m + self._displacement_m)
        self._x_object_contact_m, self._R_object_contact = self.feedback.invert_adjustment(
            matmul(away_m, R_object_world.T), matmul(R_object_world, poses.R_world_surface)
        )


def _weights(spec: NursingSpec, sheet: str, body: str) -> ContactWeightSpec:
    return spec.weights.get(sheet) or spec.weights.get(body) or ContactWeightSpec()


def _impedance(spec: ImpedanceSpec) -> Impedance:
    return Impedance(spec.inertia, spec.damping, spec.stiffness)


def _solver(spec: NursingSpec, kinematics: Kinematics) -> Solver:
    if spec.solver == "closed_form":
        return closed_form
    from controller.nursing.quadratic_programme import quadratic_programme  # optional dependency

    return quadratic_programme(kinematics)
