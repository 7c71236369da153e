"""The wire of rmw_zenoh: against the examples of its design document, published hashes, there and back."""

import re
import struct

import numpy as np
import pytest
import xxhash
from hypothesis import given
from hypothesis import strategies as st
from ros2_definitions import DEFINITIONS, rihs01
from rosbags.typesys import Stores, get_typestore

from skinnet.errors import ProtocolError
from skinnet.ros2 import message_types as types
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.qos import Durability, History, QosProfile, Reliability
from skinnet.ros2.rmw_zenoh_keys import (
    Entity,
    EntityType,
    NodeInfo,
    dds_type_name,
    demangle_name,
    mangle_name,
    to_ros_name,
    topic_key,
)

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
"""std_msgs/msg/String in the design document of rmw_zenoh."""

PUBLISHED = {
    # share/<package>/msg/<type>.json of ROS 2 Kilted (common_interfaces 5.5.1, rcl_interfaces 2.3.0)
    "rosgraph_msgs/msg/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    # also in rcl, rcl/test/rcl/test_type_hash.cpp
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "std_msgs/msg/Float64MultiArray": "1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    # `ros2 topic info --verbose /tf`, and rosbag2 metadata of Jazzy
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
}

NAMES = st.text(st.characters(codec="ascii", categories=("L", "N"), include_characters="_/"), max_size=40)
PARTS = st.text(st.characters(codec="ascii", categories=("L", "N"), include_characters="_:"), min_size=1)
QUALITIES = st.builds(
    QosProfile,
    st.sampled_from(Reliability),
    st.sampled_from(Durability),
    st.sampled_from(History),
    st.integers(1, 99),
)
TOPICS = st.lists(st.from_regex(r"[a-z][a-z0-9_]*", fullmatch=True), min_size=1, max_size=4)


@pytest.mark.parametrize("name", types.MESSAGE_TYPES)
def test_type_hashes_are_the_published_ones(name: str) -> None:
    assert types.type_hash(name) == f"RIHS01_{PUBLISHED[name]}" == rihs01(name)


def test_rihs01_by_the_book_gives_what_the_design_document_has() -> None:
    assert rihs01("std_msgs/msg/String") == STRING
    assert set(PUBLISHED) == set(types.MESSAGE_TYPES) <= set(DEFINITIONS)


@pytest.mark.parametrize("store", [Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.LATEST])
def test_type_hashes_are_the_same_in_all_distributions_that_have_them(store: Stores) -> None:
    found = get_typestore(store)
    assert {name: found.hash_rihs01(name) for name in types.MESSAGE_TYPES} == {
        name: types.type_hash(name) for name in types.MESSAGE_TYPES
    }


@pytest.mark.parametrize(
    ("topic", "key"),
    [("/chatter", f"0/chatter/std_msgs::msg::dds_::String_/{STRING}"),
     ("/robot1/chatter", f"0/robot1/chatter/std_msgs::msg::dds_::String_/{STRING}")],
)  # fmt: skip
def test_keys_of_the_design_document(topic: str, key: str) -> None:
    assert topic_key(0, topic, dds_type_name("std_msgs/msg/String"), STRING) == key


def test_tokens_of_the_design_document() -> None:
    listener = NodeInfo(2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, "/", "listener")
    talker = NodeInfo(2, "8b20917502ee955ac4476e0266340d5c", 0, "/", "talker")
    string = "/chatter", dds_type_name("std_msgs/msg/String"), STRING
    assert Entity(listener, EntityType.NODE, 0).liveliness_token == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    )
    assert Entity(
        listener, EntityType.SUBSCRIPTION, 10, *string, QosProfile(depth=10).compact_form
    ).liveliness_token == (
        "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/"
        f"std_msgs::msg::dds_::String_/{STRING}/::,10:,:,:,,"
    )
    publisher = Entity(talker, EntityType.PUBLISHER, 10, *string, QosProfile(depth=7).compact_form)
    assert publisher.liveliness_token == (
        "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
        f"std_msgs::msg::dds_::String_/{STRING}/::,7:,:,:,,"
    )
    assert publisher.topic_key == f"2/chatter/std_msgs::msg::dds_::String_/{STRING}"


@given(NAMES)
def test_mangling_goes_there_and_back(name: str) -> None:
    assert "/" not in mangle_name(name)
    assert demangle_name(mangle_name(name)) == name


