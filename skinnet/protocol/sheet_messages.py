"""Messages of tactile sheets: element pressures, and contact regions reported by the boards."""

import numpy as np

from skinnet.protocol.messages import Message

__all__ = ["PATTERN_ROW", "REGION_ROW", "SCAN_FRAME_ROW", "Pressures", "Regions"]

_MAX_BOARD_ELEMENTS = 64
REGION_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("force_n", "<f4"),
        ("xi1_m", "<f4"),
        ("xi2_m", "<f4"),
        ("area_m2", "<f4"),
        ("peak_kpa", "<f4"),
        ("region_id", "<u2"),
        ("lineage_id", "<u2"),
        ("n_elements", "<u2"),
        ("board", "<u2"),
    ]
)
"""Contact region in one scan frame of a board: 44 bytes, no padding.

`region_id` counts from 1 and is constant over the lifetime of the region. In the first frame of a region that
split off, `lineage_id` is the id of the region that it split from. A region that ends has one last row with 0
`n_elements`; there `lineage_id` is the id of the region that it merged into. Otherwise `lineage_id` is 0.
"""

SCAN_FRAME_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("scan_index", "<i8"),
        ("board", "<u2"),
        ("n_regions", "<u2"),
    ]
)
"""Scan frame of a board, as received in a features message, with or without regions: 28 bytes.

`t_sampled_ns` is the time at which the board read its last element; its `rows` region rows have the same
board and time.
"""

PATTERN_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("scan_index", "<i8"),
        ("board", "<u2"),
        ("n_elements", "<u2"),
        ("pressure_kpa", "<f4", _MAX_BOARD_ELEMENTS),
    ]
)
"""Raw pressure pattern [kPa] as received: readings of the board's `elements` in order, then zeros."""


class Pressures(Message, frozen=True, kw_only=True, tag="pressures"):
    """Pressures on the elements of all sheets at `t_ns`: float32 [kPa], sheets in deployment order.

    `end_ns`, if given, ends the run.
    """

    t_ns: int
    watermark_ns: int
    values: bytes
    end_ns: int | None = None


class Regions(Message, frozen=True, kw_only=True, tag="regions"):
    """Contact regions that the boards sent to the main PC in a period; also its period end.

    `frames`: bytes of `SCAN_FRAME_ROW`, one for each features message received, in the order of delivery,
    with or without regions; `rows`: bytes of `REGION_ROW`, grouped by frame in the same order; `patterns`:
    bytes of `PATTERN_ROW`. `seq` counts the frames delivered before this message.
    """

    t_ns: int
    watermark_ns: int
    frames: bytes
    rows: bytes
    patterns: bytes = b""
    seq: int = 0
