"""The wire of tactile sheets: what their elements feel, and what their boards tell of it."""

import numpy as np

from skinnet.messages import Message

__all__ = ["BOARD_FRAME", "PATTERN_ROW", "REGION_ROW", "Pressures", "Regions"]

_SHEET_ELEMENTS = 64
REGION_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("force_n", "<f4"),
        ("xi1_m", "<f4"),
        ("xi2_m", "<f4"),
        ("area_m2", "<f4"),
        ("peak_kpa", "<f4"),
        ("number", "<u2"),
        ("kin", "<u2"),
        ("elements", "<u2"),
        ("board", "<u2"),
    ]
)
"""One region in one frame of a board: 44 bytes, no padding.

`number` is the region's own, from 1, as long as it lives. In the frame in which a region begins by
splitting off, `kin` is the number of the region that it was part of. A region that ends has one more row,
of no `elements`; there `kin` is the number of the region that took it over. Otherwise `kin` is 0.
"""

BOARD_FRAME = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("frame", "<i8"),
        ("board", "<u2"),
        ("rows", "<u2"),
    ]
)
"""One features message of a board that arrived, also if it says that there is no region: 28 bytes.

`t_sampled_ns` is when the board had read its last element; its `rows` rows are those of the same
board and time.
"""

PATTERN_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("frame", "<i8"),
        ("board", "<u2"),
        ("elements", "<u2"),
        ("pressure_kpa", "<f4", _SHEET_ELEMENTS),
    ]
)
"""One raw pattern that arrived: readings of the board's `elements` in their order, then zeros."""


class Pressures(Message, frozen=True, kw_only=True, tag="pressures"):
    """What the elements of all sheets feel at `t_ns`: float32 [kPa], sheets in the order of the deployment.

    With `end_ns` the run ends there.
    """

    t_ns: int
    covered_ns: int
    values: bytes
    end_ns: int | None = None


class Regions(Message, frozen=True, kw_only=True, tag="regions"):
    """What the boards of the tactile sheets told the main PC in a period, and closes it.

    `frames`: bytes of `BOARD_FRAME`, one for each features message that arrived, in the order of delivery,
    also if it has no region; `rows`: bytes of `REGION_ROW`, those of the first frame, then of the next;
    `patterns`: bytes of `PATTERN_ROW`. `seq` counts the frames delivered before this message.
    """

    t_ns: int
    covered_ns: int
    frames: bytes
    rows: bytes
    patterns: bytes = b""
    seq: int = 0
