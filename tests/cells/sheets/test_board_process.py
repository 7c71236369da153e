"""The host of boards and the nursing node at the ends of their wires."""

from typing import Any

import numpy as np
import pytest
from launching import skinnet
from locations import DEPLOYMENTS
from small_robot import small

from cells.sheets.board_process import BoardProcess
from controller.nursing.contacts.board_input import BoardInput, sheet_surfaces
from skinnet.deployment import Deployment
from skinnet.deployment.checks import check
from skinnet.errors import DeploymentError, ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Config, decode, encode, unpack
from skinnet.protocol.sheet_messages import PATTERN_ROW, REGION_ROW, SCAN_FRAME_ROW, Pressures, Regions
from skinnet.skin.tactile_sheets import place_sheets

PERIOD_NS = 4_000_000
SURFACES = (
    {
        "name": "left",
        "body": "arm",
        "origin_m": (0.0, 0.0, 0.0),
        "normal": (0.0, 0.0, 1.0),
        "up": (0.0, 1.0, 0.0),
    },
)
SHEETS = (
    {"name": "a", "surface": "left", "centre_xi_m": (0.0, 0.086), "rows": 4, "columns": 4},
    {"name": "b", "surface": "left", "centre_xi_m": (0.0, 0.0), "rows": 4, "columns": 4},
)


def skinned(**tables: Any) -> Deployment:
    return small(patches=(), surfaces=SURFACES, sheets=SHEETS, **tables)


def pressed(*elements: int) -> bytes:
    kpa = np.zeros(32, dtype="<f4")
    kpa[list(elements)] = 30.0
    return kpa.tobytes()


def told(node: BoardProcess, *frames: bytes) -> list[Regions]:
    sent: list[tuple[str, bytes]] = []
    for i, values in enumerate(frames):
        message = Pressures(t_ns=i * PERIOD_NS, watermark_ns=i * PERIOD_NS, values=values)
        node.accept("pressures", (), encode(message))
        if i:
            assert node.needs() == {"body": i * PERIOD_NS}
            node.step(lambda key, payload: sent.append((key, payload)))
    assert {key for key, _ in sent} <= {Keys("bot").of("regions", "boards")}
    return [decode(payload, Regions) for _, payload in sent]


def test_what_is_pressed_is_told_and_every_period_is_closed() -> None:
    node = BoardProcess(skinned(), "boards")
    regions = told(node, *[pressed(5, 6, 21)] * 6)
    assert [(r.t_ns, r.watermark_ns) for r in regions] == [
        (i * PERIOD_NS, (i + 1) * PERIOD_NS) for i in range(5)
    ]
    frames = np.concatenate([unpack(r.frames, SCAN_FRAME_ROW) for r in regions])
    rows = np.concatenate([unpack(r.rows, REGION_ROW) for r in regions])
    assert int(frames["n_regions"].sum()) == len(rows)
    area_m2 = 0.0215**2
    for board, n in ((0, 2), (1, 1)):
        last = rows[rows["board"] == board][-1]
        assert last["force_n"] == pytest.approx(n * 30e3 * area_m2, rel=0.02)
        assert last["n_elements"] == n
    assert [r.seq for r in regions] == np.cumsum(
        [0, *(len(unpack(r.frames, SCAN_FRAME_ROW)) for r in regions)]
    )[:-1].tolist()
    counters = node.result().facts["boards"]["regions"]
    assert counters["offered"] == counters["delivered"] + counters["in_flight"]


def test_pressures_of_another_skin_are_refused() -> None:
    node = BoardProcess(skinned(), "boards")
    with pytest.raises(ProtocolError, match="3 elements; the sheets have 32"):
        node.accept("pressures", (), encode(Pressures(t_ns=0, watermark_ns=0, values=bytes(12))))
    with pytest.raises(ProtocolError, match="does not subscribe"):
        node.accept("stimulus", (), b"")


def test_a_raw_pattern_comes_to_who_asks_for_it() -> None:
    node = BoardProcess(skinned(), "boards")
    node.accept("config", ("boards", "1"), encode(Config(patch="boards", cell=1, pattern_interval_scans=2)))
    patterns = np.concatenate([unpack(r.patterns, PATTERN_ROW) for r in told(node, *[pressed(21)] * 9)])
    assert set(patterns["board"]) == {1}
    assert set(np.diff(patterns["scan_index"])) == {2}
    assert patterns["pressure_kpa"][-1].argmax() == 21 - 16
    assert node.counters["external_configs"] == 1
    for wrong in (
        {"cell": 2, "pattern_interval_scans": 1},
        {"cell": 0},
        {"cell": 0, "pattern_interval_scans": -1},
    ):
        with pytest.raises(ProtocolError, match="config of board"):
            node.accept("config", ("boards", "0"), encode(Config(patch="boards", **wrong)))  # type: ignore[arg-type]


