"""The wire of users at the watch endpoint, beside what they overhear: what runs, and how it should move."""

from skinnet.messages import Message

__all__ = ["Deployed", "Velocity"]


class Velocity(Message, frozen=True, kw_only=True, tag="velocity"):
    """Joint velocities [rad/s] that a user adds to the controller's own, in the order of the joints.

    They count for 100 ms of simulated time, unless others come. The safety clamp has the last word. Runs take
    them only if `controller.outside_velocity` lets them.
    """

    velocity_rad_s: list[float]


class Deployed(Message, frozen=True, kw_only=True, tag="deployed"):
    """What runs: the whole deployment as JSON, as in the run folder; paths in it start from folder `base`."""

    deployment: str
    base: str
