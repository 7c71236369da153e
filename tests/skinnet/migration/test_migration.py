"""Files that earlier versions wrote: read under the present names, and rewritten by `skinnet migrate`.

`data/format_1` has what the last version with format 1 wrote: its deployments, short recordings of each and
one with faults, summaries of their whole runs, of several seeds, of a run with losses and of a sweep, and a
memory of a cut-down robot in SQLite and JSON. `deployment_keys.txt` lists its schema: keys, and their values
that are names.
"""

import copy
import json
import logging
import shutil
import sqlite3
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from launching import run, started
from locations import DATA, ROOT
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata
from memory_sql import sql
from msgspec import inspect as reflect
from recorded import plain
from typer.testing import CliRunner
from value_hash import value_hash

from skinnet.analysis.report.run_folder import RunResults, SeedResults, StressResults, read_run_folder
from skinnet.cli.main import app
from skinnet.deployment import Deployment, load, resolved_json
from skinnet.deployment.load import from_document
from skinnet.deployment.memory_loading import read_memory_json
from skinnet.errors import (
    DeploymentError,
    FormatError,
    MemoryFileError,
    RecordingError,
    RunFolderError,
    SkinnetError,
)
from skinnet.memory.sqlite_store import MemoryStore, read_memory
from skinnet.migration import deployments, format_1
from skinnet.migration.memories import current_parameter, translate_parameters
from skinnet.migration.recordings import MessageTranslator
from skinnet.migration.summaries import current_metric, translate_summary
from skinnet.protocol import (
    external_messages,
    messages,
    recorded_messages,
    sheet_messages,
    telemetry_messages,
)
from skinnet.protocol.channels import Keys, channel
from skinnet.protocol.messages import Message, decode, encode
from skinnet.recording.format import json_schema, schema_name
from skinnet.recording.reader import Recording
from skinnet.recording.replay import replay_into, with_memory
from skinnet.tools.migrate.deployment_toml import migrated_toml
from skinnet.tools.migrate.files import migration_of
from skinnet.view.sources.recording_source import RecordingSource
from skinnet.view.state.run_state import RunState
from skinnet.view.state.skin_layout import build_skin_layout

pytestmark = pytest.mark.timeout(300)

OLD = DATA / "format_1"
SHIPPED = ROOT / "deployments"
NAMES = tuple(sorted(path.stem for path in (OLD / "deployments").glob("*.toml")))
RECORDINGS = tuple(sorted(path.stem for path in (OLD / "recordings").glob("*.mcap")))
FAULTS = (
    'faults=[{kind="stuck_at",target="upper_link/1",at_s=0.1,duration_s=0.2,channel="force0"},'
    '{kind="babbling_idiot",target="base/1",at_s=0.2,rate_hz=500.0,duration_s=0.1},'
    '{kind="slow_process",target="cells1",at_s=0.1,duration_s=0.1,added_delay_ms=1.0},'
    '{kind="bit_errors",target="base",at_s=0.1,bit_error_rate=1e-5}]'
)


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A copy of all old files, which nothing has been remarked upon yet."""
    return shutil.copytree(OLD, tmp_path / "format_1")


def migrate(*arguments: object) -> tuple[int, list[str], list[str]]:
    """Exit code of `skinnet migrate`, its lines, and its lines on standard error."""
    result = CliRunner().invoke(app, ["migrate", *map(str, arguments)])
    if isinstance(result.exception, SkinnetError):  # the program makes a line of it
        return 2, [], [f"skinnet: {result.exception}"]
    return result.exit_code, result.stdout.splitlines(), result.stderr.splitlines()


def remarks(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_there_is_a_file_of_each_shipped_deployment() -> None:
    shipped = {path.stem for path in SHIPPED.glob("*.toml")}
    assert set(NAMES) >= shipped
    assert set(RECORDINGS) == {*NAMES, "faults"}
    assert sum(path.stat().st_size for path in OLD.rglob("*") if path.is_file()) < 1_500_000


# --- deployments


def renamed_stage(deployment: Deployment) -> Deployment:
    """The deployment as it is shipped today: the stage that old hrp2 files called session has another name.

    The listening robots, ur5 and h1, repeat no levels; old files did not have the key.
    """
    text = resolved_json(deployment).replace(b'"session', b'"teach_and_grasp')
    document = msgspec.json.decode(text)
    if deployment.name in ("ur5_260", "h1_1260"):
        document["cells"]["encoding"]["repeat_ms"] = 0
    return from_document(document, deployment.name)


@pytest.mark.parametrize("name", NAMES)
def test_an_old_deployment_is_the_shipped_one_and_is_remarked_upon_once(
    name: str, old: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = old / "deployments" / f"{name}.toml"
    for _ in range(2):
        assert renamed_stage(load(file)) == load(SHIPPED / f"{name}.toml")
    (remark,) = remarks(caplog)
    assert remark.startswith(f"{file}: deployment of an earlier format")


@pytest.mark.parametrize("name", NAMES)
def test_a_migrated_deployment_keeps_comments_order_and_layout(name: str, tmp_path: Path) -> None:
    before = (OLD / "deployments" / f"{name}.toml").read_text()
    after = migrated_toml(before, name)
    assert migrated_toml(after, name) == after
    at = after.split("\n").index("format = 2")
    lines = after.split("\n")[:at] + after.split("\n")[at + 1 :]
    changed = [pair for pair in zip(before.split("\n"), lines, strict=True) if pair[0] != pair[1]]
    keys = deployments.translate(tomllib.loads(before), name)[1]
    assert len(changed) > 0
    assert keys > 0
    assert all(one.partition("#")[2] == other.partition("#")[2] for one, other in changed)
    (tmp_path / "new.toml").write_text(after)
    assert renamed_stage(load(tmp_path / "new.toml")) == load(SHIPPED / f"{name}.toml")


AWKWARD = """# the head
# of the file

