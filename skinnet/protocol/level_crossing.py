"""Level of a reading by ascending thresholds with hysteresis [M14, Table I]: rule of cell and receiver.

A receiver that knows the thresholds finds from a full reading the level that the cell has after it, even if
the event that told of the crossing was lost.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled

__all__ = ["MAX_LEVELS", "next_level", "pad_thresholds"]

MAX_LEVELS = 4
"""Maximum number of thresholds of a channel, as in Table I [M14]."""


def pad_thresholds(thresholds: Sequence[float]) -> NDArray[np.float32]:
    """Return ascending thresholds as (`MAX_LEVELS`,), padded with inf, which means none.

    They are float32, as readings are: a reading that equals a threshold has reached it.
    """
    return np.array([*thresholds, *[math.inf] * (MAX_LEVELS - len(thresholds))], dtype=np.float32)


@compiled
def next_level(reading: float, level: int, thresholds: NDArray[np.float32], hysteresis: float) -> int:
    """Return the level after `reading`: up at a threshold, down below threshold − hysteresis."""
    while level < MAX_LEVELS and reading >= thresholds[level]:
        level += 1
    while level > 0 and reading < thresholds[level - 1] - hysteresis:
        level -= 1
    return level
