"""Deflections: how the motion of every joint accelerates every cell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_linalg import solve

__all__ = ["Deflections"]

_CLEAR = 4.25
"""Lever arm, in standard deviations of its noise along an axis, from which it is none: of three normal axes
together, one cell in 2500 exceeds it, and the noise is rather overestimated (assumed)."""


@dataclass(frozen=True, eq=False)
class Deflections:
    """Measured deflections of all cells in one pose.

    In the sine of DoF e the in-phase acceleration is the sum over all DoFs d of deflection times motion.
    """

    pose_rad: NDArray[np.float64]
    """Explored pose (D,)."""
    deflection_m: NDArray[np.float64]
    """Deflections (S, D, 3): in-phase acceleration along cell axes per joint acceleration [m/s² per rad/s²].

    Zero where not measured.
    """
    coupling: NDArray[np.float64]
    """Motion of DoF d, in phase, per motion of the excited DoF e (D, D): one on the diagonal."""
    measured: NDArray[np.bool_]
    """DoFs (D,) that followed their sine."""
    noise_m: NDArray[np.float64]
    """Standard deviation (D,) of the deflections along one axis [m], as their parts out of phase tell."""
    problems: tuple[str, ...]
    """Missing measurements, one line each."""

    def accelerates(self, min_lever_m: float) -> NDArray[np.bool_]:
        """True (S, D) where a DoF moves a cell: its lever arm exceeds `min_lever_m` [m], and its noise."""
        moves: NDArray[np.bool_] = self.lever_arms_m() > np.maximum(min_lever_m, _CLEAR * self.noise_m)
        return moves

    def lever_arms_m(self) -> NDArray[np.float64]:
        """Lever arm (S, D) [m] of every DoF at every cell, up to gravity tilt; zero where not measured.

        With the coupling C, D = J C: what a reaction torque moves belongs to the joint that yields.
        """
        n_cells, n_dofs, _ = self.deflection_m.shape
        by_sine = self.deflection_m.transpose(1, 0, 2).reshape(n_dofs, 3 * n_cells)
        by_dof = solve(self.coupling.T, by_sine).reshape(n_dofs, n_cells, 3)
        lever_m: NDArray[np.float64] = np.linalg.norm(by_dof, axis=2).T * self.measured
        return lever_m
