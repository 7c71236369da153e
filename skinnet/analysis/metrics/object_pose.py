"""Rotation of an object between its recorded poses."""

import numpy as np
from numpy.typing import NDArray

from skinnet.pinned_arcs import asin_of

__all__ = ["rotation_deg"]


def rotation_deg(poses: NDArray[np.floating]) -> NDArray[np.float64]:
    """Angle [°] of the rotation from the first pose to each one, (n,), from 0 to 180.

    The chord between two unit quaternions is 2 sin(θ/4); unlike the arc cosine of their product it is exact
    near 0. A quaternion and its negative are the same rotation.

    Args:
        poses: (n, 7) positions and unit quaternions (w, x, y, z).
    """
    turned = poses[:, 3:].astype(np.float64)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    chord = np.minimum(*(np.linalg.norm(turned - sign * turned[:1], axis=1) for sign in (1.0, -1.0)))
    angle_deg: NDArray[np.float64] = np.degrees(4.0 * asin_of(np.clip(0.5 * chord, 0.0, 1.0)))
    return angle_deg
