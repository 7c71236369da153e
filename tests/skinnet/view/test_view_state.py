"""The scene of a live page: what messages tell is there, nothing else is, and nothing breaks it."""

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from view_scene import MS, SHEETS, event, joints, scene, state, stream, told, topology

from skinnet.protocol.messages import Command, ControllerState, Events, Modality, Stream
from skinnet.protocol.recorded_messages import Counters, FreeBodyPoses
from skinnet.protocol.sheet_messages import PATTERN_ROW, REGION_ROW, SCAN_FRAME_ROW, Regions
from skinnet.protocol.telemetry_messages import (
    LINK_INTO_CELL,
    LINK_ROW,
    LINK_UP,
    LinkLoad,
    ProcessLoad,
    StateMachineDescription,
)
from skinnet.view.state.controller_view import ControllerView
from skinnet.view.state.event_history import FULL_READING_KIND, EventHistory, TrafficStatistics
from skinnet.view.state.process_stats import ProcessStats
from skinnet.view.state.sequence_gaps import SequenceGaps


def links(
    rows: list[tuple[int, int, int, dict[str, int]]], t_ns: int, dark: tuple[int, ...] = ()
) -> LinkLoad:
    """Rows of (cell, port, state, counters)."""
    table = np.zeros(len(rows), dtype=LINK_ROW)
    for row, (cell, port, flags, counters) in zip(table, rows, strict=True):
        row["cell"], row["port"], row["state"] = cell, port, flags
        for name, value in counters.items():
            row[name] = value
    return LinkLoad(patch="arm", t_ns=t_ns, rows=table.tobytes(), unpowered_cells=list(dark))


def test_readings_are_those_that_were_told() -> None:
    view, atlas = scene()
    assert np.isnan(view.skin.displayed_values(Modality.FORCE)).all()
    view.apply(topology(atlas, "arm"), 0.0)
    assert view.skin.displayed_values(Modality.FORCE)[:6].tolist() == [0.0] * 6, "in the network, and silent"
    view.apply(event("arm", 4, 0.25, channel=1), 0.0)
    view.apply(event("hand", 1, 0.5, modality=Modality.PROXIMITY, t_ms=8), 0.0)
    force, near = view.skin.displayed_values(Modality.FORCE), view.skin.displayed_values(Modality.PROXIMITY)
    assert force[4] == 0.25
    assert near[7] == 0.5
    assert np.flatnonzero(force > 0).tolist() == [4]
    assert np.isnan(view.skin.displayed_values(Modality.TEMPERATURE)).all()
    full = np.arange(16, dtype=np.float32).reshape(2, 8)
    view.apply(stream("hand", full, t_ms=12), 0.0)
    assert view.skin.displayed_values(Modality.TEMPERATURE)[6:].tolist() == [7.0, 15.0]
    assert view.skin.displayed_values(Modality.ACCELERATION)[6] == pytest.approx(np.sqrt(16 + 25 + 36))
    assert view.t_ns == 12 * MS
    assert view.n_malformed == 0


def test_many_events_are_taken_as_few_are() -> None:
    one, _ = scene()
    many, _ = scene()
    single = [event("arm", i % 6, 0.01 * i, channel=i % 3, seq=i).message for i in range(60)]
    for message in single:
        one.apply(told("events", message, MS, "arm"), 0.0)
    columns: dict[str, Any] = {
        name: [getattr(message, name)[0] for message in single]
        for name in (
            "cell",
            "t_sampled_ns",
            "t_delivered_ns",
            "seq",
            "modality",
            "channel",
            "kind",
            "level",
            "value",
        )
    }
    many.apply(told("bundle", Events(patch="arm", gateway=0, **columns), MS, "arm"), 0.0)
    np.testing.assert_array_equal(one.skin.reading, many.skin.reading)
    np.testing.assert_array_equal(one.skin.sampled_ns, many.skin.sampled_ns)
    assert one.events.since(0)[1].tolist() == many.events.since(0)[1].tolist()


