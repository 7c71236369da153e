"""The wire of recordings and watchers: what nobody in the loop needs, and everybody who looks at a run."""

from skinnet.messages import Message

__all__ = ["Counters", "Fault", "World"]


class World(Message, frozen=True, kw_only=True, tag="world"):
    """Where what moves freely in the world is at `t_ns`, by name: position [m] and quaternion (w, x, y, z).

    There are the teacher's `finger`, `object` and `stand`, and `payload`, each if the deployment has it. This
    is ground truth: for recordings and watchers, never for the controller.
    """

    t_ns: int
    covered_ns: int
    poses: dict[str, list[float]]


class Counters(Message, frozen=True, kw_only=True, tag="counters"):
    """What a host has counted up to `t_ns`, by name."""

    host: str
    t_ns: int
    counts: dict[str, int]


class Fault(Message, frozen=True, kw_only=True, tag="fault"):
    """A fault of the deployment begins or ends at `t_ns` at one place.

    `rule` is the number of its rule in `[[faults]]`. A fault that begins with the run and stays has no end.
    """

    t_ns: int
    rule: int
    kind: str
    target: str
    begins: bool
