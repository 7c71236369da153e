"""Where messages come from: a run that goes on, or the recording of one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from skinnet.deployment.schema import Deployment
from skinnet.view.state import Scene

__all__ = ["Source"]


class Source(Protocol):
    """Lets a scene take what there is.

    Attributes:
        deployment: What runs or ran.
        base: Folder that paths in it start from.
        title: What it is, in a few words.
    """

    deployment: Deployment
    base: Path
    title: str

    @property
    def over(self) -> str:
        """Why nothing more will come; empty as long as something may."""

    def feed(self, scene: Scene, now_s: float) -> int:
        """Lets `scene` take what has come by `now_s` of the wall's clock; returns how many messages."""

    def facts(self) -> Mapping[str, str]:
        """What the source says of itself, by name."""

    def close(self) -> None:
        """Ends it."""
