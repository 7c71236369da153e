"""Joint velocity commands from ROS 2, in the message format of ros2_control, validated before use.

The type is `std_msgs/msg/Float64MultiArray` with one velocity [rad/s] for each joint in the order of
`joint_states`, as `velocity_controllers/JointGroupVelocityController` accepts it on `~/commands`. Its
`layout` is ignored, as it is there.
"""

import numpy as np

from skinnet.errors import ProtocolError
from skinnet.outside_messages import Velocity
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.keys import Entity
from skinnet.ros2.types import VELOCITIES, decode

__all__ = ["Control"]

_KNOWN = 1000
"""Maximum number of senders whose names are kept."""


class Control:
    """Velocity command parser; names senders by their liveliness tokens.

    Args:
        n_dofs: D, number of joints.
    """

    def __init__(self, n_dofs: int) -> None:
        self.taken = 0
        """Number of accepted messages."""
        self.refused = 0
        """Number of refused messages."""
        self._n_dofs = n_dofs
        self._names: dict[bytes, str] = {}

    def see(self, token: str, there: bool) -> None:
        """Update the known senders when a publisher's liveliness token appears or disappears."""
        try:
            node = Entity.of_token(token).node
        except ProtocolError:
            return
        if not there:
            self._names.pop(gid_of(token), None)
        elif len(self._names) < _KNOWN:
            self._names[gid_of(token)] = f"{node.namespace.rstrip('/')}/{node.name}"

    def velocity(self, payload: bytes, attachment: bytes | None) -> Velocity:
        """Decode and validate a velocity command.

        Raises:
            ProtocolError: it is malformed, of the wrong size or not finite; names the sender.
        """
        sender = "somebody"
        try:
            gid = Attachment.unpack(attachment).gid
            sender = self._names.get(gid, f"the publisher {gid.hex()}")
            data = decode(payload, VELOCITIES).data
            if len(data) != self._n_dofs:
                raise ProtocolError(f"velocities of {len(data)} joints; the run has {self._n_dofs}")
            if not np.isfinite(data).all():
                raise ProtocolError("velocities that are not finite")
        except ProtocolError as error:
            self.refused += 1
            raise ProtocolError(f"{sender}: {error}") from error
        self.taken += 1
        return Velocity(velocity_rad_s=data.tolist())
