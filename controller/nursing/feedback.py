"""Tactile feedback control of contact positions and rotations, equations (19) to (23) [R11].

Correction to the paper: the first term of (19) is M s̈, as in (21). s is a length, as (20) requires.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from controller.nursing.contacts import Contacts

__all__ = ["POSITION", "ROTATION", "Feedback", "Impedance", "Response", "additional_rotation", "lengthened"]

Floats = NDArray[np.float64]

_TOO_NEAR_M = 1e-6


class Impedance(NamedTuple):
    """Impedance parameters of equation (19) or (21): virtual inertia M, viscosity D, stiffness K."""

    inertia: float
    damping: float
    stiffness: float


POSITION = Impedance(545.0, 1090.0, 2725.0)
"""Position impedance of s [m] under a force [N]: N s²/m, N s/m, N/m [R11, Table II]."""
ROTATION = Impedance(0.0043, 0.143, 0.108)
"""Rotation impedance of α [rad] under a shift of the centre of pressure [m]: m s², m s, m [R11, Table II]."""


class Response:
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
        whole = expm(system * period_s)
        self._passes: Floats = whole[:2, :2]
        self._takes: Floats = whole[:2, 2]

    def step(self, state: Floats, u: Floats) -> Floats:
        """Return states (..., 2), x and ẋ, after one period with input u (...)."""
        after: Floats = state @ self._passes.T + u[..., None] * self._takes
        return after


def lengthened(x_object: Floats, s_m: Floats) -> Floats:
    """Extend the vectors ^O x_c (C, 3) [m] by lengths s (C,) [m], equation (20) [R11]."""
    longer: Floats = x_object * (1.0 + s_m / np.linalg.norm(x_object, axis=1))[:, None]
    return longer


def additional_rotation(alpha_rad: Floats) -> Floats:
    """Return rotations Rot(k, |α|) (C, 3, 3) in the local frames Σ_L for α (C, 2) [rad], equation (22).

    The axis k is tangential and orthogonal to α; of the two, k = (-α2, α1, 0) / |α| moves the point at α
    along -e3, away from the object, since the outward normal e3 of the robot points into the object.
    """
    vector = np.stack((-alpha_rad[:, 1], alpha_rad[:, 0], np.zeros(len(alpha_rad))), axis=1)
    return Rotation.from_rotvec(vector).as_matrix()


class Feedback:
    """Tactile feedback state of C contacts; position or rotation feedback is off if its impedance is None."""

    def __init__(
        self,
        contacts: Contacts,
        period_s: float,
        position: Impedance | None = POSITION,
        rotation: Impedance | None = ROTATION,
    ) -> None:
        """Start at rest without adjustment.

        Raises:
            ValueError: an impedance is not above zero, or, with position feedback, a contact lies at the
                origin of the object frame, where the direction of (20) is undefined.
        """
        count = len(contacts.names)
        self._position = None if position is None else Response(position, period_s)
        self._rotation = None if rotation is None else Response(rotation, period_s)
        near = np.linalg.norm(contacts.x_object, axis=1) < _TOO_NEAR_M
        if position is not None and near.any():
            raise ValueError(
                f"contact {contacts.names[int(np.argmax(near))]} is where the object's centre is: "
                "position feedback needs a way to it; give the inherent centre of the object"
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

    def step(self, force_n: Floats, xi_m: Floats, felt: NDArray[np.bool_]) -> None:
        """Integrate (19) and (21) over one period with f_c (C,) [N] and ξ_c (C, 2) [m].

        Contacts without tactile input (`felt` (C,) is False) keep their adjustment with zero velocity.
        """
        if self._position is not None:
            self._s = self._position.step(self._s, force_n - self._force_n) * felt[:, None] + (
                _resting(self._s) * ~felt[:, None]
            )
        if self._rotation is not None:
            self._alpha = self._rotation.step(self._alpha, xi_m - self._xi_m) * felt[:, None, None] + (
                _resting(self._alpha) * ~felt[:, None, None]
            )

    def adjusted(self, x_object: Floats, R_object: Floats) -> tuple[Floats, Floats]:
        """Return ^O x_c^new (C, 3) [m] and ^O R_c^new (C, 3, 3) from the originals, (20) and (23) [R11]."""
        moved = x_object if self._position is None else lengthened(x_object, self._s[:, 0])
        return moved, R_object @ additional_rotation(self._alpha[:, :, 0])

    def original(self, x_new: Floats, R_new: Floats) -> tuple[Floats, Floats]:
        """Invert `adjusted`: return the originals of x_new (C, 3) [m] and R_new (C, 3, 3)."""
        moved = x_new if self._position is None else lengthened(x_new, -self._s[:, 0])
        return moved, R_new @ additional_rotation(-self._alpha[:, :, 0])


def _resting(state: Floats) -> Floats:
    at_rest: Floats = state * np.array([1.0, 0.0])
    return at_rest
