"""Validation of packets before injection: one compiled pass, and a clear error per column."""

import numpy as np
from numpy.typing import NDArray

from skinnet.compilation import compiled
from skinnet.network import kernel
from skinnet.network.records import NEVER_NS
from skinnet.network.routes import NO_LINK

__all__ = ["require_range", "survey_packets"]


@compiled
def survey_packets(
    t_ns: NDArray[np.int64],
    node: NDArray[np.int64],
    dest: NDArray[np.int64],
    size_bytes: NDArray[np.int64],
    link: NDArray[np.int64],
    now_ns: int,
    last_node: int,
) -> tuple[bool, bool, bool, int]:
    """Survey packets: all in range, in order of time, any link-local; and the smallest size [bytes]."""
    sound, in_order, any_local = True, True, False
    least = size_bytes[0]
    for i in range(t_ns.size):
        local = link[i] != NO_LINK
        any_local |= local
        sound &= now_ns <= t_ns[i] < NEVER_NS and 0 <= node[i] <= last_node
        sound &= (local or 0 <= dest[i] <= last_node) and 1 <= size_bytes[i] <= kernel.MAX_SIZE_BYTES
        in_order &= i == 0 or t_ns[i - 1] <= t_ns[i]
        least = min(least, size_bytes[i])
    return sound, in_order, any_local, least


def require_range(name: str, values: NDArray[np.int64], lowest: int, highest: int) -> None:
    """Raise ValueError if a value of the column `name` lies outside its range."""
    if values.min() < lowest or values.max() > highest:
        raise ValueError(
            f"{name} of packets ranges from {values.min()} to {values.max()}; "
            f"allowed are {lowest} to {highest}"
        )