@pytest.mark.parametrize(
    "message",
    [
        event("arm", 6, 0.1),
        event("leg", 0, 0.1),
        event("arm", -1, 0.1),
        event("arm", 1, 0.1, channel=70),
        stream("hand", np.zeros((3, 8), dtype=np.float32)),
        joints(5, 1.0, 2.0, 3.0),
        told("links", LinkLoad(patch="leg", t_ns=0, rows=b"", unpowered_cells=[]), 0, "leg"),
        told("links", LinkLoad(patch="arm", t_ns=0, rows=b"xyz", unpowered_cells=[]), 0, "arm"),
        told("links", LinkLoad(patch="arm", t_ns=0, rows=b"", unpowered_cells=[9]), 0, "arm"),
        told(
            "regions",
            Regions(t_ns=0, watermark_ns=0, frames=b"", rows=bytes(REGION_ROW.itemsize)),
            0,
            "boards",
        ),
        told("stream", Stream(patch="arm", t_ns=0, watermark_ns=0, n_events=0, rows=b"123"), 0, "arm"),
    ],
    ids=lambda message: f"{message.channel}",
)
def test_what_makes_no_sense_is_counted_and_changes_nothing(message: Any) -> None:
    view, atlas = scene()
    view.apply(topology(atlas, "arm"), 0.0)
    before = copy.deepcopy(view.skin.reading), view.t_ns, list(view.position_rad)
    view.apply(message, 1.0)
    assert view.n_malformed == 1
    assert view.last_error
    np.testing.assert_array_equal(view.skin.reading, before[0])
    assert (view.t_ns, list(view.position_rad)) == before[1:]


def test_who_is_part_of_the_network_and_who_is_not() -> None:
    view, atlas = scene()
    assert not view.network.unreachable.any(), "nothing is dead before the network has formed"
    view.apply(topology(atlas, "arm"), 0.0)
    network = view.network
    assert network.connected.tolist() == [True] * 6 + [False] * 2
    assert not network.unreachable.any()
    assert not network.broken.any()
    assert network.in_tree.sum() == 5 + 0, "a tree over six cells has five wires"
    view.apply(event("arm", 3, 0.4), 0.0)
    view.apply(topology(atlas, "arm", 3, version=2), 0.0)
    assert np.flatnonzero(view.network.unreachable).tolist() == [3]
    assert np.isnan(view.skin.displayed_values(Modality.FORCE)[3]), "what it felt is not known any more"
    assert not view.network.broken.any(), "its wires are whole"


def test_a_wire_that_neither_end_knows_is_cut() -> None:
    view, atlas = scene()
    view.apply(topology(atlas, "arm", cut=(2,)), 0.0)
    assert np.flatnonzero(view.network.broken).tolist() == [2]


def test_loads_are_those_of_the_last_interval_and_the_hosts_word_counts() -> None:
    view, atlas = scene()
    view.apply(topology(atlas, "arm"), 0.0)
    a, port_a, b, port_b = atlas.wires[0].tolist()
    gate, gate_port = atlas.gateways[0].tolist()

    def tell(t_ms: int, busy_ms: int, flags: int = LINK_UP, dark: tuple[int, ...] = ()) -> None:
        load = links(
            [
                (a, port_a, flags, {"busy_ns": busy_ms * MS, "dropped": busy_ms, "queue_high_water": 3}),
                (b, port_b, LINK_UP, {}),
                (gate, gate_port, LINK_UP | LINK_INTO_CELL, {"busy_ns": 2 * busy_ms * MS}),
            ],
            t_ms * MS,
            dark,
        )
        view.apply(told("links", load, t_ms * MS, "arm"), 0.0)

    tell(100, 10)
    assert not view.network.utilisation.any(), "one message is no interval"
    tell(200, 40)
    assert view.network.utilisation[a, port_a] == pytest.approx(0.3)
    assert view.network.utilisation_inwards[gate, gate_port] == pytest.approx(0.6)
    assert view.network.wire_utilisation[0] == pytest.approx(0.3)
    assert view.network.dropped[a, port_a] == 40
    assert view.network.max_queue_length[a, port_a] == 3
    assert not view.network.broken.any()
    tell(300, 40, flags=0)
    assert np.flatnonzero(view.network.broken).tolist() == [0]
    tell(400, 40, flags=0, dark=(a,))
    assert view.network.unreachable[a]
    assert not view.network.broken.any(), "a cell without power explains its links"
    view.update_statistics()
    view.apply(joints(1000, 0.0, 0.0), 0.0)
    view.update_statistics()
    assert view.traffic.series().dropped.sum() * 0.25 == 30