@given(
    st.builds(
        NodeInfo,
        domain_id=st.integers(0, 232),
        session_id=st.from_regex(r"[0-9a-f]{1,32}", fullmatch=True),
        node_id=st.integers(0, 99),
        namespace=TOPICS.map(lambda parts: "/" + "/".join(parts)) | st.just("/"),
        name=st.from_regex(r"[a-z][a-z0-9_]*", fullmatch=True),
        enclave=st.sampled_from(["/", "/secure/one"]),
    ),
    st.sampled_from(EntityType),
    st.integers(0, 999),
    TOPICS.map(lambda parts: "/" + "/".join(parts)),
    PARTS,
    PARTS,
    QUALITIES,
)
def test_tokens_go_there_and_back(
    node: NodeInfo, kind: EntityType, number: int, topic: str, type_name: str, type_hash: str, qos: QosProfile
) -> None:
    described = (topic, type_name, type_hash, qos.compact_form) if kind is not EntityType.NODE else ()
    entity = Entity(node, kind, number, *described)
    assert Entity.from_token(entity.liveliness_token) == entity
    assert not re.search(r"//|[*$?#]", entity.liveliness_token)


@pytest.mark.parametrize(
    "token",
    [
        "",
        "@ros2_lv/0/ab/0/0/NN/%/%",
        "@ros2_lv/0/ab/0/0/NN//%/name",
        "@ros2_lv/zero/ab/0/0/NN/%/%/name",
        "@ros2_lv/0/ab/0/1/MP/%/%/name/%chatter/std_msgs::msg::dds_::String_/RIHS01_00",
        "@ros2_lv/0/ab/0/1/SS/%/%/name/%add/example::srv::dds_::Add_/RIHS01_00/::,10:,:,:,,",
        "@other/0/ab/0/0/NN/%/%/name",
    ],
)
def test_what_is_no_token_is_refused(token: str) -> None:
    with pytest.raises(ProtocolError, match=r"token|parts"):
        Entity.from_token(token)


@pytest.mark.parametrize(
    ("qos", "compact"),
    [
        (QosProfile(), "::,10:,:,:,,"),
        (QosProfile(depth=42), "::,:,:,:,,"),
        (QosProfile(reliability=Reliability.BEST_EFFORT, depth=5), "2::,5:,:,:,,"),
        (QosProfile(durability=Durability.TRANSIENT_LOCAL, depth=1), ":1:,1:,:,:,,"),
        (QosProfile(history=History.KEEP_ALL), "::2,10:,:,:,,"),
    ],
)
def test_quality_of_service_as_rmw_zenoh_writes_it(qos: QosProfile, compact: str) -> None:
    """Six parts by ":", of which history, deadline, lifespan have two by "," and liveliness three."""
    assert qos.compact_form == compact
    parts = compact.split(":")
    assert [part.count(",") for part in parts] == [0, 0, 1, 1, 1, 2]
    assert all(number == "" or number.isdecimal() for part in parts for number in part.split(","))


def test_a_gid_is_the_hash_of_the_token_low_half_first() -> None:
    """Value from rmw_zenoh's own `simplified_XXH3_128bits`, for a token of the design document."""
    token = "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    assert gid_of(token).hex() == "5bd72f4daf53c0bb00c7394e7fc19547"
    low, high = struct.unpack("<QQ", gid_of(token))
    assert high << 64 | low == xxhash.xxh3_128_intdigest(token.encode())


@given(st.integers(1, 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_attachments_have_the_layout_of_the_design_document(sequence: int, t_ns: int, gid: bytes) -> None:
    packed = Attachment(sequence, t_ns, gid).pack()
    assert len(packed) == 8 + 8 + 1 + 16
    assert int.from_bytes(packed[:8], "little") == sequence
    assert int.from_bytes(packed[8:16], "little") == t_ns
    assert (packed[16], packed[17:]) == (16, gid)
    assert Attachment.unpack(packed) == (sequence, t_ns, gid)


@pytest.mark.parametrize("payload", [None, b"", bytes(32), bytes(33), bytes(34)])
def test_what_is_no_attachment_is_refused(payload: bytes | None) -> None:
    with pytest.raises(ProtocolError, match="attachment"):
        Attachment.unpack(payload)


@given(st.text(max_size=20))
def test_any_robot_has_a_name_in_ros(name: str) -> None:
    found = to_ros_name(name)
    assert re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", found)
    assert to_ros_name(found) == found


@given(st.lists(st.floats(), max_size=8))
def test_cdr_goes_there_and_back(values: list[float]) -> None:
    layout = types.make_message("std_msgs/msg/MultiArrayLayout", [], 0)
    payload = types.encode(types.make_message(types.FLOAT64_MULTI_ARRAY, layout, np.array(values)))
    assert payload[:4] == b"\x00\x01\x00\x00"  # CDR, little-endian: what rmw_zenoh reads and writes
    np.testing.assert_array_equal(types.decode(payload, types.FLOAT64_MULTI_ARRAY).data, values)


@pytest.mark.parametrize(
    "payload", [b"", b"\x00\x01", b"\x00\x07\x00\x00" + bytes(12), b"\x00\x01\x00\x00" + b"\xff" * 12]
)
def test_what_is_no_message_is_refused(payload: bytes) -> None:  # fmt: skip
    with pytest.raises(ProtocolError, match="cannot decode std_msgs/msg/Float64MultiArray"):
        types.decode(payload, types.FLOAT64_MULTI_ARRAY)