def test_a_contact_over_the_seam_of_two_boards_is_one() -> None:
    deployment = skinned()
    sheets = place_sheets(deployment.surfaces, deployment.sheets)
    ear = BoardInput(sheets, merge_distance_m=0.043)
    bottom_of_a, top_of_b = 13, 16 + 1  # neighbours across the seam
    assert np.linalg.norm(sheets[0].xi_m[13] - sheets[1].xi_m[1]) < 0.043
    for message in told(BoardProcess(deployment, "boards"), *[pressed(bottom_of_a, top_of_b)] * 4):
        ear.add(message)
    assert ear.latest_input(0) is None
    felt = ear.latest_input(12_000_000)
    assert felt is not None
    (region,) = felt.regions
    assert region.sheet == "left"
    assert region.force_n == pytest.approx(2 * 30e3 * 0.0215**2, rel=0.02)
    middle = 0.5 * (sheets[0].xi_m[13] + sheets[1].xi_m[1])
    np.testing.assert_allclose(region.xi_m, middle, atol=1e-3)


def test_nothing_is_taken_before_its_time() -> None:
    deployment = skinned()
    ear = BoardInput(place_sheets(deployment.surfaces, deployment.sheets), merge_distance_m=0.043)
    messages = told(BoardProcess(deployment, "boards"), *[pressed(5)] * 8)
    for message in reversed(messages[:1]):
        ear.add(message)
    for message in messages[1:]:
        ear.add(message)
    last = -1
    for t_ns in range(0, 8 * PERIOD_NS, 1_000_000):
        felt = ear.latest_input(t_ns)
        if felt is not None:
            assert last <= felt.t_ns < t_ns
            last = felt.t_ns
    assert ear.received_frames == sum(len(unpack(m.frames, SCAN_FRAME_ROW)) for m in messages)


def test_messages_that_contradict_themselves_are_refused() -> None:
    deployment = skinned()
    ear = BoardInput(place_sheets(deployment.surfaces, deployment.sheets), merge_distance_m=0.043)
    frame = np.zeros(1, dtype=SCAN_FRAME_ROW)
    frame["board"] = 7
    with pytest.raises(ProtocolError, match="board 7; there are 2"):
        ear.add(Regions(t_ns=0, watermark_ns=0, frames=frame.tobytes(), rows=b""))
    frame["board"], frame["n_regions"] = 0, 1
    with pytest.raises(ProtocolError, match="0 region records, but the frame records count 1"):
        ear.add(Regions(t_ns=0, watermark_ns=0, frames=frame.tobytes(), rows=b""))


def test_the_controller_knows_one_sheet_for_each_surface() -> None:
    deployment = skinned()
    sheets = place_sheets(deployment.surfaces, deployment.sheets)
    (sheet,) = sheet_surfaces(sheets, height_m=0.012).values()
    point = sheet.surface_point((0.0, 0.043))
    np.testing.assert_allclose(point.position_m, (0.0, 0.043, 0.012), atol=1e-9)
    np.testing.assert_allclose(point.R_body_surface, np.eye(3), atol=1e-9)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"patches": (), "surfaces": (), "sheets": ()}, "no skin; give"),
        ({"boards": {"period_ms": 2.0}}, "boards.period_ms = 2"),
        ({"controller": {"program": (), "stages": {}}}, "give a program"),
        ({"nursing": {"joints": ("knee",)}}, "'knee' is not in body.joints"),
        (
            {"nursing": {"weights": {"foot": {}}}},
            "weights.foot: no such surface or body; there are arm, left",
        ),
        (
            {"nursing": {"assumed_contacts": ({"surface": "foot"},), "feedback": "none"}},
            "unknown surface 'foot'",
        ),
    ],
)
def test_what_does_not_fit_is_refused(tables: dict[str, Any], said: str) -> None:
    if "nursing" in tables:
        walk = {"joints": ("elbow",), "waypoints": ({"t_s": 1.0},)}
        tables = {"nursing": walk | tables["nursing"], "controller": {"program": (), "stages": {}}}
    with pytest.raises(DeploymentError, match=said):
        check(small(**({"patches": (), "surfaces": SURFACES, "sheets": SHEETS} | tables)))


@pytest.mark.parametrize("command", ["plan", "stress"])
def test_commands_about_cells_refuse_a_skin_of_sheets(command: str) -> None:
    file = DEPLOYMENTS / "riba_cylinder.toml"
    done = skinnet(command, str(file), "--no-plots")
    assert done.returncode == 2
    assert "patches: none" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
