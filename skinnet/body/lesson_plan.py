"""What a teacher plans: which cells to come near to, for how much motion, to reach the goals."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from skinnet.body.model import BodyModel, require_body
from skinnet.deployment.teacher import GoalSpec

__all__ = ["Goals", "motions_rad"]

Floats = NDArray[np.float64]

_EFFORT_M_PER_RAD = 0.02
"""Motion of the joints that brings the goals less far than this is not worth its while: of two ways the
shorter one is taken (assumed)."""


class Goals:
    """Points of the robot and where they should be."""

    def __init__(
        self, model: BodyModel, data: mujoco.MjData, specs: Sequence[GoalSpec], key: str, source: Path | str
    ) -> None:
        """Finds the bodies.

        Args:
            model: The robot.
            data: Its state.
            specs: Goals of the lesson.
            key: Where they stand in the deployment.
            source: Where the model comes from.

        Raises:
            ModelError: there is no such body.
        """
        self._model, self._data = model, data
        self._body = [
            require_body(model.mj, goal.body, f"{key}.goals[{i}].body", source)
            for i, goal in enumerate(specs)
        ]
        self._point_m = np.array([goal.point_m for goal in specs], dtype=np.float64)
        self._at_m = np.array([goal.at_m for goal in specs], dtype=np.float64)
        self._root_weight = np.sqrt([goal.weight for goal in specs])

    def error_m(self) -> Floats:
        """(G,) distance of each point from its place [m]."""
        error_m: Floats = np.linalg.norm(self._way_m(), axis=1)
        return error_m

    def motions_rad(self, directions: Floats) -> Floats:
        """(r,) how far the joints should move in each of `directions` (r, D) [rad]; see `motions_rad`."""
        root = self._root_weight[:, None]
        way_m, jacobian_m = root * self._way_m(), root[:, :, None] * self._jacobian_m()
        return motions_rad(way_m.ravel(), np.concatenate(jacobian_m), directions)

    def _points_m(self) -> Floats:
        R_world_body = self._data.xmat[self._body].reshape(-1, 3, 3)
        points_m: Floats = self._data.xpos[self._body] + np.einsum("gij,gj->gi", R_world_body, self._point_m)
        return points_m

    def _way_m(self) -> Floats:
        """(G, 3) from each point to its place [m]."""
        return self._at_m - self._points_m()

    def _jacobian_m(self) -> Floats:
        """(G, 3, D) velocity of each point per velocity of every controlled DoF [m/rad], world."""
        mj, linear = self._model.mj, np.empty((3, self._model.mj.nv))
        rows = []
        for body, point_m in zip(self._body, self._points_m(), strict=True):
            mujoco.mj_jac(mj, self._data, linear, None, point_m, body)
            rows.append(linear[:, self._model.dof])
        return np.array(rows)


def motions_rad(way_m: Floats, jacobian_m: Floats, directions: Floats) -> Floats:
    """Motions α (r,) ≥ 0 of cells that together go a way: min |J Wᵀ α − e|² + (c Σ α)².

    Cells evade and never pull, hence α ≥ 0. What one cell moves and should not, others undo; so the plan for
    all of them, and not the best single cell, says what each is good for. It names few cells, since the
    effort counts their sum.

    Args:
        way_m: e (m,) [m].
        jacobian_m: J (m, D) [m/rad].
        directions: W (r, D), rows of norm one or less.
    """
    if not len(directions):  # SciPy's solver does not survive it
        return np.zeros(0)
    effect = np.einsum("md,rd->mr", jacobian_m, directions)
    effort = np.full((1, len(directions)), _EFFORT_M_PER_RAD)
    motions, _ = nnls(np.vstack([effect, effort]), np.append(way_m, 0.0))
    result: Floats = motions
    return result
