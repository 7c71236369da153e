"""Elastic foundation of all tactile sheets, read as pressures of their elements."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.sheet_surface import STRIPS_PER_ELEMENT
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["SheetFoundation"]

Floats = NDArray[np.float64]
_PA_PER_KPA = 1e3


@dataclass
class SheetFoundation(Foundation):
    """Elastic foundation (Winkler) of all tactile sheets, over a `sheet_surface`.

    Attributes:
        sheets: The sheets, in the order of their elements.
    """

    sheets: Sequence[PlacedSheet] = ()

    @property
    def n_elements(self) -> int:
        """Number of elements of all sheets."""
        return len(self.surface.body_id) // STRIPS_PER_ELEMENT

    def element_force_n(self) -> Floats:
        """Normal force (n,) on each element [N]."""
        force_n: Floats = self.contact.force_n.reshape(-1, STRIPS_PER_ELEMENT).sum(axis=1)
        return force_n

    def pressure_kpa(self) -> Floats:
        """Mean pressure (n,) on each element [kPa]."""
        area_m2 = STRIPS_PER_ELEMENT**2 * self.surface.sample_area_m2
        return self.element_force_n() / (area_m2 * _PA_PER_KPA) if area_m2 else np.zeros(0)

    def body_force_n(self) -> Floats:
        """Normal force (nbody,) on the elements of each body, summed [N]."""
        owner = self.surface.body_id[::STRIPS_PER_ELEMENT]
        force_n = np.zeros(len(self.temperature_c))
        np.add.at(force_n, owner, self.element_force_n())
        return force_n
