"""Unsensed force: load that passes through the rigid shell under skin, where foam is fully compressed."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.compilation import compiled_without_nrt
from skinnet.pinned_linalg import matmul

__all__ = ["UnsensedForce"]

Floats = NDArray[np.float64]


class UnsensedForce:
    """Normal force of MuJoCo's rigid contacts at covered places: on a link with skin, under one of its cells.

    Attributes:
        now_n: Unsensed force at the last observation [N].
        peak_n: Largest [N].
        mean_n: Mean over all observations [N].
    """

    def __init__(self, mj: mujoco.MjModel, surfaces: Sequence[SkinSurface], thickness_m: float) -> None:
        """Initialise for the cells of `surfaces`, under foam of `thickness_m` [m]."""
        self.now_n = self.peak_n = self.mean_n = 0.0
        self._n = 0
        self._mj, self._thickness_m = mj, thickness_m
        self._geom_body = mj.geom_bodyid.copy()
        self._cells_of_body = _cells_by_body(surfaces)
        covered = np.isin(self._geom_body, list(self._cells_of_body))
        self._on_covered_body = np.append(covered, False)  # a flex has -1 for its geom
        self._wrench = np.zeros(6)

    def observe(self, data: mujoco.MjData) -> None:
        """Observe the contacts of `data`, whose forces are computed."""
        self.now_n = 0.0
        if data.ncon:
            geoms = data.contact.geom
            for index in np.flatnonzero(self._on_covered_body[geoms].any(axis=1)).tolist():
                if any(self._is_covered(data, int(geom), data.contact.pos[index]) for geom in geoms[index]):
                    mujoco.mj_contactForce(self._mj, data, index, self._wrench)
                    self.now_n += float(self._wrench[0])
        self.peak_n = max(self.peak_n, self.now_n)
        self._n += 1
        self.mean_n += (self.now_n - self.mean_n) / self._n

    def facts(self) -> dict[str, float]:
        """Facts for metrics."""
        return {"mean_n": self.mean_n, "peak_n": self.peak_n}

    def _is_covered(self, data: mujoco.MjData, geom: int, point_m: Floats) -> bool:
        """Return True if `point_m`, world [m], lies under a cell of the body of `geom`."""
        body = int(self._geom_body[geom])
        if not self._on_covered_body[geom]:
            return False
        local_m = matmul(data.xmat[body].reshape(3, 3).T, point_m - data.xpos[body])
        return any(
            _lies_under_a_cell(position_m, R_body_cell, reach_m, self._thickness_m, local_m)
            for position_m, R_body_cell, reach_m in self._cells_of_body[body]
        )


@compiled_without_nrt
def _lies_under_a_cell(
    positions_m: Floats, R_body_cells: Floats, reach_m: float, thickness_m: float, point_m: Floats
) -> bool:
    """Return True if `point_m` (3,) is within `reach_m` of a cell's axis and `thickness_m` above or below."""
    for cell in range(len(positions_m)):
        x_m, y_m, z_m = 0.0, 0.0, 0.0
        for k in range(3):
            offset_m = point_m[k] - positions_m[cell, k]
            x_m += R_body_cells[cell, k, 0] * offset_m
            y_m += R_body_cells[cell, k, 1] * offset_m
            z_m += R_body_cells[cell, k, 2] * offset_m
        if x_m * x_m + y_m * y_m <= reach_m * reach_m and abs(z_m) <= thickness_m:
            return True
    return False


def _cells_by_body(surfaces: Sequence[SkinSurface]) -> dict[int, list[tuple[Floats, Floats, float]]]:
    """Cells of each covered body, by surface: centres (n, 3) [m], rotations (n, 3, 3), and reach [m]."""
    cells: dict[int, list[tuple[Floats, Floats, float]]] = {}
    for surface in surfaces:
        for body in np.unique(surface.body_id).tolist():
            rows = np.flatnonzero(surface.body_id == body)
            outline = slice(surface.grid.n_corners)
            reach_m = float(pinned_math.hypot_of(surface.grid.x_m[outline], surface.grid.y_m[outline]).max())
            cells.setdefault(body, []).append((surface.position_m[rows], surface.R_body_cell[rows], reach_m))
    return cells
