"""What rmw_zenoh has on the wire, against its design page and the packages of others."""

from __future__ import annotations

import struct

import pytest

pytest.importorskip("rosbags", reason="the extra `ros2` is not installed")

from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys.stores import ros2_jazzy as ros
from zenoh import ZBytes
from zenoh.ext import Int64, z_deserialize, z_serialize

from swarm_ctl.extensions.ros2.rmw import (
    TRIGGER,
    Attachment,
    EntityKind,
    NodeName,
    RosType,
    cdr,
    gid,
    ros_name,
    trigger_response,
    type_of,
)

PUBLISHED = {
    # as `ros2 topic info --verbose` of Jazzy to Lyrical prints them
    "geometry_msgs__msg__PoseStamped": (
        "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
    ),
    "nav_msgs__msg__Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "sensor_msgs__msg__NavSatFix": (
        "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"
    ),
    "visualization_msgs__msg__MarkerArray": (
        "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
    ),
    "diagnostic_msgs__msg__DiagnosticArray": (
        "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
    ),
    "tf2_msgs__msg__TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "rosgraph_msgs__msg__Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
}
STRING = RosType(
    "std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_hash_is_that_of_ros(name: str) -> None:
    assert type_of(getattr(ros, name)).hash == f"RIHS01_{PUBLISHED[name]}"


@pytest.mark.parametrize("name", sorted(PUBLISHED.keys() - {"tf2_msgs__msg__TFMessage"}))
def test_another_package_has_the_same_hash(name: str) -> None:
    """But for the transforms', which it does not have."""
    package, _, kind = name.partition("__msg__")
    theirs = pytest.importorskip(f"ros2_pyterfaces.cyclone.{package}.msg")
    assert getattr(theirs, kind).hash_rihs01() == type_of(getattr(ros, name)).hash


def test_the_hash_of_a_service_is_that_of_others() -> None:
    theirs = pytest.importorskip("ros2_pyterfaces.cyclone.std_srvs.srv")
    assert theirs.Trigger.hash_rihs01() == TRIGGER.hash
    utils = pytest.importorskip("zenoh_ros2_sdk.utils")
    answer = "bool success\nstring message\n"
    assert utils.compute_service_type_hash(TRIGGER.name, "#", answer) == TRIGGER.hash


def test_keys_and_tokens_are_those_of_the_design_page() -> None:
    """That of https://github.com/ros2/rmw_zenoh; its depth of 7 is 10 here."""
    node = NodeName(2, "8b20917502ee955ac4476e0266340d5c", "talker")
    tail = f"std_msgs::msg::dds_::String_/{STRING.hash}"
    assert node.key("/robot1/chatter", STRING) == f"2/robot1/chatter/{tail}"
    assert node.token() == "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/0/NN/%/%/talker"
    token = node.endpoint(10, EntityKind.PUBLISHER, "/chatter", STRING)
    head = "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter"
    assert token == f"{head}/{tail}/::,10:,:,:,,"


@pytest.mark.parametrize("kind", [EntityKind.PUBLISHER, EntityKind.SERVER])
def test_another_package_makes_the_same_keys(kind: EntityKind) -> None:
    entity = pytest.importorskip("zenoh_ros2_sdk.entity")
    keyexpr = pytest.importorskip("zenoh_ros2_sdk.keyexpr")
    qos = pytest.importorskip("zenoh_ros2_sdk.qos")
    node = NodeName(7, "ab12", "swarm_ctl")
    theirs = entity.NodeEntity(7, "ab12", 0, "swarm_ctl")
    assert keyexpr.node_liveliness_keyexpr(theirs) == node.token()
    told = entity.EndpointEntity(
        theirs,
        3,
        entity.EntityKind(str(kind)),
        "/swarm/hold",
        TRIGGER.dds,
        TRIGGER.hash,
        qos.DEFAULT_QOS_PROFILE.encode(),
    )
    assert keyexpr.endpoint_liveliness_keyexpr(told) == node.endpoint(
        3, kind, "/swarm/hold", TRIGGER
    )
    assert keyexpr.topic_keyexpr(7, "/swarm/hold", TRIGGER.dds, TRIGGER.hash) == node.key(
        "/swarm/hold", TRIGGER
    )


@given(
    number=st.integers(1, 2**63 - 1),
    unix_ns=st.integers(0, 2**63 - 1),
    whose=st.binary(min_size=16, max_size=16),
)
def test_an_attachment_is_as_zenoh_serialises_it(number: int, unix_ns: int, whose: bytes) -> None:
    made = Attachment(number, unix_ns, whose)
    assert z_serialize((Int64(number), Int64(unix_ns), whose)).to_bytes() == made.encoded()
    assert Attachment.decoded(made.encoded()) == made
    back = z_deserialize(tuple[Int64, Int64, bytes], ZBytes(made.encoded()))
    assert back == (number, unix_ns, whose)


@pytest.mark.parametrize(
    "wrong",
    [b"", bytes(32), bytes(34), bytes(33), b"\x0fsequence_number" + bytes(61)],
    ids=["none", "short", "long", "no gid", "rmw_zenoh before 0.2.4"],
)
def test_other_bytes_are_no_attachment(wrong: bytes) -> None:
    with pytest.raises(ValueError, match=r"an attachment of \d+ bytes; allowed: 33"):
        Attachment.decoded(wrong)


def test_a_gid_is_the_hash_of_its_token() -> None:
    """XXH3 of 128 bits, the low half first, both little endian; of `abc` and no seed it is
    06b05ab6733a6185 78af5f94892f3950 by xxHash's own sanity checks."""
    high, low = 0x06B05AB6733A6185, 0x78AF5F94892F3950
    assert gid("abc") == struct.pack("<QQ", low, high)


def test_cdr_is_aligned_behind_its_header() -> None:
    """By hand, after DDSI-RTPS 2.5, section 10.2, and its CDR: each value at a multiple of its
    size, counted from behind the header."""
    stamp = ros.builtin_interfaces__msg__Time(7, 8)
    point = ros.geometry_msgs__msg__Point(1.0, 2.0, 3.0)
    turn = ros.geometry_msgs__msg__Quaternion(0.0, 0.0, 0.0, 1.0)
    pose = ros.geometry_msgs__msg__Pose(point, turn)
    made = ros.geometry_msgs__msg__PoseStamped(ros.std_msgs__msg__Header(stamp, "map"), pose)
    head = b"\x00\x01\x00\x00" + struct.pack("<iII4s", 7, 8, 4, b"map\0")
    assert cdr(made) == head + struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)
    made = ros.tf2_msgs__msg__TFMessage(
        [
            ros.geometry_msgs__msg__TransformStamped(
                ros.std_msgs__msg__Header(stamp, "map"),
                "drone_10",
                ros.geometry_msgs__msg__Transform(
                    ros.geometry_msgs__msg__Vector3(1.0, 2.0, 3.0), turn
                ),
            )
        ]
    )
    head = b"\x00\x01\x00\x00" + struct.pack("<IiII4sI9s", 1, 7, 8, 4, b"map\0", 9, b"drone_10\0")
    assert cdr(made) == head + bytes(7) + struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)


def test_an_answer_is_read_by_another_package() -> None:
    theirs = pytest.importorskip("ros2_pyterfaces.cyclone.std_srvs.srv")
    told = theirs.Trigger.Response.deserialize(trigger_response(True, "hold: accepted"))
    assert (told.success, told.message) == (True, "hold: accepted")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("hexagon", "hexagon"),
        ("Wide-V 2", "wide_v_2"),
        ("3x3", "n3x3"),
        ("", "n"),
        ("süd", "s_d"),
        ("__a__", "a"),
    ],
)
def test_names_of_a_mission_become_names_of_ros(text: str, name: str) -> None:
    assert ros_name(text) == name