extends = "base.toml"
"hosts" = {  a = [ "x" ] } # who runs what

[body]   # a comment with [brackets] = and "quotes"
reference = 'torso'
home_rad = { "a.b" = 1.0, 'c' = [1,
  2, # two
] }
[[sheets]]
name = "one"
middle_xi_m = [0.0, 0.0]
[[surfaces]]
name = "s"
[[sheets]]
name = "two" # the other
joins_gaps = true
[controller . stages]
"listen" = { kind = "listen", accuracy_rad = 0.1 }
[[faults]]
kind = \"\"\"stuck\"\"\"
target = 'a\\b'
"""


def test_a_deployment_is_edited_where_its_keys_stand() -> None:
    after = migrated_toml(AWKWARD, "x")
    expected = AWKWARD
    for one, other in (
        ('\nextends = "base', '\nformat = 2\nextends = "base'),
        ('"hosts"', "cell_processes"),
        ("reference =", "reference_body ="),
        ("middle_xi_m", "centre_xi_m"),
        ("joins_gaps", "connect_across_gaps"),
        ('kind = "listen", accuracy_rad', 'kind = "passive", tolerance_rad'),
        ('"""stuck"""', '"stuck_at"'),
    ):
        expected = expected.replace(one, other)
    assert after == expected


def table_paths(path: str, kind: Any) -> Iterator[str]:
    """Keys below a type of the schema, as `deployment_keys.txt` has them."""
    match kind:
        case reflect.StructType():
            if kind.tag is not None:
                yield f"{path}.{kind.tag_field} = {kind.tag}"
            for field in kind.fields:
                own = f"{path}.{field.encode_name}".lstrip(".")
                yield own
                yield from table_paths(own, field.type)
        case reflect.UnionType():
            yield from chain.from_iterable(table_paths(path, one) for one in kind.types)
        case reflect.ListType() | reflect.VarTupleType():
            yield from table_paths(f"{path}[]", kind.item_type)
        case reflect.DictType():
            yield from table_paths(f"{path}.*", kind.value_type)
        case reflect.LiteralType():
            yield from (f"{path} = {value}" for value in kind.values)


def present_path(line: str) -> str:
    """Present form of a line of `deployment_keys.txt`."""
    path, equals, value = line.partition(" = ")
    numbered = path.replace("[]", ".0")
    current = (deployments.current_name(numbered) or numbered).replace(".0", "[]")
    values = deployments.DEPLOYMENT_VALUES.get(path, {})
    return f"{current}{equals}{values.get(value, value)}"


def test_every_old_key_and_value_has_a_present_name() -> None:
    present = set(table_paths("", reflect.type_info(Deployment)))
    lines = (OLD / "deployment_keys.txt").read_text().splitlines()
    assert [line for line in lines if present_path(line) not in present] == []
    old_paths = {line.partition(" = ")[0] for line in lines}
    assert [path for path in deployments.DEPLOYMENT_KEYS if path not in old_paths] == []


@pytest.mark.parametrize("lost", ["hosts", "body.reference", "controller.stages.*.kind"])
def test_a_vocabulary_that_lacks_an_entry_is_noticed(lost: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for table in ("DEPLOYMENT_KEYS", "DEPLOYMENT_VALUES"):
        entries = getattr(deployments, table)
        monkeypatch.setattr(deployments, table, {old: new for old, new in entries.items() if old != lost})
    deployments.forget_names()
    try:
        with pytest.raises(DeploymentError, match=r"unknown key|allowed:"):
            load(OLD / "deployments" / "hrp2_teach.toml")
        with pytest.raises(AssertionError):
            test_every_old_key_and_value_has_a_present_name()
    finally:
        monkeypatch.undo()
        deployments.forget_names()
    load(OLD / "deployments" / "hrp2_teach.toml")


def test_an_old_key_beside_its_present_name_is_refused() -> None:
    raw = {"body": {"reference": "torso", "reference_body": "chest"}}
    with pytest.raises(FormatError, match=r"^x: body\.reference is called reference_body now; give only one"):
        deployments.translate(raw, "x")


STEPS = sorted({step for key in format_1.DEPLOYMENT_KEYS for step in key.replace("[]", "").split(".")})
documents = st.recursive(
    st.integers(),
    lambda inner: (
        st.dictionaries(st.sampled_from([*STEPS, "any"]), inner, max_size=4) | st.lists(inner, max_size=3)
    ),
    max_leaves=12,
)


def leaves(value: Any) -> Counter[int]:
    match value:
        case dict():
            return sum((leaves(item) for item in value.values()), Counter())
        case list():
            return sum((leaves(item) for item in value), Counter())
    return Counter([value])


@st.composite
def along_the_vocabulary(draw: st.DrawFn) -> dict[str, Any]:
    """A document with a value at some paths of the vocabulary, and others beside."""
    document: dict[str, Any] = draw(st.dictionaries(st.sampled_from(STEPS), documents, max_size=2))
    for path in draw(st.lists(st.sampled_from(sorted(format_1.DEPLOYMENT_KEYS)), max_size=5)):
        node: Any = document
        *tables, last = path.replace("*", "any").split(".")
        for step in tables:
            name = step.removesuffix("[]")
            below = node.get(name)
            if not isinstance(below, dict):
                below = node[name] = {}
            node = below
        node[last.removesuffix("[]")] = draw(st.integers())
    return document


@given(along_the_vocabulary())
def test_translation_drops_nothing_and_is_done_once(raw: dict[str, Any]) -> None:
    before = copy.deepcopy(raw)
    try:
        document, count = deployments.translate(raw, "x")
    except FormatError:  # an old key beside its present name
        return
    assert raw == before
    assert leaves(document) == leaves(raw)
    assert (document != raw) == (count > 0)
    assert deployments.translate(document, "x") == (document, 0)


# --- recordings


@pytest.fixture(params=RECORDINGS)
def recorded(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return Path(shutil.copy(OLD / "recordings" / f"{request.param}.mcap", tmp_path / f"{request.param}.mcap"))


def attached(path: Path) -> tuple[list[Attachment], list[Metadata]]:
    with path.open("rb") as file:
        reader = make_reader(file)
        return list(reader.iter_attachments()), list(reader.iter_metadata())


def test_an_old_recording_is_read_migrated_and_the_same(
    recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    own = Recording(recorded)
    assert len(remarks(caplog)) == 1
    read = list(own.messages())
    for message in read:
        kind = channel(message.channel).message
        assert encode(decode(message.payload, kind)) == message.payload
    new = tmp_path / "out" / recorded.name
    assert migrate(recorded, "--out", new.parent)[0] == 0
    migrated = Recording(new)
    assert len(remarks(caplog)) == 1
    assert migrated.metadata == own.metadata | {"format": "2"}
    assert migrated.deployment_dict == own.deployment_dict
    assert resolved_json(migrated.deployment()) == resolved_json(own.deployment())
    assert migrated.memory == own.memory
    assert list(migrated.messages()) == read
    assert list(migrated.all_messages()) == list(own.all_messages())
    assert value_hash(new) == value_hash(recorded)
    before, after = plain(recorded), plain(new)
    assert len(before) == len(after) > len(read) > 100
    for one, other in zip(before, after, strict=True):
        assert (one.t_ns, one.sequence) == (other.t_ns, other.sequence)
        if one.topic.startswith("/"):
            assert other == one
    check_schemas(new)
    assert [a.name for a in attached(new)[0]] == [a.name for a in attached(recorded)[0]]
    assert migrate(new)[1] == [f"{new}: recording of the present format"]


def check_schemas(path: Path) -> None:
    """Every topic has the schema that a recording of today has."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for one in summary.channels.values():
        if one.topic.startswith("skinnet/"):
            kind = Keys(one.topic.split("/")[1]).parse(one.topic)[0].message
            schema = summary.schemas[one.schema_id]
            assert (schema.name, schema.data) == (schema_name(kind), json_schema(kind))