def test_without_the_hosts_loads_follow_from_what_was_delivered() -> None:
    view, atlas = scene()
    view.apply(topology(atlas, "arm"), 0.0)
    deepest = int(np.argmax(view.network.depth[:6]))
    for i in range(100):
        view.apply(event("arm", deepest, 0.1, t_ms=100 + i, seq=i), 0.0)
    view.update_statistics()
    # 100 packets of 8 bytes and 10 bits a byte in half a second, at 2 Mbit/s
    share = 100 * 80 / 2e6 / 0.5
    way, loaded = deepest, []
    while way >= 0:
        loaded.append(view.network.utilisation[way, view.network.master_port[way]])
        way = int(view.network.parent[way])
    assert loaded == pytest.approx([share] * len(loaded))
    assert np.count_nonzero(view.network.utilisation) == len(loaded), "every link on its way, and no other"
    view.apply(joints(2000, 0.0, 0.0), 0.0)
    view.update_statistics()
    assert not view.network.utilisation.any(), "that was long ago"


def regions(frames: list[tuple[int, list[tuple[float, ...]]]], seq: int = 0) -> Regions:
    """Frames of (board, regions of (force, ξ1, ξ2, area, peak, elements))."""
    heads = np.zeros(len(frames), dtype=SCAN_FRAME_ROW)
    bodies = np.zeros(sum(len(found) for _, found in frames), dtype=REGION_ROW)
    row = 0
    for head, (board, found) in zip(heads, frames, strict=True):
        head["board"], head["n_regions"] = board, len(found)
        head["t_sampled_ns"], head["t_delivered_ns"] = 4 * MS, 5 * MS
        for values in found:
            names = ("force_n", "xi1_m", "xi2_m", "area_m2", "peak_kpa", "n_elements")
            for name, value in zip(names, values, strict=True):
                bodies[row][name] = value
            row += 1
    return Regions(t_ns=4 * MS, watermark_ns=8 * MS, frames=heads.tobytes(), rows=bodies.tobytes(), seq=seq)


def test_regions_press_as_many_elements_as_they_have() -> None:
    view, atlas = scene(**SHEETS)
    inside = atlas.sheets[0]
    xi = inside.xi_m[0]
    area = 3 * inside.area_m2
    message = regions([(0, [(6.0, xi[0], xi[1], area, 9.0, 3)]), (1, [])])
    view.apply(told("regions", message, 4 * MS, "boards"), 0.0)
    pressure = view.skin.pressure_kpa()
    assert len(pressure) == atlas.n_elements == 14
    assert pressure[0] == 9.0, "the nearest has the peak"
    assert np.count_nonzero(pressure) == 3
    assert sorted(pressure)[-3:-1] == pytest.approx([1e-3 * 6.0 / area] * 2)
    assert view.skin.displayed_values(Modality.FORCE)[atlas.n_cells :].tolist() == pressure.tolist()
    assert view.events.since(0)[1].tolist() == [atlas.n_cells], "a row of the raster for each board"
    view.apply(told("regions", regions([(0, [])], seq=2), 8 * MS, "boards"), 0.0)
    assert not view.skin.pressure_kpa().any()
    assert view.n_malformed == 0


def test_a_raw_pattern_is_better_than_regions() -> None:
    view, atlas = scene(**SHEETS)
    rows = np.zeros(1, dtype=PATTERN_ROW)
    n = atlas.sheets[1].n_elements
    rows[0]["board"], rows[0]["n_elements"], rows[0]["t_sampled_ns"] = 1, n, 4 * MS
    rows[0]["pressure_kpa"][:n] = np.arange(n)
    message = Regions(t_ns=4 * MS, watermark_ns=8 * MS, frames=b"", rows=b"", patterns=rows.tobytes())
    view.apply(told("regions", message, 4 * MS, "boards"), 0.0)
    assert view.skin.pressure_kpa()[-n:].tolist() == list(range(n))


