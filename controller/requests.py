"""Requests of users, and what the controller answers."""

from typing import NamedTuple, Protocol

__all__ = ["Asked", "Reply"]


class Reply(NamedTuple):
    """Answer to a request: was it accepted, the state afterwards, and if it was refused, why."""

    accepted: bool
    state: str
    why: str = ""


class Asked(Protocol):
    """A stage that takes requests."""

    def ask(self, t_ns: int, what: str, argument: str) -> Reply:
        """Does what is asked, or refuses and changes nothing."""
