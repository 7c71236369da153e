"""Scripted stimuli, as a deployment describes them."""

from skinnet.deployment.table import Share, Table

__all__ = ["ScriptSpec"]


class ScriptSpec(Table, frozen=True, kw_only=True):
    """Stimuli from a script instead of physics: joints follow their commands exactly, touch is prescribed."""

    stimulated: Share = 0.0
    """Share of the cells that are touched."""
