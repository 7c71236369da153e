"""Tactile input from region records: ids over boards, merging of what crosses a seam, order of delivery."""

import numpy as np
import pytest

from controller.nursing.contacts.board_input import BoardInput
from controller.nursing.contacts.contact_frames import Region
from skinnet.deployment.skin.sheets import SheetSpec, SurfaceSpec
from skinnet.errors import ProtocolError
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.skin.tactile_sheets import place_sheets

MERGE_DISTANCE_M = 0.043
SHEETS = place_sheets(
    [
        SurfaceSpec(
            name=name, body=name, origin_m=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0)
        )
        for name in ("left", "right")
    ],
    [
        SheetSpec(name="a", surface="left", centre_xi_m=(0.0, 0.086), rows=4, columns=4),
        SheetSpec(name="b", surface="left", centre_xi_m=(0.0, 0.0), rows=4, columns=4),
        SheetSpec(name="c", surface="right", rows=4, columns=4),
    ],
)
Row = tuple[int, int, float, float, float, float]


def regions_of(*found: Row, t_ns: int = 0, n_elements: int = 1) -> tuple[Region, ...]:
    """Regions that the controller has after one scan: (board, id, ξ1 [m], ξ2 [m], force [N], peak [kPa])."""
    frames = np.zeros(len(SHEETS), dtype=SCAN_FRAME_ROW)
    frames["board"] = range(len(SHEETS))
    frames["t_sampled_ns"], frames["t_delivered_ns"] = t_ns, t_ns + 1
    rows = np.zeros(len(found), dtype=REGION_ROW)
    rows["n_elements"] = n_elements
    for row, (board, region_id, xi1_m, xi2_m, force_n, peak_kpa) in zip(rows, sorted(found), strict=True):
        row["board"], row["region_id"], row["force_n"], row["peak_kpa"] = board, region_id, force_n, peak_kpa
        row["xi1_m"], row["xi2_m"] = xi1_m, xi2_m
        frames["n_regions"][board] += 1
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    board_input.add(Regions(t_ns=0, watermark_ns=0, frames=frames.tobytes(), rows=rows.tobytes()))
    tactile = board_input.latest_input(t_ns + 2)
    assert tactile is not None
    assert tactile.t_ns == t_ns
    return tactile.regions


def test_merged_regions_have_the_id_of_the_strongest() -> None:
    """Also where the strongest comes from the later board: its contact goes on, whatever joins it."""
    (region,) = regions_of((0, 7, 0.0, 0.06, 1.0, 20.0), (1, 3, 0.0, 0.03, 3.0, 10.0))
    assert region.region_id == 2**16 + 3
    assert region.force_n == pytest.approx(4.0)
    assert region.peak_kpa == pytest.approx(20.0)
    np.testing.assert_allclose(region.xi_m, (0.0, (0.06 + 3 * 0.03) / 4), atol=1e-8)


def test_equal_forces_take_the_lower_id() -> None:
    (region,) = regions_of((0, 7, 0.0, 0.06, 2.0, 20.0), (0, 5, 0.0, 0.03, 2.0, 10.0))
    assert region.region_id == 5


@pytest.mark.parametrize(("apart_m", "n_contacts"), [(0.042, 1), (0.044, 2)])
def test_only_near_regions_are_one_contact(apart_m: float, n_contacts: int) -> None:
    found = regions_of((0, 1, 0.0, 0.03 + apart_m, 1.0, 1.0), (1, 1, 0.0, 0.03, 1.0, 1.0))
    assert len(found) == n_contacts


def test_distance_counts_from_the_strongest() -> None:
    """A chain of near regions does not become one long contact."""
    found = regions_of((0, 1, 0.0, 0.0, 3.0, 1.0), (0, 2, 0.0, 0.04, 1.0, 1.0), (0, 3, 0.0, 0.08, 1.0, 1.0))
    assert [(region.region_id, region.force_n) for region in found] == [(1, 4.0), (3, 1.0)]


def test_surfaces_keep_apart_and_ids_tell_boards() -> None:
    found = regions_of((0, 1, 0.0, 0.0, 1.0, 1.0), (2, 1, 0.0, 0.0, 2.0, 1.0))
    assert [(region.sheet, region.region_id) for region in found] == [("left", 1), ("right", 2 * 2**16 + 1)]


def test_a_region_without_elements_is_none() -> None:
    assert regions_of((0, 1, 0.0, 0.0, 1.0, 1.0), n_elements=0) == ()