@given(
    blocks=st.lists(st.integers(1, 5), min_size=1, max_size=20),
    lost=st.sets(st.integers(0, 99)),
    seed=st.randoms(use_true_random=False),
)
def test_missing_numbers_are_counted_whatever_their_order_in_a_burst(
    blocks: list[int], lost: set[int], seed: Any
) -> None:
    """Each burst is a few messages that share the numbers of a period, in any order."""
    numbering, number = SequenceGaps(), 1
    numbering.add([0])
    for size in blocks:
        burst = [n for n in range(number, number + size) if n not in lost]
        number += size
        seed.shuffle(burst)
        for n in burst:
            numbering.add([n])
        numbering.count_missing()
    numbering.add([number])
    numbering.count_missing()
    assert numbering.count_missing() == len([n for n in lost if 0 < n < number])


def test_a_number_that_comes_late_is_not_missing() -> None:
    numbering = SequenceGaps()
    numbering.add([5, 6, 9])
    numbering.count_missing()
    assert numbering.count_missing() == 2
    numbering.add([7, 8])
    assert numbering.count_missing() == 0


def test_happenings_forget_what_is_old_and_no_more() -> None:
    happenings = EventHistory(window_ns=10)
    for t_ns in range(0, 40, 2):
        happenings.add([t_ns], [t_ns % 3], [FULL_READING_KIND])
    happenings.drop_old()
    t_ns, rows, kinds = happenings.since(30)
    assert t_ns.tolist() == [30, 32, 34, 36, 38]
    assert rows.tolist() == [t % 3 for t in t_ns.tolist()]
    assert set(kinds.tolist()) == {FULL_READING_KIND}
    assert happenings.since(0)[0].min() == 28
    assert happenings.n_events == 20


