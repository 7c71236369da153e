"""Rotations of vectors between frames, on scalars that compiled code keeps in registers.

Compiled code indexes arrays element by element, and small functions take few arrays: every slice and every
array passed to a function that is not inlined costs two atomic reference counts.
"""

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled_without_nrt

__all__ = ["rotate", "rotate_inverse"]

Floats = NDArray[np.float64]


@compiled_without_nrt
def rotate(matrices: Floats, index: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate the vector (x, y, z) by row `index` of the rotation matrices `matrices` (·, 9)."""
    return (
        matrices[index, 0] * x + matrices[index, 1] * y + matrices[index, 2] * z,
        matrices[index, 3] * x + matrices[index, 4] * y + matrices[index, 5] * z,
        matrices[index, 6] * x + matrices[index, 7] * y + matrices[index, 8] * z,
    )


@compiled_without_nrt
def rotate_inverse(matrices: Floats, index: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate the vector (x, y, z) by the inverse of row `index` of the matrices `matrices` (·, 9)."""
    return (
        matrices[index, 0] * x + matrices[index, 3] * y + matrices[index, 6] * z,
        matrices[index, 1] * x + matrices[index, 4] * y + matrices[index, 7] * z,
        matrices[index, 2] * x + matrices[index, 5] * y + matrices[index, 8] * z,
    )
