"""From tactile coordinates to frames on the controller's own model: what is touched, where, and how it faces.

The coordinates ξ (2,) [m] of a sheet run along its surface. The sheet is known by its elements; in between it
is taken to bend evenly.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from controller.nursing.kinematics import Kinematics, SurfacePoint

__all__ = ["Contacts", "Felt", "Region", "Sheet", "initial_contacts"]

Floats = NDArray[np.float64]


class Region(NamedTuple):
    """What a board says of one region of neighbouring active elements."""

    sheet: str
    number: int
    """Stable while the region lives."""
    xi_m: tuple[float, float]
    """Centre of pressure ξ in tactile coordinates."""
    force_n: float
    """Total normal force f."""
    peak_kpa: float
    """Highest pressure of an element."""


class Felt(NamedTuple):
    """All that the skin felt last."""

    t_ns: int
    """When the board that is most behind took its readings."""
    regions: tuple[Region, ...]


class Sheet:
    """The surface that a tactile sheet spans on one body."""

    def __init__(
        self, body: str, xi_m: Floats, position_m: Floats, R_body_element: Floats, pitch_m: float
    ) -> None:
        """Takes n elements.

        Args:
            body: Name of the body that carries the sheet.
            xi_m: (n, 2) tactile coordinates, on a lattice of `pitch_m`.
            position_m: (n, 3) places of the elements, frame of the body.
            R_body_element: (n, 3, 3) columns e1, e2 along the coordinates, and the outward normal e1 × e2.
            pitch_m: Distance between neighbours.

        Raises:
            ValueError: shapes that do not fit, or no element.
        """
        n = len(xi_m)
        if n == 0 or not (
            xi_m.shape == (n, 2) and position_m.shape == (n, 3) and R_body_element.shape == (n, 3, 3)
        ):
            raise ValueError(
                f"sheet on {body}: coordinates {xi_m.shape}, positions {position_m.shape} and rotations "
                f"{R_body_element.shape}; (n, 2), (n, 3) and (n, 3, 3) of at least one element are due"
            )
        self.body = body
        self._xi_m, self._position_m, self._R, self._pitch_m = xi_m, position_m, R_body_element, pitch_m

    def at(self, xi_m: Sequence[float] | Floats) -> SurfacePoint:
        """The surface at ξ with its local frame Σ_L: e1, e2 and their outer product [R11, V].

        Each element near ξ predicts it half by its place and half by its tangent plane. Together they are
        exact where the surface bends evenly; at rims and in the gaps of a comb, where ξ is not in the middle
        of those that are left, off by κ δ² / 2 with the curvature κ and the way δ to their middle.

        Raises:
            ValueError: ξ is two pitches or more from every element.
        """
        away = np.asarray(xi_m, dtype=np.float64) - self._xi_m
        share = self._shares(away, self._pitch_m)
        if not share.sum() > 1.0 - 1e-9:  # some of the four around ξ are cut away: those behind help out
            share = self._shares(away, 2.0 * self._pitch_m)
        if not share.sum() > 0.0:
            raise ValueError(f"tactile coordinates {tuple(xi_m)} m are not on the sheet of {self.body}")
        share = share / share.sum()
        near = share > 0.0
        share, away = share[near], away[near]
        R = Rotation.from_matrix(self._R[near]).mean(share).as_matrix()
        tangents = self._R[near][:, :, :2]
        position_m = share @ (self._position_m[near] + 0.5 * np.einsum("nij,nj->ni", tangents, away))
        return SurfacePoint(self.body, position_m + 0.5 * R[:, :2] @ (share @ away), R)

    @staticmethod
    def _shares(away_m: Floats, width_m: float) -> Floats:
        """(n,) bilinear weights, which fall to zero at `width_m` along either coordinate."""
        shares: Floats = np.prod(np.maximum(1.0 - np.abs(away_m) / width_m, 0.0), axis=1)
        return shares


class Contacts(NamedTuple):
    """C contacts as they were in the beginning: equations (1) and (3) [R11]."""

    names: tuple[str, ...]
    """Name of the sheet, with the region's number where a sheet has more than one."""
    points: tuple[SurfacePoint, ...]
    """Surface at ξ_c(0)."""
    xi_m: Floats
    """(C, 2): ξ_c(0)."""
    force_n: Floats
    """(C,): f_c(0)."""
    object_m: Floats
    """(3,): x̃_O, origin of the object frame Σ_O, world frame."""
    x_object: Floats
    """(C, 3): ^O x_c [m]."""
    R_object: Floats
    """(C, 3, 3): ^O R_c."""


def initial_contacts(
    kinematics: Kinematics,
    q: Floats,
    sheets: Mapping[str, Sheet],
    regions: Sequence[Region],
    object_m: Sequence[float] | None = None,
) -> Contacts:
    """Records the initial contacts, equation (3).

    Args:
        kinematics: The controller's model.
        q: (N,) joint readings [rad].
        sheets: By name.
        regions: What is touched, at least one.
        object_m: Inherent centre of the object, world frame; the mean of the contacts unless given.

    Raises:
        ValueError: no region, or one that is not on its sheet.
    """
    if not regions:
        raise ValueError("no contact to record")
    points = tuple(sheets[region.sheet].at(region.xi_m) for region in regions)
    poses = kinematics.at(q, points)
    middle_m = poses.position_m.mean(axis=0) if object_m is None else np.asarray(object_m, dtype=np.float64)
    sheet_names = [region.sheet for region in regions]
    return Contacts(
        names=tuple(
            region.sheet if sheet_names.count(region.sheet) == 1 else f"{region.sheet}.{region.number}"
            for region in regions
        ),
        points=points,
        xi_m=np.array([region.xi_m for region in regions], dtype=np.float64),
        force_n=np.array([region.force_n for region in regions], dtype=np.float64),
        object_m=middle_m,
        x_object=poses.position_m - middle_m,
        R_object=poses.R_world_surface,
    )
