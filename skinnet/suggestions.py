"""Suggestions for misspelt names in error messages."""

import difflib
from collections.abc import Iterable

__all__ = ["did_you_mean", "known_names"]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Suggest the known name nearest to `name`: "did you mean torso? ", or nothing if none is near."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean {near[0]}? " if near else ""


def known_names(name: str, known: Iterable[str]) -> str:
    """List the known names after an unknown one, the nearest first: "did you mean a? there are a, b"."""
    names = list(known)
    return f"{did_you_mean(name, names)}there are {', '.join(names) or 'none'}"