FAULTS_SHA256 = "89b8259a0861ac53d0c1dc38b63953cc03b561195593315d24d960b1e8d51639"
"""Value hash of the old recording; a run of today has other accelerations and noise, hence other values."""


def test_a_recording_with_faults_has_the_shape_of_the_same_run_today(tmp_path: Path) -> None:
    settings = ("run.max_s=0.6", FAULTS)
    run(SHIPPED / "two_link_arm.toml", tmp_path, "--in-process", "--record", settings=settings)
    own, now = Recording(OLD / "recordings" / "faults.mcap"), Recording(tmp_path / "run.mcap")
    assert [m for m in own.messages() if m.channel == "fault"] == [
        m for m in now.messages() if m.channel == "fault"
    ]
    assert {m.key for m in own.messages()} == {m.key for m in now.messages()}
    assert value_hash(own.path) == FAULTS_SHA256
    assert resolved_json(own.deployment()) == resolved_json(now.deployment())


@pytest.mark.parametrize("name", ["riba_cylinder", "riba_trajectory", "hrp2_grasp"])
def test_an_old_recording_is_replayed_without_a_difference(name: str, old: Path) -> None:
    file = old / "recordings" / f"{name}.mcap"
    own = Recording(file)
    with with_memory(own, own.deployment()) as deployment:
        verdict = replay_into(own, deployment, SHIPPED)
    assert verdict.difference is None
    assert (verdict.ticks, verdict.note) == (sum(m.channel == "command" for m in own.messages()), "")


