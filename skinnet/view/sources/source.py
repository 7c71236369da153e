"""Message source interface of the page: a live run or a recording."""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from skinnet.deployment.deployment import Deployment
from skinnet.view.state.run_state import RunState

__all__ = ["MessageSource"]


class MessageSource(Protocol):
    """Message source for a scene.

    Attributes:
        deployment: Deployment of the run.
        base: Folder that relative paths in the deployment start from.
        title: Short description of the source.
    """

    deployment: Deployment
    base: Path
    title: str

    @property
    def end_reason(self) -> str:
        """End reason of the source; empty while it may deliver messages."""

    def deliver(self, run_state: RunState, now_s: float) -> int:
        """Deliver to `run_state` the messages due by wall time `now_s` [s]; return their number."""

    def properties(self) -> Mapping[str, str]:
        """Properties of the source, as text by name."""

    def close(self) -> None:
        """Close the source."""
