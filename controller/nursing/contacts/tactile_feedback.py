"""Tactile feedback control of contact positions and rotations, equations (19) to (23) [R11].

Correction to the paper: the first term of (19) is M s̈, as in (21). s is a length, as (20) requires.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.nursing.contacts.contact_frames import InitialContacts
from skinnet.pinned_linalg import exponential, matmul
from skinnet.pinned_rotations import rotation_matrices

__all__ = [
    "POSITION_IMPEDANCE",
    "ROTATION_IMPEDANCE",
    "Impedance",
    "ImpedanceResponse",
    "TactileFeedback",
    "additional_rotation",
    "extend_vectors",
]

Floats = NDArray[np.float64]

_MIN_CENTRE_DISTANCE_M = 1e-6


class Impedance(NamedTuple):
    """Impedance parameters of equation (19) or (21): virtual inertia M, viscosity D, stiffness K."""

    inertia: float
    damping: float
    stiffness: float


POSITION_IMPEDANCE = Impedance(545.0, 1090.0, 2725.0)
"""Position impedance of s [m] under a force [N]: N s²/m, N s/m, N/m [R11, Table II]."""
ROTATION_IMPEDANCE = Impedance(0.0043, 0.143, 0.108)
"""Rotation impedance of α [rad] under a shift of the centre of pressure [m]: m s², m s, m [R11, Table II]."""


class ImpedanceResponse:
    """Discrete impedance response M ẍ + D ẋ + K x = u, exact under zero-order hold of u.

    The continuous system is stable, so the eigenvalues of the matrix exponential lie inside the unit circle
    for every period.
    """

    def __init__(self, impedance: Impedance, period_s: float) -> None:
        """Discretise the impedance for one period [s].

        Raises:
            ValueError: inertia, damping, stiffness or period is not above zero.
        """
        if not all(0.0 < number < np.inf for number in (*impedance, period_s)):
            raise ValueError(f"{impedance} with a period of {period_s} s: all must be above zero and finite")
        inertia, damping, stiffness = impedance
        system = np.zeros((3, 3))
        system[0, 1] = 1.0
        system[1] = np.array([-stiffness, -damping, 1.0]) / inertia
        whole = exponential(system * period_s)
        self._state_matrix: Floats = whole[:2, :2]
        self._input_matrix: Floats = whole[:2, 2]

    def step(self, state: Floats, u: Floats) -> Floats:
        """Return states (..., 2), x and ẋ, after one period with input u (...)."""
        after: Floats = matmul(state, self._state_matrix.T) + u[..., None] * self._input_matrix
        return after


def extend_vectors(x_object_contact_m: Floats, s_m: Floats) -> Floats:
    """Extend the vectors ^O x_c (C, 3) [m] by lengths s (C,) [m], equation (20) [R11]."""
    longer: Floats = x_object_contact_m * (1.0 + s_m / np.linalg.norm(x_object_contact_m, axis=1))[:, None]
    return longer


def additional_rotation(alpha_rad: Floats) -> Floats:
    """Return rotations Rot(k, |α|) (C, 3, 3) in the local frames Σ_L for α (C, 2) [rad], equation (22).

    The axis k is tangential and orthogonal to α; of the two, k = (-α2, α1, 0) / |α| moves the point at α
    along -e3, away from the object, since the outward normal e3 of the robot points into the object.
    """
    vector = np.stack((-alpha_rad[:, 1], alpha_rad[:, 0], np.zeros(len(alpha_rad))), axis=1)
    return rotation_matrices(vector)


class TactileFeedback:
    """Tactile feedback state of C contacts; position or rotation feedback is off if its impedance is None."""

    def __init__(
        self,
        contacts: InitialContacts,
        period_s: float,
        position_impedance: Impedance | None = POSITION_IMPEDANCE,
        rotation_impedance: Impedance | None = ROTATION_IMPEDANCE,
    ) -> None:
        """Start at rest without adjustment.

        Raises:
            ValueError: an impedance is not above zero, or, with position feedback, a contact lies at the
                origin of the object frame, where the direction of (20) is undefined.
        """
        count = len(contacts.names)
        self._position = (
            None if position_impedance is None else ImpedanceResponse(position_impedance, period_s)
        )
        self._rotation = (
            None if rotation_impedance is None else ImpedanceResponse(rotation_impedance, period_s)
        )
        near = np.linalg.norm(contacts.x_object_contact_m, axis=1) < _MIN_CENTRE_DISTANCE_M
        if position_impedance is not None and near.any():
            raise ValueError(
                f"contact {contacts.names[int(np.argmax(near))]} coincides with the object's centre: "
                "position feedback needs a direction; set nursing.object_centre_m to the object's inherent "
                "centre"
            )
        self._force_n, self._xi_m = contacts.force_n, contacts.xi_m
        self._s = np.zeros((count, 2))
        self._alpha = np.zeros((count, 2, 2))

    @property
    def s_m(self) -> Floats:
        """Displacements s_c^x (C,) of the contacts away from the object's centre [m]."""
        return self._s[:, 0].copy()

    @property
    def alpha_rad(self) -> Floats:
        """Rotation parameters α_c (C, 2) [rad]."""
        return self._alpha[:, :, 0].copy()

    def step(self, force_n: Floats, xi_m: Floats, has_input: NDArray[np.bool_]) -> None:
        """Integrate (19) and (21) over one period with f_c (C,) [N] and ξ_c (C, 2) [m].

        Contacts without tactile input (`has_input` (C,) is False) keep their adjustment with zero velocity.
        """
        if self._position is not None:
            self._s = self._position.step(self._s, force_n - self._force_n) * has_input[:, None] + (
                _at_zero_velocity(self._s) * ~has_input[:, None]
            )
        if self._rotation is not None:
            self._alpha = self._rotation.step(self._alpha, xi_m - self._xi_m) * has_input[:, None, None] + (
                _at_zero_velocity(self._alpha) * ~has_input[:, None, None]
            )

    def adjust(self, x_object_contact_m: Floats, R_object_contact: Floats) -> tuple[Floats, Floats]:
        """Return ^O x_c^new (C, 3) [m] and ^O R_c^new (C, 3, 3) from the originals, (20) and (23) [R11]."""
        moved = (
            x_object_contact_m
            if self._position is None
            else extend_vectors(x_object_contact_m, self._s[:, 0])
        )
        return moved, matmul(R_object_contact, additional_rotation(self._alpha[:, :, 0]))

    def invert_adjustment(self, x_adjusted_m: Floats, R_adjusted: Floats) -> tuple[Floats, Floats]:
        """Invert `adjust`: return the originals of x_new (C, 3) [m] and R_new (C, 3, 3)."""
        moved = x_adjusted_m if self._position is None else extend_vectors(x_adjusted_m, -self._s[:, 0])
        return moved, matmul(R_adjusted, additional_rotation(-self._alpha[:, :, 0]))


def _at_zero_velocity(state: Floats) -> Floats:
    at_rest: Floats = state * np.array([1.0, 0.0])
    return at_rest
