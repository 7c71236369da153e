"""What of a region fits into the bytes of a board's message."""

from skinnet.deployment.sheets import MAX_SIDE

__all__ = [
    "FORCE_STEP_N",
    "MAX_REGIONS",
    "MAX_ROWS",
    "PEAK_STEPS",
    "XI_STEP_M",
]

MAX_REGIONS = (MAX_SIDE // 2) ** 2
"""Of a board at a time: so many kings stand on its grid without attacking each other."""
MAX_ROWS = 2 * MAX_REGIONS
"""Of a board in a frame: all regions end and as many begin."""
FORCE_STEP_N = 0.05
"""Of a force in two bytes: up to 3277 N, more than a full sheet at its range. *(assumed, as the next two)*"""
XI_STEP_M = 1e-4
"""Of a coordinate in two bytes: ±3.2 m."""
PEAK_STEPS = 255
"""Steps of a peak pressure in one byte, over the range."""
