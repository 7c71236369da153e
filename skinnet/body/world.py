"""What the body process runs: physics, or a script in its place."""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["GroundTruth", "World"]


class GroundTruth(NamedTuple):
    """What really happened, for figures that compare: facts and arrays of the body's part."""

    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


class World(Protocol):
    """A robot with skin in its world, stepped from one time to another.

    Attributes:
        t_ns: Present time [ns].
        cells: Rows of each patch's cells in the stimulus, by the name of the patch.
    """

    t_ns: int
    cells: dict[str, slice]

    @property
    def n_dofs(self) -> int:
        """Number of controlled joints."""

    def set_command(self, velocity_rad_s: NDArray[np.float64]) -> bool:
        """Velocity command (D,) [rad/s], in force from now on; returns whether it was accepted."""

    def begin_stage(self, name: str) -> None:
        """The controller's program is in stage `name` from now on."""

    def advance(self, until_ns: int) -> None:
        """Lets time pass until `until_ns`."""

    def stimulus(self) -> NDArray[np.float64]:
        """What all cells feel now: (n_cells, 8) in `STIMULUS_NAMES` order, a copy."""

    def pressures(self) -> NDArray[np.float64]:
        """Pressure (n_elements,) on each element of all tactile sheets now [kPa], a copy."""

    def joints(self) -> NDArray[np.float64]:
        """Positions (D,) of the controlled joints now [rad], a copy."""

    def loose(self) -> dict[str, list[float]]:
        """Poses of what moves freely in the world now: position [m] and quaternion (w, x, y, z) by name."""

    def truth(self) -> GroundTruth:
        """What really happened so far."""
