"""Joint velocities from ROS 2: what a controller of ros2_control would take, checked before it goes anywhere.

`std_msgs/msg/Float64MultiArray`, one number a joint in the order of `joint_states`, is what
`velocity_controllers/JointGroupVelocityController` and its like take on `~/commands`: whoever can move a
robot of ROS in this way can move this one. Its layout says nothing there, nor here.
"""

import numpy as np

from skinnet.errors import ProtocolError
from skinnet.outside_messages import Velocity
from skinnet.ros2.attachment import Attachment, gid_of
from skinnet.ros2.keys import Entity
from skinnet.ros2.types import VELOCITIES, decode

__all__ = ["Control"]

_KNOWN = 1000
"""Senders whose names are kept."""


class Control:
    """Turns messages into velocities for the run; knows senders by their tokens.

    Args:
        n_dofs: D, number of joints.
    """

    def __init__(self, n_dofs: int) -> None:
        self.taken = 0
        """Messages that were good."""
        self.refused = 0
        """Messages that were not."""
        self._n_dofs = n_dofs
        self._names: dict[bytes, str] = {}

    def see(self, token: str, there: bool) -> None:
        """A publisher's token came or went."""
        try:
            node = Entity.of_token(token).node
        except ProtocolError:
            return
        if not there:
            self._names.pop(gid_of(token), None)
        elif len(self._names) < _KNOWN:
            self._names[gid_of(token)] = f"{node.namespace.rstrip('/')}/{node.name}"

    def velocity(self, payload: bytes, attachment: bytes | None) -> Velocity:
        """What a message wants.

        Raises:
            ProtocolError: one line: who sent what is wrong.
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
