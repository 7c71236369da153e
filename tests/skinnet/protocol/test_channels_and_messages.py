"""Keys and messages: what is built is parsed, what is encoded is decoded, and anything else is refused."""

import builtins
import contextlib
import itertools
import re
import types
from typing import Any, get_args, get_origin, get_type_hints

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinnet.errors import ProtocolError
from skinnet.protocol.channels import CHANNELS, OBSERVERS, Channel, Keys, Role, channel
from skinnet.protocol.messages import (
    SCHEMA,
    STREAM_ROW,
    Events,
    Joints,
    Message,
    Stream,
    decode,
    encode,
    pack,
    unpack,
)
from skinnet.transport.key_expressions import expressions_intersect, key_matches

KEYS = Keys("bot")
names = st.text("abcXYZ019_-", min_size=1, max_size=12) | st.sampled_from(
    ["events", "body", "skin", "period_end", "stream", "config", "alive", "topology"]
)
rows = st.sampled_from(CHANNELS)


def of_type(annotation: Any) -> st.SearchStrategy[Any]:
    """Values that the wire can carry: integers have 64 bits there."""
    inner = [of_type(part) for part in get_args(annotation)]
    match get_origin(annotation) or annotation:
        case builtins.list:
            return st.lists(*inner, max_size=3)
        case builtins.dict:
            return st.dictionaries(*inner, max_size=3)
        case types.UnionType:
            return st.one_of(inner)
        case builtins.int:
            return st.integers(-(2**63), 2**63 - 1)
        case builtins.float:
            return st.floats(allow_nan=False)
        case builtins.str:
            return st.text(max_size=9)
        case builtins.bytes:
            return st.binary(max_size=9)
        case builtins.bool:
            return st.booleans()
        case types.NoneType:
            return st.none()
    raise AssertionError(annotation)


def of_kind(kind: type[Message]) -> st.SearchStrategy[Message]:
    annotations = {
        name: note for name, note in get_type_hints(kind).items() if name in kind.__struct_fields__
    }
    return st.builds(
        kind, **{name: of_type(note) for name, note in annotations.items()} | {"schema": st.just(SCHEMA)}
    )


messages = st.one_of([of_kind(row.message) for row in {row.message: row for row in CHANNELS}.values()])


def fields_of(row: Channel, data: st.DataObject) -> tuple[str, ...]:
    return tuple(data.draw(names) for _ in range(row.pattern.count("<")))


def everywhere(row: Channel) -> str:
    return KEYS.of(row.name, *"*" * row.pattern.count("<"))


@given(row=rows, robot=names, data=st.data())
def test_every_key_that_is_built_is_parsed(row: Channel, robot: str, data: st.DataObject) -> None:
    fields = fields_of(row, data)
    keys = Keys(robot)
    key = keys.of(row.name, *fields)
    assert key.startswith(f"skinnet/{robot}/")
    for _ in range(2):  # the second answer comes from memory
        assert keys.parse(key) == (row, fields)
    with pytest.raises(ProtocolError):
        Keys(robot + "x").parse(key)


@given(row=rows, data=st.data())
def test_no_two_rows_of_the_table_share_a_key(row: Channel, data: st.DataObject) -> None:
    key = KEYS.of(row.name, *fields_of(row, data))
    owners = [
        other for other in CHANNELS if key_matches(KEYS.of(other.name, *"*" * other.pattern.count("<")), key)
    ]
    assert owners == [row]


@given(segments=st.lists(names, max_size=5))
def test_a_key_of_no_channel_is_refused(segments: list[str]) -> None:
    key = KEYS.prefix + "/".join(segments)
    try:
        row, fields = KEYS.parse(key)
    except ProtocolError:
        assert not [row for row in CHANNELS if key_matches(everywhere(row), key)]
    else:
        assert KEYS.of(row.name, *fields) == key


@pytest.mark.parametrize(
    "key", ["", "skinnet/bot", "skinnet/bot/", "skin/p/frame", "skinnet/bot/skin/p/frame/x"]
)
def test_keys_that_only_look_alike(key: str) -> None:
    with pytest.raises(ProtocolError):
        KEYS.parse(key)


def test_the_table_says_who_talks_to_whom() -> None:
    assert len({row.name for row in CHANNELS}) == len({row.pattern for row in CHANNELS}) == len(CHANNELS)
    assert all(channel(row.name) is row for row in CHANNELS)
    # nobody but the cells may know what the body feels: no ground truth for controller or watchers
    assert channel("stimulus").receivers == (Role.CELLS,)
    assert not channel("stimulus").public
    hidden = ["stimulus", "pressures", "joint_ranges"]
    assert [row.name for row in CHANNELS if not row.public] == [*hidden, "fault"]
    only_told = ["links", "processes"]  # by the wall clock
    assert [row.name for row in CHANNELS if not row.recorded] == [*hidden, *only_told]
    assert channel("free_bodies").receivers == ()


def test_lanes_are_the_receivers() -> None:
    for row in CHANNELS:
        assert (KEYS.route_group(everywhere(row)) == OBSERVERS) == (not row.receivers)


segments = st.lists(st.sampled_from(["a", "b", "c"]), max_size=5)


