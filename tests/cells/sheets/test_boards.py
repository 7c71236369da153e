from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cells.sheets.boards import Boards, DeliveredMessages
from cells.sheets.region_quantisation import FORCE_STEP_N, XI_STEP_M
from skinnet.deployment.network import BoardNetworkSpec
from skinnet.deployment.skin.sheets import BoardSpec, PressureSpec, SheetSpec, SurfaceSpec
from skinnet.protocol.sheet_messages import REGION_ROW, SCAN_FRAME_ROW
from skinnet.skin.tactile_sheets import PlacedSheet, place_sheets

PERIOD_NS = 4_000_000
COMPUTE_NS = 200_000
BYTE_NS = 14_000
BITS_PER_S = BoardNetworkSpec().bits_per_s
EXACT = BoardSpec(pressure=PressureSpec(noise_kpa=0.0))


def sheets(n: int) -> tuple[PlacedSheet, ...]:
    names = [f"board{i}" for i in range(n)]
    surfaces = [
        SurfaceSpec(name=m, body=m, origin_m=(0, 0, 0), normal=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0))
        for m in names
    ]
    return place_sheets(surfaces, [SheetSpec(name=m, surface=m) for m in names])


def boards(n: int, spec: BoardSpec = EXACT, seed: int = 1, **network: Any) -> Boards:
    return Boards(sheets(n), spec, BoardNetworkSpec(**network), seed)


def pressures(n: int, **contacts: tuple[int, int, int, int]) -> NDArray[np.float32]:
    """20 kPa on a rectangle (first row, first column, rows, columns) of some boards, by `b0=` and so on."""
    grid = np.zeros((n, 8, 8), dtype=np.float32)
    for name, (row, column, height, width) in contacts.items():
        grid[int(name[1:]), row : row + height, column : column + width] = 20.0
    return grid.ravel()


def run(some: Boards, frames: int, kpa: NDArray[np.float32]) -> DeliveredMessages:
    """Everything that arrives in so many frames from 0 on."""
    steps = [some.step(frame, kpa, kpa) for frame in range(frames)]
    return DeliveredMessages(*(np.concatenate(column) for column in zip(*steps, strict=True)))


def test_a_message_of_one_board_takes_the_time_of_its_bytes() -> None:
    quiet = run(boards(1), 3, pressures(1))
    assert len(quiet.rows) == 0
    assert quiet.frames["n_regions"].tolist() == [0] * len(quiet.frames)
    assert quiet.frames["scan_index"].tolist()[:2] == [0, 1]
    delay_ns = quiet.frames["t_delivered_ns"] - quiet.frames["t_sampled_ns"]
    assert set(delay_ns.tolist()) == {COMPUTE_NS + 8 * BYTE_NS}
    touched = run(boards(1), 3, pressures(1, b0=(0, 0, 2, 2)))
    delay_ns = touched.frames["t_delivered_ns"] - touched.frames["t_sampled_ns"]
    assert set(delay_ns.tolist()) == {COMPUTE_NS + (8 + 12) * BYTE_NS}
    assert np.diff(touched.frames["t_sampled_ns"]).tolist() == [PERIOD_NS] * (len(touched.frames) - 1)


def test_a_bus_carries_one_message_at_a_time() -> None:
    """Against the recursion of a queue with one server: done = max(ready, done before) + time of bytes."""
    kpa = pressures(12, b0=(0, 0, 2, 2), b5=(1, 1, 3, 3), b7=(4, 4, 4, 4))
    frames = run(boards(12), 20, kpa).frames
    ready_ns = frames["t_sampled_ns"] + COMPUTE_NS
    assert (np.diff(ready_ns) >= 0).all()
    done_ns, expected = 0, []
    for t_ns, rows in zip(ready_ns.tolist(), frames["n_regions"].tolist(), strict=True):
        done_ns = max(t_ns, done_ns) + (8 + 12 * rows) * BYTE_NS
        expected.append(done_ns)
    assert frames["t_delivered_ns"].tolist() == expected
    assert (frames["t_delivered_ns"] - ready_ns > 20 * BYTE_NS).any()  # some did wait