def test_a_message_is_taken_frame_by_frame_as_it_is_due() -> None:
    """Three scans of one board in one message, with one, two and no regions."""
    n_regions, times_ns = (1, 2, 0), (10, 20, 30)
    frames = np.zeros(len(SHEETS) + 2, dtype=SCAN_FRAME_ROW)
    frames["board"] = [1, 2, 0, 0, 0]
    frames["t_delivered_ns"] = [1, 1, *times_ns]
    frames["t_sampled_ns"] = frames["t_delivered_ns"]
    frames["n_regions"] = [0, 0, *n_regions]
    rows = np.zeros(3, dtype=REGION_ROW)
    rows["n_elements"], rows["region_id"], rows["force_n"] = 1, (5, 6, 7), (1.0, 2.0, 3.0)
    rows["xi2_m"] = (0.0, 0.0, 0.1)
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    board_input.add(Regions(t_ns=0, watermark_ns=0, frames=frames.tobytes(), rows=rows.tobytes()))
    assert board_input.latest_input(1) is None  # nothing is due; asking takes nothing
    found = []
    for before_ns in (11, 21, 31):
        tactile = board_input.latest_input(before_ns)
        assert tactile is not None
        found.append([region.region_id for region in tactile.regions])
    assert found == [[5], [7, 6], []]
    assert board_input.received_frames == len(frames)


def message(boards: list[int], n_regions: int, n_rows: int) -> Regions:
    """Message with one frame of each of `boards`, each with `n_regions`, and `n_rows` region records."""
    frames = np.zeros(len(boards), dtype=SCAN_FRAME_ROW)
    frames["board"], frames["n_regions"], frames["t_delivered_ns"] = boards, n_regions, 1
    rows = np.zeros(n_rows, dtype=REGION_ROW)
    rows["n_elements"] = rows["force_n"] = 1
    return Regions(t_ns=0, watermark_ns=0, frames=frames.tobytes(), rows=rows.tobytes())


def test_a_message_without_frames_tells_nothing() -> None:
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    board_input.add(message([], 0, 0))
    assert board_input.latest_input(10) is None
    assert board_input.received_frames == 0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (message([0, 3], 0, 0), "regions of board 3; there are 3"),
        (message([0, 1], 1, 1), "1 region records, but the frame records count 2"),
        (message([0], 1, 2), "2 region records, but the frame records count 1"),
        (message([], 0, 1), "1 region records, but the frame records count 0"),
    ],
    ids=["unknown board", "too few records", "too many records", "records without frames"],
)
def test_a_wrong_message_is_refused_and_leaves_nothing(wrong: Regions, says: str) -> None:
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    with pytest.raises(ProtocolError, match=says):
        board_input.add(wrong)
    assert board_input.latest_input(10) is None
    assert board_input.received_frames == 0


def test_there_is_no_input_until_every_board_was_heard() -> None:
    """Its time is that of the board that was heard longest ago."""
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    for board, sampled_ns in ((0, 5), (2, 7), (1, 6)):
        assert board_input.latest_input(10) is None
        frames = np.zeros(1, dtype=SCAN_FRAME_ROW)
        frames["board"], frames["t_sampled_ns"], frames["t_delivered_ns"] = board, sampled_ns, 8
        board_input.add(Regions(t_ns=0, watermark_ns=0, frames=frames.tobytes(), rows=b""))
    tactile = board_input.latest_input(10)
    assert tactile is not None
    assert (tactile.t_ns, tactile.regions) == (5, ())


def test_a_scan_that_comes_after_a_newer_one_is_not_taken() -> None:
    frames = np.zeros(len(SHEETS) + 1, dtype=SCAN_FRAME_ROW)
    frames["board"] = [1, 2, 0, 0]
    frames["t_sampled_ns"] = [9, 9, 9, 8]
    frames["t_delivered_ns"] = [10, 10, 10, 11]
    frames["n_regions"] = [0, 0, 1, 1]
    rows = np.zeros(2, dtype=REGION_ROW)
    rows["n_elements"], rows["region_id"], rows["force_n"] = 1, (5, 4), 1.0
    board_input = BoardInput(SHEETS, MERGE_DISTANCE_M)
    board_input.add(Regions(t_ns=0, watermark_ns=0, frames=frames.tobytes(), rows=rows.tobytes()))
    tactile = board_input.latest_input(12)
    assert tactile is not None
    assert (tactile.t_ns, [region.region_id for region in tactile.regions]) == (9, [5])
    assert board_input.received_frames == len(frames)
