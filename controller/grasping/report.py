"""What a session has to tell when the run is over."""

from collections.abc import Sequence
from typing import Any

from controller.grasping.session import Session
from controller.knowledge import Knowledge

__all__ = ["session_facts"]


def session_facts(sessions: Sequence[Session], knowledge: Knowledge) -> dict[str, Any]:
    """Transitions and refused requests of all sessions, and what the robot was taught."""
    return {
        "session": [entry._asdict() for session in sessions for entry in session.log],
        "refused_requests": [entry for session in sessions for entry in session.refused],
        "poses": {name: pose.tolist() for name, pose in knowledge.poses.items()},
        "areas": {label: cells.tolist() for label, cells in knowledge.areas.items()},
    }
