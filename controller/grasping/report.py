"""Result facts of the teach-and-grasp stages."""

from collections.abc import Sequence
from typing import Any

from controller.grasping.session import Session
from controller.knowledge import Knowledge

__all__ = ["session_facts"]


def session_facts(sessions: Sequence[Session], knowledge: Knowledge) -> dict[str, Any]:
    """Collect transitions and refused requests of all stages, and the taught poses and areas."""
    return {
        "session": [entry._asdict() for session in sessions for entry in session.log],
        "refused_requests": [entry for session in sessions for entry in session.refused],
        "poses": {name: pose.tolist() for name, pose in knowledge.poses.items()},
        "areas": {label: cells.tolist() for label, cells in knowledge.areas.items()},
    }
