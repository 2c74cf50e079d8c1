"""How rmw_zenoh names things: keys of topics, tokens by which nodes are found, attachments.

As in the design document of rmw_zenoh_cpp (https://github.com/ros2/rmw_zenoh, docs/design.md).
"""

import hashlib
import re
import struct
from dataclasses import dataclass
from typing import Final

_ATTACHMENT: Final = struct.Struct("<qqB16s")
"""Number of the message, ns since 1970, length of the identifier, identifier of the publisher."""
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_NOTHING: Final = "%"
"""Stands for an empty name, and in names for a slash."""
_QOS: Final = "::,10:,:,:,,"
"""Everything as by default: reliable, volatile, the last ten."""
_MOST_DOMAIN: Final = 232


@dataclass(frozen=True)
class Node:
    """A node of the ROS graph."""

    domain: int
    session: str
    """Zenoh's identifier of the session."""
    name: str
    number: int = 0

    def __post_init__(self) -> None:
        """Raises ValueError."""
        if not 0 <= self.domain <= _MOST_DOMAIN:
            raise ValueError(f"a ROS domain is 0 to {_MOST_DOMAIN}, not {self.domain}")
        if not _NAME.fullmatch(self.name):
            raise ValueError(f"{self.name!r} cannot be the name of a node")

    @property
    def token(self) -> str:
        """The liveliness token by which it is found."""
        return f"{self._head(self.number)}/NN/{_NOTHING}/{_NOTHING}/{self.name}"

    def _head(self, entity: int) -> str:
        return f"@ros2_lv/{self.domain}/{self.session}/{self.number}/{entity}"

    def publisher_token(self, entity: int, topic: "Topic") -> str:
        """The one by which a publisher of it is found."""
        head = f"{self._head(entity)}/MP/{_NOTHING}/{_NOTHING}/{self.name}"
        return f"{head}/{_mangled(topic.name)}/{topic.dds_type}/{topic.type_hash}/{_QOS}"


@dataclass(frozen=True)
class Topic:
    """A topic with its type."""

    name: str
    """With its leading slash."""
    type: str
    """`geometry_msgs/msg/PoseStamped`."""
    type_hash: str
    """`RIHS01_…`, by REP 2016."""

    @property
    def dds_type(self) -> str:
        package, kind, name = self.type.split("/")
        return f"{package}::{kind}::dds_::{name}_"

    def key(self, domain: int) -> str:
        """What it is published under."""
        return f"{domain}/{self.name.lstrip('/')}/{self.dds_type}/{self.type_hash}"


def attachment(number: int, date_ns: int, identifier: bytes) -> bytes:
    """What every message of rmw_zenoh carries. identifier: 16 bytes."""
    return _ATTACHMENT.pack(number, date_ns, len(identifier), identifier)


def publisher_identifier(token: str) -> bytes:
    """16 bytes that are the publisher's own: of its token, which no other has."""
    return hashlib.blake2b(token.encode(), digest_size=16).digest()


def _mangled(name: str) -> str:
    return name.replace("/", _NOTHING)
