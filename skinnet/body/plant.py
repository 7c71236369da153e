"""Plant interface of the body process: a physics simulation, or a script in its place."""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["GroundTruth", "Plant"]


class GroundTruth(NamedTuple):
    """Ground truth of a run for metrics: facts and arrays of the body's process result."""

    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


class Plant(Protocol):
    """Plant (protocol): a robot with skin in its environment, stepped in time.

    Attributes:
        t_ns: Present time [ns].
        cells: Rows of each patch's cells in the stimulus, by the name of the patch.
    """

    t_ns: int
    cells: dict[str, slice]

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""

    @property
    def range_rad(self) -> NDArray[np.float64]:
        """Position limits (D, 2) of the controlled joints, infinite without a limit."""

    def set_command(self, velocity_rad_s: NDArray[np.float64]) -> bool:
        """Set the velocity command (D,) [rad/s] from now on; return False if it is refused."""

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""

    def advance(self, until_ns: int) -> None:
        """Advance to `until_ns` [ns]."""

    def stimulus(self) -> NDArray[np.float64]:
        """Stimulus of all cells now: (n_cells, 8) in `STIMULUS_NAMES` order, a copy."""

    def pressures(self) -> NDArray[np.float64]:
        """Sheet pressures (n_elements,) on all elements now [kPa], a copy."""

    def joints(self) -> NDArray[np.float64]:
        """Joint positions (D,) of the controlled joints now [rad], a copy."""

    def free_bodies(self) -> dict[str, list[float]]:
        """Free-body poses now: position [m] and quaternion (w, x, y, z), world, by name."""

    def ground_truth(self) -> GroundTruth:
        """Ground truth of the run so far."""
