"""Long-term memory spec."""

from typing import Annotated

from msgspec import Meta

from skinnet.deployment.types import Table

__all__ = ["MemorySpec"]


class MemorySpec(Table, frozen=True, kw_only=True):
    """Long-term memory from earlier runs; each run writes its own `memory.sqlite` to its folder."""

    read: Annotated[str, Meta(min_length=1)] | None = None
    """Path of a memory file or of its JSON export, relative to the deployment, read at the start; empty
    memory unless given."""
