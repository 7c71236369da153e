"""Elastic foundation of tactile sheets: plane strips of foam on a curved surface, read as pressures."""

import math
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.sample_grid import sample_grid
from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.contact.skin_surface import SkinSurface, surface_of_patches
from skinnet.body.model import require_body_id
from skinnet.errors import DeploymentError
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["SheetFoundation", "sheet_surface"]

Floats = NDArray[np.float64]

_STRIPS_PER_ELEMENT = 3
"""Strips per element, of 3 samples each."""
_PA_PER_KPA = 1e3


class SheetFoundation(Foundation):
    """Elastic foundation (Winkler) of all tactile sheets, over a `sheet_surface`."""

    @property
    def n_elements(self) -> int:
        """Number of elements of all sheets."""
        return len(self.surface.body_id) // _STRIPS_PER_ELEMENT

    def element_force_n(self) -> Floats:
        """Normal force (n,) on each element [N]."""
        force_n: Floats = self.contact.force_n.reshape(-1, _STRIPS_PER_ELEMENT).sum(axis=1)
        return force_n

    def pressure_kpa(self) -> Floats:
        """Mean pressure (n,) on each element [kPa]."""
        area_m2 = _STRIPS_PER_ELEMENT**2 * self.surface.grid.area_m2
        return self.element_force_n() / (area_m2 * _PA_PER_KPA) if area_m2 else np.zeros(0)

    def body_force_n(self) -> Floats:
        """Normal force (nbody,) on the elements of each body, summed [N]."""
        owner = self.surface.body_id[::_STRIPS_PER_ELEMENT]
        force_n = np.zeros(len(self.temperature_c))
        np.add.at(force_n, owner, self.element_force_n())
        return force_n


def sheet_surface(mj: mujoco.MjModel, sheets: Sequence[PlacedSheet], source: Path | str) -> SkinSurface:
    """Build the surface of `sheets` on the bodies of `mj`: three strips of foam per element, in their order.

    A sheet bends along ξ1 only. So a strip along ξ2 is straight, and normals in its middle are exact.

    Raises:
        ModelError: a surface names a body that the model does not have.
        DeploymentError: sheets have elements of different sizes.
    """
    areas_m2 = {sheet.area_m2 for sheet in sheets}
    if len(areas_m2) > 1:
        pitches_m = ", ".join(f"{math.sqrt(area_m2):g}" for area_m2 in sorted(areas_m2))
        raise DeploymentError(f"sheets: pitches of {pitches_m} m; all sheets must have the same pitch")
    pitch_m = float(np.sqrt(areas_m2.pop())) if areas_m2 else 0.0
    steps_m = (
        pitch_m * (np.arange(_STRIPS_PER_ELEMENT) - 0.5 * (_STRIPS_PER_ELEMENT - 1)) / _STRIPS_PER_ELEMENT
    )
    frames = [_strips(sheet, steps_m) for sheet in sheets]
    return surface_of_patches(
        [require_body_id(mj, s.surface.body, f"surfaces.{s.surface.name}.body", source) for s in sheets],
        [position_m for position_m, _, _ in frames],
        [rotation for _, rotation, _ in frames],
        grid=sample_grid(
            np.column_stack([np.zeros(_STRIPS_PER_ELEMENT), steps_m]),
            np.tile(np.eye(2) * pitch_m / _STRIPS_PER_ELEMENT, (_STRIPS_PER_ELEMENT, 1, 1)),
            0.5 * pitch_m * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / [_STRIPS_PER_ELEMENT, 1],
        ),
        n_taxels=1,
        curvature_per_m=[curvature_per_m for _, _, curvature_per_m in frames],
    )


def _strips(sheet: PlacedSheet, steps_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Centres (k, 3) [m], rotations (k, 3, 3) and curvatures (k,) [1/m] of strips, frame of the body."""
    xi_m = np.repeat(sheet.xi_m, len(steps_m), axis=0)
    xi_m[:, 0] += np.tile(steps_m, sheet.n_elements)
    position_m, rotation = sheet.surface.frame_at(xi_m)
    half_m = np.array([0.5 * (steps_m[1] - steps_m[0]), 0.0])
    (_, before), (_, after) = (sheet.surface.frame_at(xi_m + sign * half_m) for sign in (-1.0, 1.0))
    turned = np.einsum("ki,ki->k", rotation[:, :, 0], after[:, :, 2] - before[:, :, 2])
    return position_m, rotation, turned / (2.0 * half_m[0])
