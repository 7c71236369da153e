"""Joint trajectory generation that maintains the initial contacts, equations (4) to (18) [R11].

Two corrections to the paper. (13) lacks the 1/Δt² of (18); (18) is used. (16) and (17) equal nᵀ J_ω, with n
the axis of the rotation from the desired frame to the present one; that form is used, since it is singular
only at θ = 0, where the term is left out, as the paper proposes.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.kinematics.joint_limits import JointLimits
from controller.nursing.kinematics.robot_model import Kinematics, Poses, SurfacePoint
from skinnet.pinned_linalg import dot, matmul, solve
from skinnet.pinned_rotations import rotation_vectors

__all__ = [
    "Deviations",
    "LeastSquaresProblem",
    "Solver",
    "TrajectoryGenerator",
    "TrajectoryStep",
    "Weights",
    "closed_form",
    "desired_contacts",
    "deviations",
]

_MIN_ROTATION_RAD = 1e-9
"""Rotation angle [rad] below which the axis is dominated by rounding and the term is left out."""

Floats = NDArray[np.float64]


class Weights(NamedTuple):
    """Weights of the evaluation function (6) [R11], all above zero."""

    position: Floats
    """Position weights w_c^x (C,) [1/m²]."""
    rotation: Floats
    """Rotation weights w_c^R (C,) [1/rad²]."""
    joint: Floats
    """Joint weights w_q,i (N,) [s²/rad²]."""


class Deviations(NamedTuple):
    """Contact deviations of C contacts from their desired poses, equations (7) and (9) [R11]."""

    position_m: Floats
    """Position deviations d_c (C,) [m]."""
    rotation_rad: Floats
    """Rotation deviations θ_c (C,), 0 to π [rad]."""


class LeastSquaresProblem(NamedTuple):
    """Least-squares problem min ½ Σ weight · (rows Δq + error)² + ½ Σ damping · Δq², (11) to first order."""

    jacobian: Floats
    """Jacobian rows (m, N)."""
    error: Floats
    """Task errors (m,) [m, rad]."""
    weight: Floats
    """Task weights (m,) [1/m², 1/rad²]."""
    damping: Floats
    """Damping w_q / Δt² (N,) [1/rad²]."""


Solver = Callable[[LeastSquaresProblem, tuple[Floats, Floats]], Floats]
"""Solver of a least-squares problem: step Δq (N,) within the smallest and largest steps (N,)."""


class TrajectoryStep(NamedTuple):
    """Trajectory step of one control period."""

    velocity: Floats
    """Joint velocities (N,) [rad/s]."""
    deviations: Deviations
    """Deviations after the step."""
    evaluation: float
    """Evaluation function E, equation (6)."""


def desired_contacts(
    object_position_m: Floats, R_object: Floats, x_object_contact_m: Floats, R_object_contact: Floats
) -> tuple[Floats, Floats]:
    """Return x_c^d (C, 3) [m] and R_c^d (C, 3, 3) for an object pose (3,), (3, 3), equations (4) and (5)."""
    return object_position_m + matmul(x_object_contact_m, R_object.T), matmul(R_object, R_object_contact)


def deviations(poses: Poses, desired_m: Floats, R_desired: Floats) -> tuple[Deviations, Floats]:
    """Compute deviations from the desired poses, and axes n (C, 3) of the rotation errors, world frame.

    Equations (7) to (9) [R11]; n is the axis of the rotation from the desired to the present frame. The angle
    is the norm of the rotation vector: cos⁻¹ of (8) loses half of the digits near zero.
    """
    turned = rotation_vectors(matmul(poses.R_world_surface, R_desired.transpose(0, 2, 1)))
    angle_rad = np.linalg.norm(turned, axis=1)
    axis = turned / np.where(angle_rad > 0.0, angle_rad, 1.0)[:, None]
    return Deviations(np.linalg.norm(poses.position_m - desired_m, axis=1), angle_rad), axis


def closed_form(problem: LeastSquaresProblem, step_bounds: tuple[Floats, Floats]) -> Floats:
    """Solve equation (18) [R11] within bounds: clamp joints beyond a bound and solve for the others again.

    Repeats until no joint is beyond its bounds, at most N times. The result is the minimum unless a clamped
    joint should become free again; `quadratic_programme` solves that case exactly.
    """
    weighted = problem.jacobian * problem.weight[:, None]
    hessian = matmul(weighted.T, problem.jacobian) + np.diag(problem.damping)
    gradient = matmul(weighted.T, problem.error)
    smallest, largest = step_bounds
    free = np.ones(len(gradient), dtype=np.bool_)
    step = np.zeros(len(gradient))
    while free.any():
        pull = gradient[free] + matmul(hessian[np.ix_(free, ~free)], step[~free])
        step[free] = -solve(hessian[np.ix_(free, free)], pull)
        beyond = free & ((step < smallest) | (step > largest))
        if not beyond.any():
            break
        step[beyond] = np.clip(step, smallest, largest)[beyond]
        free &= ~beyond
    return step


class TrajectoryGenerator:
    """Trajectory generator from desired contact poses, integrated from its own joint angles, (10) [R11]."""

    def __init__(
        self,
        kinematics: Kinematics,
        points: Sequence[SurfacePoint],
        weights: Weights,
        limits: JointLimits,
        q: Floats,
        period_s: float,
        solver: Solver = closed_form,
    ) -> None:
        """Start at rest at `q` (N,) [rad].

        Raises:
            ValueError: a weight is not above zero, or their number is not that of contacts or joints.
        """
        due = Weights(np.ones(len(points)), np.ones(len(points)), np.ones(len(kinematics)))
        for name, given, shape in zip(Weights._fields, weights, due, strict=True):
            if given.shape != shape.shape or not ((given > 0.0) & np.isfinite(given)).all():
                raise ValueError(
                    f"{name} weights {given.tolist()}: {len(shape)} finite numbers above zero are expected"
                )
        self._kinematics, self._points, self._weights = kinematics, tuple(points), weights
        self._limits, self._period_s, self._solver = limits, period_s, solver
        self._last_step = np.zeros(len(q))
        self._q = q.copy()
        self._poses = kinematics.surface_poses(q, self._points)

    @property
    def q(self) -> Floats:
        """Joint angles (N,) of the trajectory at the last step [rad]."""
        return self._q.copy()

    @property
    def poses(self) -> Poses:
        """Contact poses at these joint angles."""
        return self._poses

    def step(self, desired_m: Floats, R_desired: Floats) -> TrajectoryStep:
        """Compute the next step towards contact positions (C, 3) [m] and rotations (C, 3, 3), world frame."""
        problem = self._problem(desired_m, R_desired)
        step = self._solver(problem, self._limits.step_bounds(self._q, self._last_step, self._period_s))
        self._q, self._last_step = self._q + step, step
        self._poses = self._kinematics.surface_poses(self._q, self._points)
        after, _ = deviations(self._poses, desired_m, R_desired)
        velocity = step / self._period_s
        weights = self._weights
        evaluation = 0.5 * (
            dot(weights.position, after.position_m * after.position_m)
            + dot(weights.rotation, after.rotation_rad * after.rotation_rad)
            + dot(weights.joint, velocity * velocity)
        )
        return TrajectoryStep(velocity, after, evaluation)

    def _problem(self, desired_m: Floats, R_desired: Floats) -> LeastSquaresProblem:
        """Assemble the rows of (13), with the rotation of a contact as one row h'_c."""
        before, axis = deviations(self._poses, desired_m, R_desired)
        turned = before.rotation_rad > _MIN_ROTATION_RAD
        return LeastSquaresProblem(
            jacobian=np.concatenate(
                (
                    self._poses.J_x.reshape(-1, len(self._q)),
                    np.einsum("ci,cin->cn", axis[turned], self._poses.J_w[turned]),
                )
            ),
            error=np.concatenate(((self._poses.position_m - desired_m).ravel(), before.rotation_rad[turned])),
            weight=np.concatenate((np.repeat(self._weights.position, 3), self._weights.rotation[turned])),
            damping=self._weights.joint / (self._period_s * self._period_s),
        )