@given(expression=st.lists(st.sampled_from(["a", "b", "*", "**"]), max_size=4), key=segments)
def test_expressions_match_as_regular_expressions_do(expression: list[str], key: list[str]) -> None:
    pattern = "".join({"*": "[^/]+/", "**": "([^/]+/)*"}.get(part, part + "/") for part in expression)
    wanted = re.fullmatch(pattern, "".join(part + "/" for part in key)) is not None
    if expression and key:  # an empty key expression is none
        assert key_matches("/".join(expression), "/".join(key)) == wanted


expressions = st.lists(st.sampled_from(["a", "b", "*", "**"]), min_size=1, max_size=3).map("/".join)
KEYS_OF_TWO_LETTERS = ["/".join(parts) for n in range(1, 7) for parts in itertools.product("ab", repeat=n)]


@given(left=expressions, right=expressions)
def test_expressions_intersect_if_a_key_matches_both(left: str, right: str) -> None:
    both = any(key_matches(left, key) and key_matches(right, key) for key in KEYS_OF_TWO_LETTERS)
    assert expressions_intersect(left, right) == expressions_intersect(right, left) == both


@given(message=messages)
def test_messages_survive_the_wire(message: Message) -> None:
    assert decode(encode(message), type(message)) == message


@given(message=messages)
def test_any_messagepack_library_reads_them(message: Message) -> None:
    read = msgpack.unpackb(encode(message))
    assert read["type"] == type(message).__struct_config__.tag
    assert read["schema"] == SCHEMA
    assert set(read) == {"type", *message.__struct_fields__}
    assert read == msgspec.to_builtins(message, builtin_types=(bytes,))


@given(message=messages)
def test_and_any_messagepack_library_writes_them(message: Message) -> None:
    fields = msgspec.to_builtins(message, builtin_types=(bytes,))
    assert decode(msgpack.packb(fields), type(message)) == message


kinds = rows.map(lambda row: row.message)
other_schemas = st.integers(-(2**63), 2**63 - 1).filter(lambda n: n != SCHEMA)


@given(message=messages, kind=kinds, schema=other_schemas)
def test_another_type_or_schema_is_refused(message: Message, kind: type[Message], schema: int) -> None:
    if not isinstance(message, kind):
        with pytest.raises(ProtocolError, match=kind.__name__):
            decode(encode(message), kind)
    other = msgspec.structs.replace(message, schema=schema)
    with pytest.raises(ProtocolError, match=f"schema version {schema}"):
        decode(encode(other), type(message))


@given(payload=st.binary(max_size=200), kind=kinds)
def test_noise_is_refused_and_nothing_else_happens(payload: bytes, kind: type[Message]) -> None:
    with pytest.raises(ProtocolError):
        decode(payload, kind)


@given(message=messages, data=st.data())
def test_a_damaged_message_is_refused_or_means_something(message: Message, data: st.DataObject) -> None:
    payload = bytearray(encode(message))
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[at] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(payload)))
    for damaged in (bytes(payload), bytes(payload[:end]), bytes(payload) + b"\xc0"):
        with contextlib.suppress(ProtocolError):
            assert isinstance(decode(damaged, type(message)), type(message))


@pytest.mark.parametrize(
    "payload",
    [
        b"\x91" * 100_000,  # nested without end
        b"\x82\xa4type\xa6events\xa4cell\xdd\xff\xff\xff\xff",  # a list that claims four billion entries
        b"\x82\xa4type\xa6events\xa5patch\xa2\xff\xfe",  # no UTF-8
    ],
)
def test_malice_is_refused(payload: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(payload, Events)


def test_fields_may_be_added_with_a_default() -> None:
    """An older program skips what it does not know; a newer one takes the default for what is not there."""

    class NewJoints(Joints, frozen=True, kw_only=True, tag="joints"):
        torque_nm: tuple[float, ...] = ()

    old = Joints(t_ns=1, watermark_ns=2, position_rad=[0.5])
    new = NewJoints(t_ns=1, watermark_ns=2, position_rad=[0.5], torque_nm=(3.0,))
    assert decode(encode(new), Joints) == old
    assert decode(encode(old), NewJoints) == msgspec.structs.replace(new, torque_nm=())


numbers = st.floats(width=32, allow_nan=False) | st.just(float("inf"))


@given(values=st.lists(st.lists(numbers, min_size=3, max_size=3), max_size=5))
def test_bulk_numbers_survive_the_wire(values: list[list[float]]) -> None:
    array = np.array(values, dtype=np.float64).reshape(-1, 3)
    payload = pack(array, "<f4")
    back = unpack(payload, "<f4", 3)
    np.testing.assert_array_equal(back, array)
    assert not back.flags.writeable
    assert len(payload) == 12 * len(values)
    with pytest.raises(ProtocolError):
        unpack(payload + b"x", "<f4", 3)


def test_a_stream_is_rows_without_gaps() -> None:
    rows = np.zeros(2, dtype=STREAM_ROW)
    rows["cell"], rows["values"] = (1, 2), np.arange(16).reshape(2, 8)
    message = Stream(patch="p", t_ns=0, watermark_ns=1, n_events=0, rows=rows.tobytes())
    back: Any = unpack(decode(encode(message), Stream).rows, STREAM_ROW)
    assert back.tobytes() == rows.tobytes()
    assert back["values"][1, 7] == 15
    # the layout of the documentation: three times 8 bytes, eight times 4, twice 2
    assert len(message.rows) == 2 * (3 * 8 + 8 * 4 + 2 * 2)
