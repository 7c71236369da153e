"""Quantisation of region features in a board's message."""

from skinnet.deployment.skin.sheets import MAX_SIDE

__all__ = [
    "FORCE_STEP_N",
    "MAX_REGIONS",
    "MAX_ROWS",
    "PEAK_STEPS",
    "XI_STEP_M",
]

MAX_REGIONS = (MAX_SIDE // 2) * (MAX_SIDE // 2)
"""Maximum number of regions of a board: elements of its grid of which no two are 8-adjacent."""
MAX_ROWS = 2 * MAX_REGIONS
"""Maximum number of region rows of a board in a frame: all regions end and as many begin."""
FORCE_STEP_N = 0.05
"""Force step [N] in two bytes: up to 3277 N, above a full sheet at its range. *(assumed, as the next two)*"""
XI_STEP_M = 1e-4
"""Coordinate step [m] in two bytes: ±3.2 m."""
PEAK_STEPS = 255
"""Peak-pressure steps over the range, in one byte."""
