"""What rmw_zenoh has on the wire: keys, liveliness tokens, attachments and CDR. Pure.

As its design page says, and `liveliness_utils.cpp` and `attachment_helpers.cpp` do
(https://github.com/ros2/rmw_zenoh, 0.2.4 and later: Jazzy, Kilted, Lyrical, Rolling). Humble's keys
have no type hash: its nodes neither see these topics nor are seen.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Any, Final, NamedTuple

import xxhash
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

QOS: Final = "::,10:,:,:,,"
"""Reliable, volatile, the last ten; what is left out is rmw_zenoh's default."""
_GID: Final = 16
_ATTACHMENT: Final = struct.Struct(f"<qqB{_GID}s")
_SRV_TYPES: Final = {
    "std_srvs/msg/Trigger_Request": "",
    "std_srvs/msg/Trigger_Response": "bool success\nstring message\n",
}
_NAME: Final = re.compile(r"[^A-Za-z0-9_]")


class EntityKind(StrEnum):
    """What a liveliness token is of."""

    NODE = "NN"
    PUBLISHER = "MP"
    SERVER = "SS"


class RosType(NamedTuple):
    """A message's or a service's type, such as `geometry_msgs/msg/Pose`, and its hash."""

    name: str
    hash: str
    """`RIHS01_` and a SHA-256 of the definition."""

    @property
    def dds(self) -> str:
        """`geometry_msgs::msg::dds_::Pose_`."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"


TRIGGER: Final = RosType(
    "std_srvs/srv/Trigger",
    # published with ROS 2 from Iron on; of a service it is made of four definitions
    "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
)


class Attachment(NamedTuple):
    """What goes with each message, request and answer."""

    number: int
    """From 1 on, of one publisher; an answer has its request's."""
    unix_ns: int
    """When it was sent."""
    gid: bytes
    """The publisher's or the client's, 16 bytes."""

    def encoded(self) -> bytes:
        """33 bytes."""
        return _ATTACHMENT.pack(self.number, self.unix_ns, _GID, self.gid)

    @classmethod
    def decoded(cls, data: bytes) -> Attachment:
        """ValueError where the bytes are none, as those of rmw_zenoh before 0.2.4."""
        if len(data) != _ATTACHMENT.size or data[16] != _GID:
            raise ValueError(
                f"an attachment of {len(data)} bytes; allowed: {_ATTACHMENT.size}, as rmw_zenoh has"
                " them from 0.2.4 on"
            )
        number, unix_ns, _, gid = _ATTACHMENT.unpack(data)
        return cls(number, unix_ns, gid)


@dataclass(frozen=True, slots=True)
class NodeName:
    """A node of ROS 2. `session`: the id of its zenoh session, in hexadecimal."""

    domain: int
    session: str
    name: str

    def key(self, name: str, of: RosType) -> str:
        """Under which a topic's messages go, or a service is asked; `name`: `/drone_1/pose`."""
        return f"{self.domain}/{name.strip('/')}/{of.dds}/{of.hash}"

    def token(self) -> str:
        """Of the node itself."""
        return f"{self._head(0, EntityKind.NODE)}"

    def endpoint(self, number: int, kind: EntityKind, name: str, of: RosType) -> str:
        """The token of a publisher or a server, the node's `number`th."""
        mangled = name.replace("/", "%")
        return f"{self._head(number, kind)}/{mangled}/{of.dds}/{of.hash}/{QOS}"

    def _head(self, number: int, kind: EntityKind) -> str:
        return f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}/%/%/{self.name}"


def nodes_of(domain: int) -> str:
    """Matches the tokens of all nodes in a domain's root namespace."""
    return f"@ros2_lv/{domain}/*/*/*/{EntityKind.NODE}/%/%/*"


def gid(token: str) -> bytes:
    """By which ROS 2 knows the one whose liveliness token that is: 16 bytes."""
    return xxhash.xxh3_128_digest(token.encode())[::-1]


def ros_name(text: str) -> str:
    """As a part of a topic's name: letters, digits and underscores, no digit first."""
    plain = re.sub("_+", "_", _NAME.sub("_", text)).strip("_").lower()
    return plain if plain and not plain[0].isdigit() else f"n{plain}"


@cache
def _store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _SRV_TYPES.items():
        store.register(get_types_from_msg(text, name))
    return store


def type_of(message: Any) -> RosType:
    """Of one of rosbags' messages."""
    return RosType(message.__msgtype__, _store().hash_rihs01(message.__msgtype__))


def cdr(message: Any) -> bytes:
    """One of rosbags' messages in CDR, little endian, behind its header of four bytes."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def trigger_response(success: bool, message: str) -> bytes:
    """The answer of a `std_srvs/srv/Trigger`."""
    made = _store().types["std_srvs/msg/Trigger_Response"]
    return cdr(made(success, message))
