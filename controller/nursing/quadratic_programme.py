"""Quadratic-programme solver of the trajectory step, exact at the limits (mink and DAQP).

mink assembles contact tasks, damping and limits, and DAQP solves the programme. Other mink tasks and limits,
such as a posture task or collision avoidance, could be added.
"""

import mink
import numpy as np
import qpsolvers
from numpy.typing import NDArray

from controller.nursing.kinematics.robot_model import Kinematics
from controller.nursing.trajectory_generation import LeastSquaresProblem, Solver

__all__ = ["quadratic_programme"]

Floats = NDArray[np.float64]


class _ContactTask(mink.Task):
    """Contact task: the rows of the least-squares problem on all degrees of freedom of the model."""

    def __init__(self, problem: LeastSquaresProblem, dofs: NDArray[np.int64], nv: int) -> None:
        super().__init__(cost=np.sqrt(problem.weight))
        self._error = problem.error
        self._jacobian = np.zeros((len(problem.error), nv))
        self._jacobian[:, dofs] = problem.jacobian

    def compute_error(self, configuration: mink.Configuration) -> Floats:
        return self._error

    def compute_jacobian(self, configuration: mink.Configuration) -> Floats:
        return self._jacobian


class _StepLimit(mink.Limit):
    """Bounds on the step Δq from position, velocity and acceleration limits."""

    def __init__(self, step_bounds: tuple[Floats, Floats], dofs: NDArray[np.int64], nv: int) -> None:
        smallest, largest = step_bounds
        select = np.zeros((len(dofs), nv))
        select[np.arange(len(dofs)), dofs] = 1.0
        sides = np.concatenate((select, -select))
        bounds = np.concatenate((largest, -smallest))
        limited = np.isfinite(bounds)
        self._constraint = mink.Constraint(sides[limited], bounds[limited])

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        return self._constraint


def quadratic_programme(kinematics: Kinematics) -> Solver:
    """Return a solver for the joints of `kinematics`; all others are frozen.

    The returned function raises `mink.NoSolutionFound` if DAQP fails; since the bounds are never empty and
    the damping is positive, that would be a bug.
    """
    nv, dofs = int(kinematics.mj.nv), kinematics.dofs
    configuration = mink.Configuration(kinematics.mj)
    others = sorted(set(range(nv)) - set(dofs.tolist()))
    frozen = [mink.DofFreezingTask(kinematics.mj, others)] if others else []

    def solve(problem: LeastSquaresProblem, steps: tuple[Floats, Floats]) -> Floats:
        damping = np.ones(nv)
        damping[dofs] = np.sqrt(problem.damping)
        programme = mink.build_ik(
            configuration,
            [_ContactTask(problem, dofs, nv), mink.DampingTask(kinematics.mj, damping)],
            dt=1.0,  # used only by mink's own limits and tasks
            limits=[_StepLimit(steps, dofs, nv)],
            constraints=frozen,
        )
        solution = qpsolvers.solve_problem(programme, solver="daqp")
        if not solution.found or solution.x is None:
            raise mink.NoSolutionFound("daqp")
        # DAQP satisfies the bounds up to a tolerance
        step: Floats = np.clip(solution.x[dofs], *steps)
        return step

    return solve
