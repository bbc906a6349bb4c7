"""The keys under which a ROS 2 node with rmw_zenoh sees our joint states. Off by default (``zenoh.ros2_attachment``).

rmw_zenoh publishes a topic under ``<domain>/<topic>/<type>/<type hash>`` and announces it by liveliness tokens below
``@ros2_lv``; every sample carries an attachment: sequence number and source time (int64 each), then the publisher's
16-byte id behind its length (docs/design.md and attachment_helpers.cpp of ros2/rmw_zenoh). An attachment of another
form can abort a ROS node. Keys, type hash (REP-2016) and the form of the attachment are tested; nothing has been tried
against ROS 2 itself.
"""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh

TOPIC = "joint_states"
JOINT_STATE_TYPE = "sensor_msgs::msg::dds_::JointState_"
JOINT_STATE_HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
ATTACHMENT = struct.Struct("<qqB16s")
QOS = "2::,10:,:,:,,"
"""Best effort; all else as ROS 2 has it by default, keep last 10."""

NODE, PUBLISHER = 0, 1
"""Our entity numbers within the session."""


def topic_key(domain: int, topic: str) -> str:
    """Key of a JointState topic, given without its leading '/'."""
    return f"{domain}/{topic}/{JOINT_STATE_TYPE}/{JOINT_STATE_HASH}"


def tokens(domain: int, session: str, node: str, topic: str) -> tuple[str, str]:
    """Liveliness tokens of the node and of its publisher; '%' stands for '/', and for no enclave and no namespace."""
    place = f"@ros2_lv/{domain}/{session}/{NODE}"
    mangled = "%" + topic.replace("/", "%")
    return (
        f"{place}/{NODE}/NN/%/%/{node}",
        f"{place}/{PUBLISHER}/MP/%/%/{node}/{mangled}/{JOINT_STATE_TYPE}/{JOINT_STATE_HASH}/{QOS}",
    )


def attachment(sequence: int, source_ns: int, gid: bytes) -> bytes:
    """The 33 bytes that rmw_zenoh expects on every sample; ``gid`` has 16."""
    return ATTACHMENT.pack(sequence, source_ns, len(gid), gid)


class RosPublisher:
    """The topic /joint_states as rmw_zenoh would publish it; ``node`` is a ROS name (letters, digits, underscores)."""

    def __init__(self, session: zenoh.Session, domain: int, node: str) -> None:
        import zenoh

        zid = str(session.zid())
        self._publisher = session.declare_publisher(
            topic_key(domain, TOPIC), congestion_control=zenoh.CongestionControl.DROP
        )
        self._tokens = [session.liveliness().declare_token(key) for key in tokens(domain, zid, node, TOPIC)]
        self._gid = bytes.fromhex(zid.zfill(32))
        self._sequence = 0

    def put(self, message: bytes) -> None:
        """One CDR message."""
        self._sequence += 1
        self._publisher.put(message, attachment=attachment(self._sequence, time.time_ns(), self._gid))