@given(
    latencies=st.lists(st.lists(st.integers(10_000, 900_000_000), max_size=30), min_size=2, max_size=8),
)
def test_trends_hold_the_quantiles_of_their_bins(latencies: list[list[int]]) -> None:
    bin_ns = 1_000_000_000
    trends = TrafficStatistics(bin_ns, 100)
    for number, late in enumerate(latencies):
        delivered = np.full(len(late), number * bin_ns + bin_ns // 2)
        trends.add_delivered(delivered - np.array(late, dtype=np.int64), delivered)
        trends.add_missed(number * bin_ns, number)
    trends.add_missed(len(latencies) * bin_ns, 0)
    trend = trends.series()
    counted = latencies[-len(trend.t_s) :]
    assert trend.delivered.tolist() == [len(late) for late in counted]
    for late, median, p95, most in zip(counted, trend.median_ms, trend.p95_ms, trend.max_ms, strict=True):
        if not late:
            assert np.isnan([median, p95, most]).all()
            continue
        assert most == pytest.approx(max(late) * 1e-6)
        for quantile, found in ((0.5, median), (0.95, p95)):
            true = float(np.quantile(late, quantile, method="inverted_cdf")) * 1e-6
            assert true * 0.999 <= found <= max(true * 1.13, true + 1e-9) or found == pytest.approx(most)


def test_trends_go_on_after_a_long_silence() -> None:
    trends = TrafficStatistics(10, 4)
    trends.add_missed(5, 7)
    trends.add_missed(1000, 3)
    trends.add_missed(1015, 1)
    trend = trends.series()
    assert (trend.missed * 1e-8).round().tolist()[-1] == 3
    assert (trend.missed * 1e-8).round().sum() == 3, "what was before has left"


def test_a_mind_notes_its_moves_and_why() -> None:
    mind = ControllerView()
    assert mind.states == ()
    mind.apply_stage(MS, "forming")
    mind.apply_state(ControllerState(t_ns=2 * MS, stage="session.idle", progress=0.0))
    mind.apply_stage(3 * MS, "session.open")
    mind.apply_state(ControllerState(t_ns=4 * MS, stage="session.open", progress=0.2, text="patted"))
    mind.apply_state(ControllerState(t_ns=5 * MS, stage="session.safe", progress=0.2, text="pain"))
    assert [(m.source, m.target, m.reason) for m in mind.history] == [
        ("forming", "session.idle", ""),
        ("session.idle", "session.open", "patted"),
        ("session.open", "session.safe", "pain"),
    ]
    assert (mind.state, mind.since_ns, mind.reason) == ("session.safe", 5 * MS, "pain")
    assert mind.states == ("forming", "session.idle", "session.open", "session.safe")
    assert ("session.open", "pain", "session.safe") in mind.transitions
    mind.description = StateMachineDescription(
        t_ns=0, states=["session.safe", "session.idle"], transitions=[["a", "b", "c"], ["odd"]]
    )
    assert mind.states[:2] == ("session.safe", "session.idle"), "the controller's order, then the others"
    assert mind.transitions == (("a", "b", "c"),)


def test_processes_have_loads_and_rates() -> None:
    machinery = ProcessStats()
    machinery.apply_load(ProcessLoad(t_ns=0, name=["body"], pid=[7], cores=[0.5], memory_mb=[90.0]))
    machinery.on_message("body", 0, 10.0)
    machinery.update_rates(10.0)
    assert machinery.processes["body"].real_time_factor is None
    machinery.on_message("body", 3_000_000_000, 12.0)
    machinery.update_rates(12.0)
    assert machinery.processes["body"].real_time_factor == 1.5
    machinery.update_rates(13.0)
    assert machinery.processes["body"].real_time_factor == 1.5, "it just has nothing new to say"
    machinery.update_rates(16.0)
    assert machinery.processes["body"].real_time_factor is None
    machinery.on_message("body", 1_000_000_000, 17.0)
    machinery.update_rates(17.0)
    assert machinery.processes["body"].real_time_factor is None, "time went back: a recording begins anew"


def test_a_scene_comes_back_to_what_it_was() -> None:
    view, atlas = scene()
    for message in (topology(atlas, "arm"), event("arm", 2, 0.3), joints(5, 0.1, 0.2), state(6, "home")):
        view.apply(message, 0.0)
    kept = view.snapshot()
    reading = view.skin.reading.copy()
    for message in (
        topology(atlas, "arm", 2),
        event("arm", 1, 0.9, t_ms=9),
        joints(10, 1.0, 2.0),
        state(11, "x"),
    ):
        view.apply(message, 0.0)
    for _ in range(2):  # what was kept stays what it was
        view.restore(kept)
        np.testing.assert_array_equal(view.skin.reading, reading)
        assert (view.t_ns, view.position_rad, view.controller.state) == (6 * MS, [0.1, 0.2], "home")
        assert not view.network.unreachable.any()
        assert not len(view.events.since(0)[0])
        view.apply(event("arm", 0, 0.5, t_ms=20), 0.0)


def test_what_moves_freely_is_known_from_the_world() -> None:
    view, _ = scene()
    for t_ms, name in ((5, "object"), (10, "finger")):
        message = FreeBodyPoses(t_ns=t_ms * MS, watermark_ns=0, poses={name: [0.0] * 7})
        view.apply(told("free_bodies", message, t_ms * MS), 0.0)
    assert set(view.free_body_poses) == {"object", "finger"}


def test_losses_that_only_hosts_count_are_losses() -> None:
    view, _ = scene()
    for t_ms, lost in ((1000, 3), (2000, 10), (2600, 10)):
        counts = {"event.queue_full": lost, "event.delivered": 1000 * lost, "event.offered": 2000}
        message = Counters(process="cells0", t_ns=t_ms * MS, counts=counts)
        view.apply(told("counters", message, t_ms * MS), 0.0)
    assert view.traffic.series().dropped.sum() * 0.25 == 7


def test_a_recording_of_the_loop_has_commands_for_states() -> None:
    view, _ = scene()
    for t_ms, stage in ((5, "map"), (10, "map"), (15, "evade")):
        command = Command(t_ns=t_ms * MS, effect_ns=0, watermark_ns=0, velocity_rad_s=[0.0, 0.0], stage=stage)
        view.apply(told("command", command, t_ms * MS), 0.0)
    assert [(m.source, m.target) for m in view.controller.history] == [("map", "evade")]


def test_without_a_machine_the_deployment_says_which_states_there_are() -> None:
    stages = {"home": {"kind": "posture"}, "talk": {"kind": "teach_and_grasp"}}
    view, _ = scene(controller={"program": ("home", "talk"), "stages": stages})
    assert view.controller.states[:3] == ("forming", "home", "talk.idle")
    assert "talk.safe" in view.controller.states
    view.apply(state(5, "talk.idle"), 0.0)
    view.apply(state(6, "talk.odd", "why"), 0.0)
    assert view.controller.states[-1] == "talk.odd"
    assert view.controller.transitions == (("talk.idle", "why", "talk.odd"),)
