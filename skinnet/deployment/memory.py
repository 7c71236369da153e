"""Long-term memory, as a deployment describes it."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.table import Table

__all__ = ["MemorySpec"]


class MemorySpec(Table, frozen=True, kw_only=True):
    """What the controller knows from earlier runs; a run keeps its own `memory.sqlite` in its folder."""

    read: Annotated[str, Meta(min_length=1)] | None = None
    """A memory file, or its export as JSON, relative to the deployment: what the controller knows when it
    starts. Nothing unless given."""
