"""What the controller keeps."""

from controller.knowledge import Knowledge

__all__ = ["LongTermMemory"]


class LongTermMemory:
    """Nothing is kept yet."""

    def __init__(self, store: None, knowledge: Knowledge) -> None:
        self._store, self._knowledge = store, knowledge

    def remember_structure(self) -> None:
        """Nothing."""

    def remember_pose(self, name: str) -> None:
        """Nothing."""

    def remember_areas(self) -> None:
        """Nothing."""
