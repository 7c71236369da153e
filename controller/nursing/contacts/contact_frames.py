"""Contact frames on the kinematic model from tactile coordinates, equations (1) and (3) [R11].

The coordinates ξ (2,) [m] of a sheet run along its surface. The sheet is given by its elements; between them
its curvature is taken as constant.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.kinematics.robot_model import Kinematics, SurfacePoint
from skinnet.pinned_linalg import matmul
from skinnet.pinned_rotations import mean_rotation

__all__ = ["InitialContacts", "Region", "Sheet", "TactileInput", "initial_contacts"]

Floats = NDArray[np.float64]


class Region(NamedTuple):
    """Contact region of neighbouring active elements, as a board reports it."""

    sheet: str
    region_id: int
    """Region id, constant while the board tracks the region."""
    xi_m: tuple[float, float]
    """Centre of pressure ξ in tactile coordinates [m]."""
    force_n: float
    """Total normal force f [N]."""
    peak_kpa: float
    """Highest pressure of an element [kPa]."""


class TactileInput(NamedTuple):
    """Latest tactile input: all contact regions of all boards."""

    t_ns: int
    """Sampling time of the oldest frame among the latest frames of all boards [ns]."""
    regions: tuple[Region, ...]


class Sheet:
    """Tactile sheet surface on one body, interpolated between its elements."""

    def __init__(
        self, body: str, xi_m: Floats, position_m: Floats, R_body_element: Floats, pitch_m: float
    ) -> None:
        """Take the n elements of the sheet.

        Args:
            body: Name of the body that carries the sheet.
            xi_m: (n, 2) tactile coordinates on a grid of `pitch_m` [m].
            position_m: (n, 3) positions of the elements, body frame [m].
            R_body_element: (n, 3, 3) columns e1, e2 along the coordinates, and the outward normal e1 × e2.
            pitch_m: Distance between neighbours [m].

        Raises:
            ValueError: the shapes do not match, or there is no element.
        """
        n = len(xi_m)
        if n == 0 or not (
            xi_m.shape == (n, 2) and position_m.shape == (n, 3) and R_body_element.shape == (n, 3, 3)
        ):
            raise ValueError(
                f"sheet on {body}: coordinates {xi_m.shape}, positions {position_m.shape} and rotations "
                f"{R_body_element.shape}; expected (n, 2), (n, 3) and (n, 3, 3) with n ≥ 1"
            )
        self.body = body
        self._xi_m, self._position_m, self._R, self._pitch_m = xi_m, position_m, R_body_element, pitch_m

    def surface_point(self, xi_m: Sequence[float] | Floats) -> SurfacePoint:
        """Return the surface point at ξ with its local frame Σ_L: e1, e2 and e1 × e2 [R11, V].

        Each element near ξ contributes half by its position and half by its tangent plane, with bilinear
        weights. The sum is exact for constant curvature; at rims and in gaps of the grid, where the remaining
        elements are not centred on ξ, the error is κ δ² / 2 with the curvature κ and the distance δ from ξ
        to their weighted centre.

        Raises:
            ValueError: ξ is two pitches or more from every element.
        """
        away = np.asarray(xi_m, dtype=np.float64) - self._xi_m
        share = self._bilinear_weights(away, self._pitch_m)
        if not share.sum() > 1.0 - 1e-9:  # fewer than four elements surround ξ: widen the kernel
            share = self._bilinear_weights(away, 2.0 * self._pitch_m)
        if not share.sum() > 0.0:
            raise ValueError(f"tactile coordinates {tuple(xi_m)} m are not on the sheet of {self.body}")
        share = share / share.sum()
        near = share > 0.0
        share, away = share[near], away[near]
        R = mean_rotation(self._R[near], share)
        tangents = self._R[near][:, :, :2]
        position_m = matmul(share, self._position_m[near] + 0.5 * np.einsum("nij,nj->ni", tangents, away))
        return SurfacePoint(self.body, position_m + matmul(0.5 * R[:, :2], matmul(share, away)), R)

    @staticmethod
    def _bilinear_weights(offset_m: Floats, width_m: float) -> Floats:
        """Return bilinear weights (n,), which fall to zero at `width_m` along either coordinate."""
        shares: Floats = np.prod(np.maximum(1.0 - np.abs(offset_m) / width_m, 0.0), axis=1)
        return shares


class InitialContacts(NamedTuple):
    """Initial contact frames of C contacts, equations (1) and (3) [R11]."""

    names: tuple[str, ...]
    """Sheet name per contact, with the region id where a sheet has more than one."""
    points: tuple[SurfacePoint, ...]
    """Surface points at ξ_c(0)."""
    xi_m: Floats
    """Centres of pressure ξ_c(0) (C, 2) [m]."""
    force_n: Floats
    """Contact forces f_c(0) (C,) [N]."""
    object_centre_m: Floats
    """Origin x̃_O (3,) of the object frame Σ_O, world frame [m]."""
    x_object_contact_m: Floats
    """Contact positions ^O x_c (C, 3), object frame [m]."""
    R_object_contact: Floats
    """Contact rotations ^O R_c (C, 3, 3), object frame."""


def initial_contacts(
    kinematics: Kinematics,
    q: Floats,
    sheets: Mapping[str, Sheet],
    regions: Sequence[Region],
    object_centre_m: Sequence[float] | None = None,
) -> InitialContacts:
    """Record the initial contacts, equation (3) [R11].

    Args:
        kinematics: Kinematic model of the controller.
        q: (N,) measured joint positions [rad].
        sheets: Sheets by name.
        regions: Contact regions, at least one.
        object_centre_m: Inherent centre of the object, world frame [m]; by default the mean of the contacts.

    Raises:
        ValueError: no region is given, or one lies outside its sheet.
    """
    if not regions:
        raise ValueError("no contact region; at least one is required")
    points = tuple(sheets[region.sheet].surface_point(region.xi_m) for region in regions)
    poses = kinematics.surface_poses(q, points)
    middle_m = (
        poses.position_m.mean(axis=0)
        if object_centre_m is None
        else np.asarray(object_centre_m, dtype=np.float64)
    )
    sheet_names = [region.sheet for region in regions]
    return InitialContacts(
        names=tuple(
            region.sheet if sheet_names.count(region.sheet) == 1 else f"{region.sheet}.{region.region_id}"
            for region in regions
        ),
        points=points,
        xi_m=np.array([region.xi_m for region in regions], dtype=np.float64),
        force_n=np.array([region.force_n for region in regions], dtype=np.float64),
        object_centre_m=middle_m,
        x_object_contact_m=poses.position_m - middle_m,
        R_object_contact=poses.R_world_surface,
    )
