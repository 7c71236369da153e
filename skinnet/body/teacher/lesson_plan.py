"""Lesson planning: joint motion to induce at each cell so that the goals are reached."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import BodyModel, require_body_id
from skinnet.deployment.environment.teacher import GoalSpec
from skinnet.pinned_least_squares import non_negative_least_squares

__all__ = ["PositionGoals", "plan_motions_rad"]

Floats = NDArray[np.float64]

_REGULARISATION_M_PER_RAD = 0.02
"""Regularisation weight [m/rad] of the total joint motion: prefers the shorter solution (assumed)."""


class PositionGoals:
    """Position goals of a lesson: points of the robot and their target positions."""

    def __init__(
        self, model: BodyModel, data: mujoco.MjData, specs: Sequence[GoalSpec], key: str, source: Path | str
    ) -> None:
        """Resolve the bodies of the goals.

        Args:
            model: The robot model.
            data: MuJoCo's state.
            specs: Goals of the lesson.
            key: Key of the lesson in the deployment, for error messages.
            source: Model file, for error messages.

        Raises:
            ModelError: a goal names a body that the model does not have.
        """
        self._model, self._data = model, data
        self._body_id = [
            require_body_id(model.mj, goal.body, f"{key}.goals[{i}].body", source)
            for i, goal in enumerate(specs)
        ]
        self._point_m = np.array([goal.point_m for goal in specs], dtype=np.float64)
        self._target_m = np.array([goal.position_m for goal in specs], dtype=np.float64)
        self._root_weight = np.sqrt([goal.weight for goal in specs])

    def error_m(self) -> Floats:
        """Position errors (G,): distance of each point from its target [m]."""
        error_m: Floats = np.linalg.norm(self._error_vectors_m(), axis=1)
        return error_m

    def plan_motions_rad(self, directions: Floats) -> Floats:
        """Planned motions (r,) [rad] along each of `directions` (r, D); see `plan_motions_rad`."""
        root = self._root_weight[:, None]
        way_m, jacobian_m = root * self._error_vectors_m(), root[:, :, None] * self._jacobian_m()
        return plan_motions_rad(way_m.ravel(), np.concatenate(jacobian_m), directions)

    def _points_m(self) -> Floats:
        R_world_body = self._data.xmat[self._body_id].reshape(-1, 3, 3)
        points_m: Floats = self._data.xpos[self._body_id] + np.einsum(
            "gij,gj->gi", R_world_body, self._point_m
        )
        return points_m

    def _error_vectors_m(self) -> Floats:
        """Position error vectors (G, 3) from each point to its target, world [m]."""
        return self._target_m - self._points_m()

    def _jacobian_m(self) -> Floats:
        """Linear Jacobian (G, 3, D) of the points, world [m/rad]."""
        mj, linear = self._model.mj, np.empty((len(self._body_id), 3, self._model.mj.nv))
        for row, body, point_m in zip(linear, self._body_id, self._points_m(), strict=True):
            mujoco.mj_jac(mj, self._data, row, None, point_m, body)
        return self._model.by_joint(linear, self._data.qpos)


def plan_motions_rad(error_m: Floats, jacobian_m: Floats, directions: Floats) -> Floats:
    """Plan motions α (r,) ≥ 0 of cells by non-negative least squares: min |J Wᵀ α − e|² + (c Σ α)².

    Cells evade and never pull, hence α ≥ 0. One cell's motion may compensate the side effects of another's,
    so all cells are planned jointly. The ℓ1 regularisation keeps the solution sparse.

    Args:
        error_m: Error e (m,) [m].
        jacobian_m: Jacobian J (m, D) [m/rad].
        directions: Joint directions W (r, D), rows of norm one or less.
    """
    effect = np.einsum("md,rd->mr", jacobian_m, directions)
    effort = np.full((1, len(directions)), _REGULARISATION_M_PER_RAD)
    return non_negative_least_squares(np.vstack([effect, effort]), np.append(error_m, 0.0))
