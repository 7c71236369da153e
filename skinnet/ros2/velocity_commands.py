"""Joint velocity commands from ROS 2, in the message format of ros2_control, validated before use.

The type is `std_msgs/msg/Float64MultiArray` with one velocity [rad/s] for each joint in the order of
`joint_states`, as `velocity_controllers/JointGroupVelocityController` accepts it on `~/commands`. Its
`layout` is ignored, as it is there.
"""

import numpy as np

from skinnet.errors import ProtocolError
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.message_types import FLOAT64_MULTI_ARRAY, decode
from skinnet.ros2.rmw_zenoh_keys import Entity

__all__ = ["VelocityCommandParser"]

_MAX_SENDERS = 1000
"""Maximum number of senders whose names are kept."""


class VelocityCommandParser:
    """Velocity command parser; names senders by their liveliness tokens.

    Args:
        n_dofs: D, number of joints.
    """

    def __init__(self, n_dofs: int) -> None:
        self.n_accepted = 0
        """Number of accepted messages."""
        self.n_refused = 0
        """Number of refused messages."""
        self._n_dofs = n_dofs
        self._sender_names: dict[bytes, str] = {}

    def on_publisher_liveliness(self, token: str, alive: bool) -> None:
        """Update the known senders when a publisher's liveliness token appears or disappears."""
        try:
            node = Entity.from_token(token).node
        except ProtocolError:
            return
        if not alive:
            self._sender_names.pop(gid_of(token), None)
        elif len(self._sender_names) < _MAX_SENDERS:
            self._sender_names[gid_of(token)] = f"{node.namespace.rstrip('/')}/{node.name}"

    def parse(self, payload: bytes, attachment: bytes | None) -> ExternalVelocity:
        """Decode and validate a velocity command.

        Raises:
            ProtocolError: it is malformed, of the wrong size or not finite; names the sender.
        """
        sender = "unknown publisher"
        try:
            gid = Attachment.unpack(attachment).gid
            sender = self._sender_names.get(gid, f"publisher {gid.hex()}")
            data = decode(payload, FLOAT64_MULTI_ARRAY).data
            if len(data) != self._n_dofs:
                raise ProtocolError(f"{len(data)} velocities; expected {self._n_dofs}, one for each joint")
            if not np.isfinite(data).all():
                raise ProtocolError("velocities are not finite")
        except ProtocolError as error:
            self.n_refused += 1
            raise ProtocolError(f"{sender}: {error}") from error
        self.n_accepted += 1
        return ExternalVelocity(velocity_rad_s=data.tolist())
