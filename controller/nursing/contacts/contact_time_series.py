"""Contact time series of a nursing run, the quantities of Figs. 9 to 14 [R11]."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.manipulation import Manipulation
from controller.nursing.trajectory_generation import TrajectoryStep

__all__ = ["ContactSummary", "ContactTimeSeries"]

Floats = NDArray[np.float64]


class ContactSummary(NamedTuple):
    """Contact summary from the initial contacts to the end of the run."""

    name: str
    force_start_n: float
    force_min_n: float
    force_max_n: float
    force_end_n: float
    cop_peak_m: float
    """Largest distance of the centre of pressure from ξ_c(0) [m]."""
    cop_end_m: float
    position_dev_peak_m: float
    position_dev_end_m: float
    rotation_dev_peak_rad: float
    rotation_dev_end_rad: float


class ContactTimeSeries:
    """Time series of all control periods since the initial contacts were recorded."""

    def __init__(self, manipulation: Manipulation) -> None:
        """Start without periods, for the contacts of `manipulation`."""
        self._manipulation = manipulation
        self._rows: list[tuple[object, ...]] = []

    def add(self, t_ns: int, step: TrajectoryStep) -> None:
        """Append the period at `t_ns`."""
        m = self._manipulation
        self._rows.append(
            (
                t_ns,
                m.displacement_m,
                step.evaluation,
                step.deviations.position_m,
                step.deviations.rotation_rad,
                m.contact_tracker.force_n.copy(),
                m.contact_tracker.xi_m - m.contacts.xi_m,
                m.feedback.s_m,
                m.feedback.alpha_rad,
            )
        )

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the time series of T periods and C contacts.

        Returns:
            t_ns (T,), object_m (T, 3), evaluation (T,), position_dev_m and rotation_dev_rad (T, C),
            force_n (T, C), cop_m (T, C, 2) relative to ξ_c(0), s_m (T, C), alpha_rad (T, C, 2).
        """
        names = (
            "t_ns", "object_m", "evaluation", "position_dev_m", "rotation_dev_rad",
            "force_n", "cop_m", "s_m", "alpha_rad",
        )  # fmt: skip
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(names)
        return {name: np.array(column) for name, column in zip(names, columns, strict=True)}

    def summarise(self) -> tuple[ContactSummary, ...]:
        """Summarise every contact; empty before the first period."""
        if not self._rows:
            return ()
        rows = self.arrays()
        force_n = rows["force_n"]
        cop_m = np.linalg.norm(rows["cop_m"], axis=2)
        position_m, rotation_rad = rows["position_dev_m"], rows["rotation_dev_rad"]
        contacts = self._manipulation.contacts
        return tuple(
            ContactSummary(
                name,
                float(contacts.force_n[c]),
                *(float(value) for value in (force_n[:, c].min(), force_n[:, c].max(), force_n[-1, c])),
                *(float(value) for value in (cop_m[:, c].max(), cop_m[-1, c])),
                *(float(value) for value in (position_m[:, c].max(), position_m[-1, c])),
                *(float(value) for value in (rotation_rad[:, c].max(), rotation_rad[-1, c])),
            )
            for c, name in enumerate(contacts.names)
        )