def test_an_old_exploration_is_replayed_until_its_velocities_differ_in_the_last_digit(old: Path) -> None:
    """Explorations have moved by displacements since, not by a loop that is clipped at the speed limit."""
    own = Recording(old / "recordings" / "two_link_arm.mcap")
    difference = replay_into(own, own.deployment(), SHIPPED).difference
    assert difference is not None
    assert difference.stage == "structure"
    assert float(difference.replayed) == pytest.approx(float(difference.recorded), rel=1e-15)


def test_an_old_recording_with_a_memory_gives_one_remark(caplog: pytest.LogCaptureFixture, old: Path) -> None:
    own = Recording(old / "recordings" / "hrp2_grasp.mcap")
    with with_memory(own, own.deployment()) as deployment:
        assert deployment.memory.read is not None
        memory = read_memory_json(Path(deployment.memory.read))
    assert "release.timeout_s" in memory.parameters
    assert len(remarks(caplog)) == 1


@pytest.mark.parametrize("name", ["faults", "riba_cylinder", "ur5_260"])
def test_an_old_recording_is_shown(name: str) -> None:
    source = RecordingSource(OLD / "recordings" / f"{name}.mcap", SHIPPED, 0.0)
    scene = RunState(source.deployment, build_skin_layout(source.deployment))
    source.clock.set_rate(1e3, 0.0)
    while source.deliver(scene, 100.0):
        pass
    joints = [m for m in source.recording.messages() if m.channel == "joints"]
    assert (source.n_malformed, scene.n_malformed, scene.last_error) == (0, 0, "")
    assert scene.position_rad == decode(joints[-1].payload, messages.Joints).position_rad
    assert scene.n_missed == 0


