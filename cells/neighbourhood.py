"""Which cells a cell has next to it, and what of that the computer has been told."""

from collections.abc import Iterable

from skinnet.skin.lattice import N_PORTS

__all__ = ["Neighbourhood"]

_NOTHING = -1


class Neighbourhood:
    """IDs at the ports of a cell.

    Attributes:
        age: Age of the formation whose IDs hold; those of another are void.
    """

    def __init__(self) -> None:
        self.age = 0
        self._found: list[tuple[int, int] | None] = [None] * N_PORTS
        self._told = [_NOTHING] * N_PORTS

    def at(self, port: int) -> int | None:
        """ID at a port; None while it is not known, or void."""
        known = self._found[port]
        return known[0] if known is not None and known[1] == self.age else None

    def complete(self, ports: Iterable[int]) -> bool:
        """Whether the IDs at all of these ports are known."""
        return all(self.at(port) is not None for port in ports)

    def note(self, port: int, network_id: int, age: int) -> bool:
        """There is this cell at a port; returns whether that is news."""
        before = self.at(port)
        self._found[port] = (network_id, age)
        return self.at(port) != before

    def lose(self, port: int) -> None:
        """There is no link at a port any more."""
        self._found[port] = None

    def tell_all_again(self) -> None:
        """Whatever was told may have been lost on the way."""
        self._told = [_NOTHING] * N_PORTS

    def untold(self) -> list[tuple[int, int, int]]:
        """(port, ID there, ID at the next port) of each two ports that the computer does not know right."""
        pairs = []
        for port in range(0, N_PORTS, 2):
            now = [self.at(port) or 0, self.at(port + 1) or 0]
            if now != self._told[port : port + 2]:
                self._told[port : port + 2] = now
                pairs.append((port, *now))
        return pairs  # type: ignore[return-value]
