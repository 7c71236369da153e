"""A recording opens with the plain reader, holds all that was said, in one order, and says what it means."""

import itertools
import json
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from launching import run
from mcap.reader import make_reader
from protobuf_wire import Schema
from recorded import ARM, SHORT, SHORT_ARM, Plain, plain, record, recorded_once

from skinnet.body.visual_shapes import VisualModel
from skinnet.protocol.channels import CHANNELS, Keys
from skinnet.protocol.messages import ControllerState, Events, PeriodEnd, Stream, decode
from skinnet.protocol.telemetry_messages import StateMachineDescription
from skinnet.recording.process import build
from skinnet.recording.reader import RecordedMessage, Recording

pytestmark = pytest.mark.timeout(300)
FOXGLOVE = ("foxglove.FrameTransforms", "foxglove.SceneUpdate", "foxglove.Log")


@pytest.fixture(scope="module", params=SHORT)
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A recorded run of each kind: its folder, its summary, and what is in the file."""
    folder, summary = recorded_once(request.param, tmp_path_factory)
    return folder, summary, plain(folder / "run.mcap")


def test_counts_are_those_of_the_summary_and_nothing_is_lost(recorded: Any) -> None:
    folder, summary, messages = recorded
    own = Recording(folder / "run.mcap")
    keys = Keys(own.robot)
    counts = Counter(keys.parse(m.topic)[0].name for m in messages if m.topic.startswith(keys.prefix))
    figures = summary["metrics"]
    told = {k.rpartition(".")[2]: n for k, n in figures.items() if k.startswith("recording.messages.")}
    assert counts == told
    assert figures["recording.bytes"] == (folder / "run.mcap").stat().st_size
    with (folder / "run.mcap").open("rb") as file:
        statistics = make_reader(file).get_summary().statistics
    assert statistics.message_count == len(messages)
    deployment = own.deployment()
    end_ns = round(summary["sim_s"] * 1e9)
    assert counts["joints"] == counts["free_bodies"] == end_ns // deployment.body.joint_state_period_ns + 1
    controller = json.loads((folder / "deployment.json").read_text())["controller"]
    assert controller == own.deployment_dict["controller"]
    for patch in deployment.patches:
        frames: list[Stream | PeriodEnd] = []
        n_events = n_topologies = 0
        for m in own.messages():
            if m.channel in ("period_end", "stream") and m.fields == (patch.name,):
                frames.append(decode(m.payload, Stream if m.channel == "stream" else PeriodEnd))
            elif m.channel == "events" and m.fields[0] == patch.name:
                n_events += len(decode(m.payload, Events).cell)
            elif m.channel == "topology" and m.fields == (patch.name,):
                n_topologies += 1
        assert [frame.watermark_ns for frame in frames[:-1]] == [frame.t_ns for frame in frames[1:]]
        assert (frames[0].t_ns, frames[-1].watermark_ns) == (0, end_ns)
        assert sum(frame.n_events for frame in frames) == n_events + n_topologies


def test_the_states_that_there_are_are_known_before_the_first(recorded: Any) -> None:
    folder, _, _ = recorded
    said = [m for m in Recording(folder / "run.mcap").messages() if m.channel in ("state_machine", "state")]
    (machine,) = [decode(m.payload, StateMachineDescription) for m in said if m.channel == "state_machine"]
    stages = [decode(m.payload, ControllerState).stage for m in said if m.channel == "state"]
    assert machine.t_ns == 0
    assert set(stages) <= set(machine.states)
    moves = {(one, other) for one, _, other in machine.transitions}
    changes = {(one, other) for one, other in itertools.pairwise(stages) if one != other}
    assert changes
    assert changes <= moves


def test_messages_are_in_the_order_of_time_and_numbered(recorded: Any) -> None:
    _, _, messages = recorded
    assert [m.t_ns for m in messages] == sorted(m.t_ns for m in messages)
    topics: dict[str, list[int]] = {}
    for m in messages:
        topics.setdefault(m.topic, []).append(m.sequence)
    assert all(numbers == list(range(1, len(numbers) + 1)) for numbers in topics.values())


def test_messages_are_what_their_schemas_say(recorded: Any) -> None:
    folder, _, messages = recorded
    with (folder / "run.mcap").open("rb") as file:
        schemas = {s.name: s for s in make_reader(file).get_summary().schemas.values()}
    kinds = {f"skinnet.{row.message.__name__}": row.message for row in CHANNELS}
    assert set(schemas) <= {*kinds, *FOXGLOVE}
    of = {name: Schema(s.data) for name, s in schemas.items() if name in FOXGLOVE}
    rules = {name: json.loads(s.data) for name, s in schemas.items() if name in kinds}
    seen: Counter[str] = Counter()
    for m in messages:
        if m.schema in kinds:
            decode(m.payload, kinds[m.schema])
            if seen[m.schema] < 300:
                conforms(msgspec.msgpack.decode(m.payload), rules[m.schema], rules[m.schema])
        elif seen[m.schema] < 100:
            of[m.schema].decode(m.schema, m.payload)
        seen[m.schema] += 1
    assert seen["foxglove.FrameTransforms"] > 10
    assert seen["foxglove.Log"] > 0


def conforms(value: Any, rule: dict[str, Any], root: dict[str, Any]) -> None:
    """As much of JSON Schema as messages need; bytes stand for base64."""
    if "$ref" in rule:
        conforms(value, root["$defs"][rule["$ref"].rpartition("/")[2]], root)
        return
    if "anyOf" in rule:
        assert any(_holds(value, option, root) for option in rule["anyOf"])
        return
    if "enum" in rule:
        assert value in rule["enum"]
        return
    python = {
        "object": dict,
        "array": list,
        "string": (str, bytes),
        "integer": int,
        "number": (int, float),
        "boolean": bool,
        "null": type(None),
    }[rule["type"]]
    assert isinstance(value, python)
    if rule["type"] == "object":
        assert set(rule.get("required", ())) <= set(value)
        for name, item in value.items():
            inner = rule.get("properties", {}).get(name, rule.get("additionalProperties"))
            assert inner is not None, name
            conforms(item, inner, root)
    elif rule["type"] == "array":
        for item in value[:20]:
            conforms(item, rule["items"], root)


def _holds(value: Any, rule: dict[str, Any], root: dict[str, Any]) -> bool:
    try:
        conforms(value, rule, root)
    except AssertionError:
        return False
    return True


def test_foxglove_shows_the_body_and_a_primitive_for_each_cell(recorded: Any) -> None:
    folder, _, messages = recorded
    own = Recording(folder / "run.mcap")
    deployment = own.deployment()
    with (folder / "run.mcap").open("rb") as file:
        schemas = {
            s.name: Schema(s.data)
            for s in make_reader(file).get_summary().schemas.values()
            if s.encoding == "protobuf"
        }

    def shown(topic: str) -> list[dict[str, Any]]:
        return [schemas[m.schema].decode(m.schema, m.payload) for m in messages if m.topic == topic]

    (robot,) = shown("/robot")
    frames = {t["child_frame_id"] for t in shown("/tf")[0]["transforms"]}
    assert {entity["frame_id"] for entity in robot["entities"]} <= frames | {"world"}
    looks = VisualModel(deployment, own.base).shapes
    primitives_of = ("cubes", "spheres", "cylinders", "triangles")
    drawn = [p["color"] for e in robot["entities"] for kind in primitives_of for p in e.get(kind, ())]
    told = {tuple(colour.get(part, 0.0) for part in "rgba") for colour in drawn}
    assert told == {tuple(shape.rgba.tolist()) for shape in looks}, "as MuJoCo draws them, with materials"
    scenes = shown("/scene")
    primitives = [
        [p for entity in scene["entities"] for p in (*entity.get("cylinders", ()), *entity.get("cubes", ()))]
        for scene in scenes
    ]
    n_cells = sum(patch.n_cells for patch in deployment.patches)
    assert {len(row) for row in primitives} == {n_cells} if n_cells else {len(primitives[0])}
    colours = np.array(
        [[(p["color"]["r"], p["color"]["g"], p["color"]["b"]) for p in row] for row in primitives]
    )
    assert ((colours >= 0.0) & (colours <= 1.0)).all()
    assert len(scenes) > 1, "something was touched"
    assert all((one != other).any() for one, other in itertools.pairwise(colours))
    assert shown("/log")[0]["message"]


def test_colours_are_those_of_touch(recorded: Any) -> None:
    """What is pressed is red, what is not is dark."""
    from skinnet.recording.skin_scene import _colours

    dark, near, pressed = _colours(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert pressed[0] > 0.8
    assert near[2] > 0.8
    assert dark.max() < 0.25


def interleaved(messages: list[RecordedMessage], rng: np.random.Generator) -> list[RecordedMessage]:
    """What one process and its neighbours say in another order; each its own in the old one."""
    queues: dict[str, list[RecordedMessage]] = {}
    for m in messages:
        sender = {"skin": "skin" + m.fields[0] if m.fields else "", "process": "process" + "".join(m.fields)}
        head = m.key.split("/")[2]
        who = "controller" if m.channel in ("command", "config") else sender.get(head, head)
        queues.setdefault(who, []).append(m)
    mixed = []
    while queues:
        who = str(rng.choice(sorted(queues)))
        take = int(rng.integers(1, 40))
        mixed += queues[who][:take]
        del queues[who][:take]
        if not queues[who]:
            del queues[who]
    return mixed


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_arrival_changes_nothing(recorded: Any, tmp_path: Path, seed: int) -> None:
    folder, _, messages = recorded
    own = Recording(folder / "run.mcap")
    node = build(own.deployment(), "recorder", own.base, tmp_path)
    node.start(_nowhere)
    heard = [m for m in own.messages() if m.channel != "fault"]
    counters = [m for m in heard if m.channel == "counters"]
    for m in counters:
        node.accept(m.channel, m.fields, m.payload)
    for m in interleaved([m for m in heard if m.channel != "counters"], np.random.default_rng(seed)):
        node.accept(m.channel, m.fields, m.payload)
        while (needs := node.needs()) is not None and all(
            node.upstreams[name].watermark_ns >= t_ns for name, t_ns in needs.items()
        ):
            node.step(_nowhere)
    assert node.needs() is None
    assert plain(tmp_path / "run.mcap") == messages


def _nowhere(_key: str, _payload: bytes) -> None:
    """A recorder says nothing."""


@pytest.mark.processes
def test_a_recorder_changes_nothing_and_processes_neither(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    without = run(ARM, tmp_path / "without", "--in-process", settings=SHORT_ARM)
    folder, one = recorded_once("arm", tmp_path_factory)
    many = record("arm", tmp_path / "many")
    assert without["log_sha256"] == one["log_sha256"] == many["log_sha256"]
    assert {p["name"] for p in many["processes"]} == {"body", "cells0", "cells1", "controller", "recorder"}
    first: list[Plain] = plain(folder / "run.mcap")
    assert first == plain(tmp_path / "many" / "run.mcap")
    counted = {k: v for k, v in one["metrics"].items() if "bytes" not in k}
    assert counted == {k: v for k, v in many["metrics"].items() if "bytes" not in k}
    assert without["metrics"] == {k: v for k, v in counted.items() if not k.startswith("recording.")}


def test_faults_and_topologies_are_in_the_record(tmp_path: Path) -> None:
    cut = 'faults=[{kind="link_cut", target="base/0:1", at_s=0.5, duration_s=0.5}]'
    record("arm", tmp_path, "--in-process", settings=(cut,))
    messages = [
        (m.channel, m.t_ns, msgspec.msgpack.decode(m.payload))
        for m in Recording(tmp_path / "run.mcap").messages()
    ]
    faults = [(t_ns, m["kind"], m["begins"]) for channel, t_ns, m in messages if channel == "fault"]
    assert [(t, b) for t, _, b in faults] == [(500_000_000, True)] * 2 + [(1_000_000_000, False)] * 2
    versions = [m["version"] for channel, _, m in messages if channel == "topology" and m["patch"] == "base"]
    assert versions == sorted(set(versions))
    assert len(versions) > 1