def test_a_recording_that_was_cut_stays_cut_and_readable(tmp_path: Path) -> None:
    content = (OLD / "recordings" / "two_link_arm.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    end = Recording(OLD / "recordings" / "two_link_arm.mcap").chunk_offsets[-1]
    cut.write_bytes(content[: end + 1000])
    before = list(Recording(cut).messages())
    assert migrate(cut)[0] == 0
    own = Recording(cut)
    assert (own.complete, own.translator) == (False, None)
    assert list(own.messages()) == before
    assert len(before) > 100


def test_a_damaged_recording_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    content = bytearray((OLD / "recordings" / "two_link_arm.mcap").read_bytes())
    content[Recording(OLD / "recordings" / "two_link_arm.mcap").chunk_offsets[0] + 200] ^= 0xFF
    path.write_bytes(content)
    code, out, errors = migrate(path)
    assert (code, out, len(errors)) == (2, [], 1)
    assert errors[0].startswith(f"skinnet: {path}: damaged at byte ")
    assert path.read_bytes() == content
    assert [one.name for one in tmp_path.iterdir()] == ["run.mcap"]


NAMED = MessageTranslator({"hosts": {"host1": ["arm"]}})
KINDS = {
    kind.__struct_config__.tag: kind
    for module in (messages, external_messages, recorded_messages, sheet_messages, telemetry_messages)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
}


def test_every_name_of_a_message_is_one_of_today() -> None:
    assert set(format_1.MESSAGE_TYPES.values()) <= KINDS.keys()
    assert not format_1.MESSAGE_TYPES.keys() & KINDS.keys()
    for old_tag, renamed in format_1.MESSAGE_FIELDS.items():
        fields = set(KINDS[format_1.MESSAGE_TYPES.get(old_tag, old_tag)].__struct_fields__)
        assert set(renamed.values()) <= fields
        assert not renamed.keys() & fields
    for key in ("body/world", "skin/arm/frame", "controller/machine", "host/host0/counters"):
        Keys("bot").parse(NAMED.key(f"skinnet/bot/{key}"))
    assert NAMED.key("skinnet/bot/skin/arm/3/events") == "skinnet/bot/skin/arm/3/events"
    assert NAMED.key("/scene") == "/scene"


def test_only_processes_that_the_program_named_have_other_names() -> None:
    payload = encode(recorded_messages.Counters(process="host1", t_ns=0, counts={"malformed_messages": 2}))
    for translator, name in ((NAMED, "host1"), (MessageTranslator({"hosts": 2}), "cells1")):
        assert translator.key("skinnet/bot/host/host1/counters") == f"skinnet/bot/process/{name}/counters"
        assert decode(translator.message(payload), recorded_messages.Counters).process == name


def test_every_counter_is_one_of_today() -> None:
    text = "".join(
        path.read_text()
        for folder in ("skinnet", "cells", "controller")
        for path in (ROOT / folder).rglob("*.py")
        if "migration" not in path.parts
    )
    assert [name for name in format_1.COUNTERS.values() if f'counters["{name}"]' not in text] == []
    assert [name for name in format_1.COUNTERS if f'counters["{name}"]' in text] == []


@given(
    st.sampled_from(sorted(format_1.MESSAGE_FIELDS)),
    st.dictionaries(
        st.sampled_from(
            sorted(
                {name for fields in format_1.MESSAGE_FIELDS.values() for name in (*fields, *fields.values())}
            )
        ),
        st.integers(-(2**63), 2**63) | st.floats(allow_nan=False) | st.binary(max_size=9),
    ),
)
def test_a_translated_message_keeps_its_values(kind: str, fields: dict[str, Any]) -> None:
    payload = msgspec.msgpack.encode({"type": kind, "schema": 1, **fields})
    translated = NAMED.message(payload)
    message = msgspec.msgpack.decode(translated)
    assert [*message.values()][2:] == [*fields.values()]
    assert NAMED.message(translated) == translated


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x01", b"\x80", msgspec.msgpack.encode({1: 2})])
def test_what_is_no_message_stays_none(payload: bytes) -> None:
    assert NAMED.message(payload) == payload


# --- memories


@pytest.mark.parametrize("name", ["memory.sqlite", "hrp2_memory.json"])
def test_an_old_memory_is_read_and_migrated(name: str, old: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = old / name
    read: Callable[[Path], Any] = read_memory_json if path.suffix == ".json" else read_memory
    before = json.loads((OLD / "hrp2_memory.json").read_text())["parameters"]
    memory = read(path)
    read(path)
    (remark,) = remarks(caplog)
    assert remark.startswith(f"{path}: memory of an earlier format")
    assert memory.parameters == {current_parameter(key): value for key, value in before.items()}
    assert {"release.tolerance_rad", "release.timeout_s"} <= memory.parameters.keys()
    assert not any(key.endswith(tuple(format_1.PARAMETERS)) for key in memory.parameters)
    other = old / ("memory.sqlite" if path.suffix == ".json" else "hrp2_memory.json")
    other_read: Callable[[Path], Any] = read_memory if path.suffix == ".json" else read_memory_json
    assert other_read(other).digest() == memory.digest()
    assert migrate(path)[1] == [f"{path}: memory of an earlier format: 24 names changed"]
    caplog.clear()
    assert read(path).digest() == memory.digest()
    assert remarks(caplog) == []
    assert migrate(path)[1] == [f"{path}: memory of the present format"]


def test_an_old_memory_that_is_opened_to_be_written_is_rewritten(old: Path) -> None:
    path = old / "memory.sqlite"
    memory = read_memory(path)
    with MemoryStore.open(path, memory.robot) as store:
        assert store.contents.digest() == memory.digest()
        store.store_parameters({"more": 1.0})
    assert sql(path, "PRAGMA user_version") == [(2,)]
    assert read_memory(path).parameters == memory.parameters | {"more": 1.0}


def test_the_digest_of_an_old_memory_is_checked_before_it_is_translated(old: Path) -> None:
    path = old / "memory.sqlite"
    sql(path, "UPDATE parameter SET value = 9.0 WHERE name = 'release.accuracy_rad'")
    with pytest.raises(MemoryFileError, match="do not match the stored SHA-256"):
        read_memory(path)
    content = path.read_bytes()
    code, _, errors = migrate(path)
    assert (code, len(errors)) == (2, 1)
    assert path.read_bytes() == content


def test_a_memory_in_use_is_not_migrated(old: Path) -> None:
    path = old / "memory.sqlite"
    with sqlite3.connect(path, isolation_level=None) as db:
        db.execute("BEGIN EXCLUSIVE")
        code, _, errors = migrate(path)
        db.execute("ROLLBACK")
    db.close()
    assert (code, errors) == (
        2,
        [f"skinnet: {path}: is locked by another process; wait until its run ends"],
    )


@given(
    st.dictionaries(
        st.tuples(
            st.sampled_from(["a.", "a.b.", ""]), st.sampled_from([*format_1.PARAMETERS, "timeout_s", "x"])
        ).map("".join),
        st.floats(allow_nan=False),
    )
)
def test_translated_parameters_keep_their_values(parameters: dict[str, float]) -> None:
    try:
        translated, count = translate_parameters(parameters)
    except FormatError:
        return
    assert [*translated.values()] == [*parameters.values()]
    assert count == len(parameters.keys() - translated.keys())
    assert translate_parameters(translated) == (translated, 0)


def test_the_shipped_memory_is_of_the_present_version_with_the_same_values() -> None:
    shipped = json.loads((SHIPPED / "hrp2_memory.json").read_text())
    taught = Recording(OLD / "recordings" / "hrp2_grasp.mcap").memory
    assert shipped["version"] == 2
    assert taught is not None
    assert json.loads(taught[1]) == shipped


# --- summaries


@pytest.mark.parametrize("name", sorted(path.name for path in (OLD / "runs").iterdir()))
def test_an_old_run_folder_is_reported_with_one_remark(
    name: str, old: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = old / "runs" / name
    before = read_run_folder(folder)
    (remark,) = remarks(caplog)
    assert remark.startswith(f"{folder}: run folder of an earlier format")
    files = list(folder.iterdir())
    assert migrate(*files)[0] == 0
    caplog.clear()
    after = read_run_folder(folder)
    assert remarks(caplog) == []
    for one, other in zip(all_runs(before), all_runs(after), strict=True):
        assert one.summary == other.summary
        assert one.metrics == other.metrics
        assert one.comparisons == other.comparisons
        assert one.files.deployment_keys == other.files.deployment_keys
        assert not isinstance(one, RunResults) or one.unknown_keys == {}
        assert (one.files.deployment is not None) == (folder / "deployment.json").exists()
    old_names = {name for name in metric_names(OLD / "runs" / name) if current_metric(name) != name}
    assert old_names
    assert not old_names & {metric for one in all_runs(after) for metric in one.summary.metrics}


def all_runs(results: RunResults | SeedResults | StressResults) -> tuple[Any, ...]:
    return results.runs if isinstance(results, SeedResults) else (results,)


def metric_names(folder: Path) -> set[str]:
    raw = json.loads(next(path for path in folder.glob("*s*.json") if path.stem != "deployment").read_text())
    return {name for one in raw.get("runs", [raw]) for name in one["figures"]}


def test_claims_find_the_metrics_of_an_old_run() -> None:
    results = read_run_folder(OLD / "runs" / "riba_cylinder")
    assert isinstance(results, RunResults)
    assert len(results.comparisons) > 5


def test_a_process_that_was_lost_has_its_cause() -> None:
    results = read_run_folder(OLD / "runs" / "losses")
    assert isinstance(results, RunResults)
    (failure,) = results.summary.process_failures
    assert (failure.process, failure.cause[-23:]) == ("recorder", "No space left on device")
    assert results.summary.settings == ("run.max_s=0.3", 'run.tolerated_losses=["recorder"]')


def test_points_of_an_old_sweep_and_their_metrics_have_one_name() -> None:
    results = read_run_folder(OLD / "runs" / "stress")
    assert isinstance(results, StressResults)
    assert results.summary.points[:3] == ("c36-periodic-s0", "c36-send_on_delta-s0", "c36-level_crossing-s0")
    for point in results.summary.points:
        for metric in ("packets_per_s", "fraction.packets", "malformed_messages"):
            assert f"{point}.{metric}" in results.metrics
    assert results.summary.stress["delta_noise_ratios"] == [4.0]
    assert "send_on_delta.stimulated.fraction.bytes" in results.metrics
    assert results.metrics["published.B15.unstimulated.fraction"] == 0.1645


@given(
    st.lists(
        st.sampled_from(["session", "clock", "delta", "share", "x", "unstimulated", "packets"]), max_size=4
    )
)
def test_a_metric_is_translated_once(words: list[str]) -> None:
    name = current_metric(".".join(words))
    assert current_metric(name) == name


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "figures": st.dictionaries(st.text(max_size=9), st.integers()),
            "counters": st.dictionaries(
                st.text(max_size=3),
                st.dictionaries(st.sampled_from(sorted(format_1.COUNTERS)), st.integers()),
            ),
            "faults": st.lists(st.dictionaries(st.sampled_from(["what", "process"]), st.integers())),
            "late_frames": st.integers(),
            "else": st.integers(),
        },
    )
)
def test_a_translated_summary_keeps_its_values(raw: dict[str, Any]) -> None:
    summary, _ = translate_summary(raw, "x")
    assert leaves({key: value for key, value in summary.items() if key != "format"}) == leaves(raw)
    assert translate_summary(summary, "x") == (summary, None)


