"""Trace of a run's inputs and commands, for metrics and plots; never used for control."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["RunTrace"]


class RunTrace:
    """Trace of inputs and commands of every tick, and of tactile input in reacting stages."""

    def __init__(self) -> None:
        self._t_ns: list[int] = []
        self._velocity: list[NDArray[np.float32]] = []
        self._input_counts: list[tuple[int, int]] = []
        self._tactile_input_ns: list[int] = []
        self._tactile_input: list[NDArray[np.float16]] = []

    def add(
        self,
        t_ns: int,
        velocity: NDArray[np.float64],
        tactile_input: NDArray[np.float64] | None,
        input_counts: tuple[int, int],
    ) -> None:
        """Add a tick: velocities (D,) [rad/s], tactile input (S, 4), counts of events and full readings."""
        self._t_ns.append(t_ns)
        self._input_counts.append(input_counts)
        self._velocity.append(velocity.astype(np.float32))
        if tactile_input is not None:
            self._tactile_input_ns.append(t_ns)
            self._tactile_input.append(tactile_input.astype(np.float16))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the trace's arrays by name."""
        return {
            "t_ns": np.array(self._t_ns, dtype=np.int64),
            "velocity_rad_s": np.array(self._velocity, dtype=np.float32),
            # counts of events and of full readings
            "input_counts": np.array(self._input_counts, dtype=np.int64).reshape(-1, 2),
            "tactile_input_t_ns": np.array(self._tactile_input_ns, dtype=np.int64),
            "tactile_input": np.array(self._tactile_input, dtype=np.float16),
        }