def test_a_star_has_no_waiting_and_a_chain_a_hop_for_each_board() -> None:
    """The chain is 100 times as fast, so that no message waits for that of another board."""
    for kind, hops, speed in (("star", [1] * 5, 1), ("chain", [1, 2, 3, 4, 5], 100)):
        some = boards(5, kind=kind, propagation_delay_us=10.0, bits_per_s=speed * BITS_PER_S)
        frames = run(some, 4, pressures(5)).frames
        delay_ns = frames["t_delivered_ns"] - frames["t_sampled_ns"] - COMPUTE_NS
        expected = [hops[b] * (8 * BYTE_NS // speed + 10_000) for b in frames["board"].tolist()]
        assert delay_ns.tolist() == expected
        assert set(frames["board"].tolist()) == set(range(5))


def test_features_arrive_as_the_board_found_them_up_to_the_steps_of_the_wire() -> None:
    some = boards(3)
    kpa = pressures(3, b0=(0, 1, 2, 3), b2=(3, 3, 4, 2))
    arrived = [some.step(frame, kpa, kpa) for frame in range(2)]
    rows = np.concatenate([a.rows for a in arrived])
    assert rows.dtype == REGION_ROW
    for row in rows:
        found = some.tracker.rows[row["board"], 0]
        assert row["force_n"] == pytest.approx(found["force_n"], abs=0.51 * FORCE_STEP_N)
        assert row["xi1_m"] == pytest.approx(found["xi1_m"], abs=0.51 * XI_STEP_M)
        assert row["xi2_m"] == pytest.approx(found["xi2_m"], abs=0.51 * XI_STEP_M)
        assert row["peak_kpa"] == pytest.approx(found["peak_kpa"], abs=90 / 255)
        assert (row["region_id"], row["n_elements"]) == (found["region_id"], found["n_elements"])
    assert set(rows["board"].tolist()) == {0, 2}
    two = rows[rows["board"] == 2][0]
    assert two["force_n"] == pytest.approx(8 * 20e3 * 0.0215**2, rel=0.01)
    assert (two["xi1_m"], two["xi2_m"]) == pytest.approx((0.0, -0.0215), abs=1e-4)


def test_rows_belong_to_the_frames_in_the_order_of_delivery() -> None:
    arrived = run(boards(6), 10, pressures(6, b1=(0, 0, 2, 2), b4=(5, 5, 1, 2), b5=(0, 0, 1, 1)))
    assert arrived.frames.dtype == SCAN_FRAME_ROW
    assert (np.diff(arrived.frames["t_delivered_ns"]) > 0).all()
    for name in ("t_sampled_ns", "t_delivered_ns", "board"):
        expected = np.repeat(arrived.frames[name], arrived.frames["n_regions"])
        assert arrived.rows[name].tolist() == expected.tolist()


def conserved(some: Boards) -> dict[str, dict[str, int]]:
    counters = some.counters()
    for entry in counters.values():
        assert entry["offered"] == sum(n for name, n in entry.items() if name != "offered")
    return counters


def test_raw_patterns_of_all_boards_do_not_fit_and_are_dropped_and_counted() -> None:
    """Why the boards send features: 12 patterns of 72 bytes each 4 ms are 3 Mbit/s."""
    kpa = pressures(12, b0=(0, 0, 4, 4), b1=(0, 0, 4, 4))
    features = boards(12)
    run(features, 100, kpa)
    assert conserved(features)["regions"]["queue_full"] == 0
    load = features.network.kernel.link_counters.busy_ns.max() / (100 * PERIOD_NS)
    assert load == pytest.approx((12 * 8 + 2 * 12) * BYTE_NS / PERIOD_NS, rel=0.02)
    raw = boards(
        12, BoardSpec(pressure=PressureSpec(noise_kpa=0.0), pattern_interval_scans=1), queue_messages=20
    )
    arrived = run(raw, 100, kpa)
    counters = conserved(raw)
    assert counters["regions"]["queue_full"] > 0
    assert counters["pattern"]["queue_full"] > 0
    late_ns = arrived.frames["t_delivered_ns"] - arrived.frames["t_sampled_ns"]
    assert late_ns.max() <= COMPUTE_NS + 22 * 72 * BYTE_NS


def test_a_pattern_comes_every_so_many_frames_after_the_request_has_arrived() -> None:
    some = boards(2)
    dice = np.random.default_rng(0)
    patterns = []
    for frame in range(20):
        if frame == 3:
            some.request_pattern(3 * PERIOD_NS + 5, 1, 4)
        if frame == 13:
            some.request_pattern(0, 1, 0)
        kpa = dice.uniform(0.0, 80.0, 128).astype(np.float32)
        arrived = some.step(frame, kpa, kpa).patterns
        for row in arrived:
            assert row["n_elements"] == 64
            assert row["board"] == 1
            if row["scan_index"] == frame:
                assert row["pressure_kpa"] == pytest.approx(kpa[64:], abs=0.5 * 90 / 255 + 1e-4)
        patterns += arrived["scan_index"].tolist()
    assert patterns == [4, 8, 12]
    counters = conserved(some)
    assert (counters["request"]["delivered"], counters["pattern"]["delivered"]) == (2, 3)
    with pytest.raises(ValueError, match="boards 0 to 1"):
        some.request_pattern(0, 2, 1)


@pytest.mark.parametrize("kind", ["bus", "star", "chain"])
def test_a_request_finds_its_board_over_any_network(kind: str) -> None:
    some = boards(4, kind=kind)
    some.request_pattern(0, 3, 1)
    assert set(run(some, 4, pressures(4)).patterns["board"].tolist()) == {3}


def test_a_lost_message_takes_its_rows_with_it_and_nothing_else() -> None:
    kpa = pressures(3, b0=(0, 0, 2, 2), b1=(0, 0, 2, 2))
    whole, lossy = run(boards(3, kind="star"), 300, kpa), boards(3, kind="star", loss=0.2)
    arrived = run(lossy, 300, kpa)
    lost = conserved(lossy)["regions"]["loss"]
    assert 0.15 * 900 < lost < 0.25 * 900
    assert len(arrived.frames) == len(whole.frames) - lost
    assert set(arrived.frames.tolist()) < set(whole.frames.tolist())
    assert set(arrived.rows.tolist()) < set(whole.rows.tolist())


def test_a_cut_wire_silences_a_board_of_a_star_and_all_behind_it_in_a_chain() -> None:
    for kind, silent in (("star", {1}), ("chain", {1, 2})):
        some = boards(3, kind=kind)
        for link in (2, 3):  # both directions of the second wire
            some.network.kernel.fail_link(0, link)
        assert set(run(some, 3, pressures(3)).frames["board"].tolist()) == {0, 1, 2} - silent
        assert conserved(some)["regions"]["link_failed"] > 0


def test_the_same_seed_gives_the_same_and_another_other_clocks() -> None:
    kpa = pressures(4, b0=(0, 0, 2, 2), b3=(2, 2, 4, 4))
    spec = BoardSpec(pattern_interval_scans=5)
    first, again, other = (
        run(boards(4, spec, seed, loss=0.1, jitter_us=50.0), 40, kpa) for seed in (1, 1, 2)
    )
    for a, b in zip(first, again, strict=True):
        assert a.tobytes() == b.tobytes()
    assert first.frames.tobytes() != other.frames.tobytes()