# --- newer files, and files of others


def newer_files(folder: Path) -> dict[Path, tuple[Callable[[Path], Any], type[Exception]]]:
    """A file of each kind and of a newer format, with what reads it and the error."""
    (folder / "new.toml").write_text('format = 3\nname = "x"\n')
    summary = folder / "run" / "summary.json"
    summary.parent.mkdir()
    summary.write_text('{"format": 3, "metrics": {}}')
    memory = json.loads((OLD / "hrp2_memory.json").read_text())
    (folder / "new.json").write_text(json.dumps(memory | {"version": 3}))
    shutil.copy(OLD / "memory.sqlite", folder / "new.sqlite")
    sql(folder / "new.sqlite", "PRAGMA user_version = 3")
    content = (OLD / "recordings" / "riba_cylinder.mcap").read_bytes()
    one, other = (len(b).to_bytes(4, "little") + b for b in (b"format", b"1"))
    (folder / "new.mcap").write_bytes(content.replace(one + other, one + other[:-1] + b"3"))
    return {
        folder / "new.toml": (load, DeploymentError),
        summary: (lambda path: read_run_folder(path.parent), RunFolderError),
        folder / "new.json": (read_memory_json, MemoryFileError),
        folder / "new.sqlite": (read_memory, MemoryFileError),
        folder / "new.mcap": (Recording, RecordingError),
    }


