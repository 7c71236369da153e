"""Result facts of the teach-and-grasp stages."""

from collections.abc import Sequence
from typing import Any

from controller.grasping.teach_and_grasp import TeachAndGrasp
from controller.self_model import SelfModel

__all__ = ["teach_and_grasp_facts"]


def teach_and_grasp_facts(sessions: Sequence[TeachAndGrasp], self_model: SelfModel) -> dict[str, Any]:
    """Collect transitions and refused requests of all stages, and the taught poses and areas."""
    return {
        "transitions": [entry._asdict() for session in sessions for entry in session.log],
        "refused_requests": [entry for session in sessions for entry in session.refused],
        "poses": {name: pose.tolist() for name, pose in self_model.poses.items()},
        "areas": {label: cells.tolist() for label, cells in self_model.areas.items()},
    }
