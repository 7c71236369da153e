"""Messages for recordings and observers only, with no receiver in the loop."""

from skinnet.protocol.messages import Message

__all__ = ["Counters", "FaultEvent", "FreeBodyPoses"]


class FreeBodyPoses(Message, frozen=True, kw_only=True, tag="free_body_poses"):
    """Poses of the free bodies at `t_ns`, by name: position [m] and quaternion (w, x, y, z), world frame.

    The bodies are the teacher's `finger`, `object`, `stand` and `payload`, each if the deployment has it.
    Ground truth: for recordings and observers, never for the controller.
    """

    t_ns: int
    watermark_ns: int
    poses: dict[str, list[float]]


class Counters(Message, frozen=True, kw_only=True, tag="counters"):
    """Counters of a cell process up to `t_ns`, by name."""

    process: str
    t_ns: int
    counts: dict[str, int]


class FaultEvent(Message, frozen=True, kw_only=True, tag="fault_event"):
    """Fault event: an injected fault begins or ends at `t_ns` at one target.

    `rule` is the index of its rule in `[[faults]]`. A fault that lasts to the end of the run has no end
    event.
    """

    t_ns: int
    rule: int
    kind: str
    target: str
    begins: bool