def test_newer_files_are_refused_in_one_line_and_the_others_done(old: Path, tmp_path: Path) -> None:
    files = newer_files(tmp_path)
    for path, (read, error) in files.items():
        with pytest.raises(error) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "3" in str(caught.value)
        assert "\n" not in str(caught.value)
    contents = {path: path.read_bytes() for path in files}
    good = old / "hrp2_memory.json"
    code, out, errors = migrate(*files, good)
    assert (code, len(errors), len(out)) == (2, len(files), 1)
    assert out[0].startswith(f"{good}: ")
    assert [line.split(": ")[1] for line in errors] == [str(path) for path in files]
    assert {path: path.read_bytes() for path in files} == contents


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("notes.txt", b"nothing of the kind\n", "no deployment, memory, recording or summary of skinnet: "),
        (
            "other.toml",
            b"[project]\nname = 'x'\n",
            "no deployment, memory, .*: no deployment has the key project",
        ),
        ("empty.toml", b"", "no deployment, memory, .*: it is empty"),
        ("other.json", b'{"a": 1}', "no deployment, memory, .*: no deployment has the key a"),
        ("half.json", b'{"a": 1', "no deployment, memory, .*: invalid JSON"),
        ("noise", b"\xff\xfe\x00", "no deployment, memory, .*: it is neither text"),
        ("both.toml", b"hosts = 1\ncell_processes = 2\n", "hosts is called cell_processes now"),
        ("odd.toml", b"format = 'two'\nname = 'x'\n", "format = 'two': give 2"),
    ],
)
def test_what_is_no_file_of_skinnet_is_named(name: str, content: bytes, reason: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=rf"^{tmp_path / name}: {reason}") as caught:
        migration_of(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_folders_and_missing_files_are_named(tmp_path: Path) -> None:
    code, out, errors = migrate(tmp_path, tmp_path / "none")
    assert (code, out) == (2, [])
    assert errors == [
        f"skinnet: {tmp_path}: is a folder; give the files in it",
        f"skinnet: {tmp_path / 'none'}: no such file or directory",
    ]


# --- the command


def test_every_old_file_is_checked_migrated_and_then_of_the_present_format(old: Path) -> None:
    files = sorted(path for path in old.rglob("*") if path.is_file() and path.suffix != ".txt")
    before = {path: path.read_bytes() for path in files}
    code, out, errors = migrate("--check", *files)
    assert (code, errors, len(out)) == (1, [], len(files))
    assert all(line.endswith(" to change") for line in out)
    assert {path: path.read_bytes() for path in files} == before
    code, out, errors = migrate(*files)
    assert (code, errors, len(out)) == (0, [], len(files))
    assert all(line.endswith(" changed") for line in out)
    after = {path: path.read_bytes() for path in files}
    assert all(after[path] != before[path] for path in files)
    for arguments in ((), ("--check",)):
        code, out, errors = migrate(*arguments, *files)
        assert (code, errors, len(out)) == (0, [], len(files))
        assert all(line.endswith(" of the present format") for line in out)
    assert {path: path.read_bytes() for path in files} == after


def test_shipped_files_are_of_the_present_format() -> None:
    files = [*SHIPPED.rglob("*.toml"), SHIPPED / "hrp2_memory.json"]
    code, _, errors = migrate("--check", *files)
    assert (code, errors) == (0, [])


def test_migration_into_a_folder_leaves_the_old_file(old: Path, tmp_path: Path) -> None:
    file, out = old / "deployments" / "ur5_260.toml", tmp_path / "new"
    before = file.read_bytes()
    code, lines, _ = migrate(file, "--out", out)
    assert (code, lines) == (
        0,
        [f"{file}: deployment of an earlier format: 9 names changed in {out / file.name}"],
    )
    assert file.read_bytes() == before
    assert renamed_stage(load(out / file.name)) == load(SHIPPED / file.name)
    runs = [old / "runs" / name / "summary.json" for name in ("ur5_260", "h1_1260")]
    code, lines, errors = migrate(*runs, "--out", out)
    assert (code, lines) == (2, [])
    assert errors == ["skinnet: --out: 2 files are called summary.json; migrate them one by one, or in place"]


def test_a_symbolic_link_stays_one(old: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.toml"
    link.symlink_to(old / "deployments" / "ur5_260.toml")
    assert migrate(link)[0] == 0
    assert link.is_symlink()
    assert "format = 2" in (old / "deployments" / "ur5_260.toml").read_text()


@pytest.mark.processes
def test_the_command_line_says_once_that_a_file_is_old(old: Path) -> None:
    shutil.copy(SHIPPED / "two_link_arm.xml", old / "deployments")
    file = old / "deployments" / "two_link_arm.toml"
    for command in (
        ("check", file),
        ("run", file, "--no-plots", "--set", "run.max_s=0.05", "--out", old / "out"),
        ("run", file, "--in-process", "--no-plots", "--set", "run.max_s=0.05", "--out", old / "out"),
        ("report", old / "runs" / "losses"),
        ("replay", old / "recordings" / "riba_trajectory.mcap", "--into", "controller", "--base", SHIPPED),
        ("memory", "show", old / "memory.sqlite"),
    ):
        done = started(*map(str, command))
        assert done.returncode == 0, done.stderr
        (remark,) = done.stderr.splitlines()
        assert remark.endswith("of an earlier format, read by its present names; skinnet migrate rewrites it")


def test_the_help_has_examples() -> None:
    (command,) = [
        one for one in app.registered_commands if one.name == "migrate" or one.callback.__name__ == "migrate"
    ]
    assert "skinnet migrate --check" in (command.epilog or "")
