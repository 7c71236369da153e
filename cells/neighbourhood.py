"""Neighbour table of a cell: network IDs at its ports, and those last reported to the computer."""

from collections.abc import Iterable

from skinnet.skin.lattice import N_PORTS

__all__ = ["Neighbourhood"]

_NOTHING = -1


class Neighbourhood:
    """Neighbour table: network IDs at the ports of a cell.

    Attributes:
        age: Count of cold epochs, modulo 8, for which IDs are valid; IDs of another age are void.
    """

    def __init__(self) -> None:
        self.age = 0
        self._found: list[tuple[int, int] | None] = [None] * N_PORTS
        self._told = [_NOTHING] * N_PORTS

    def at(self, port: int) -> int | None:
        """Return the network ID at a port; None while it is unknown or void."""
        known = self._found[port]
        return known[0] if known is not None and known[1] == self.age else None

    def complete(self, ports: Iterable[int]) -> bool:
        """Return True if the IDs at all of these ports are known."""
        return all(self.at(port) is not None for port in ports)

    def note(self, port: int, network_id: int, age: int) -> bool:
        """Record the neighbour's ID at a port; return True if the valid ID has changed."""
        before = self.at(port)
        self._found[port] = (network_id, age)
        return self.at(port) != before

    def lose(self, port: int) -> None:
        """Remove the neighbour at a port, whose link is down."""
        self._found[port] = None

    def tell_all_again(self) -> None:
        """Mark all neighbours as unreported, since earlier reports may have been lost."""
        self._told = [_NOTHING] * N_PORTS

    def untold(self) -> list[tuple[int, int, int]]:
        """Return unreported neighbours, by pair of ports, and mark them as reported.

        Each entry is (first port, ID there, ID at the next port).
        """
        pairs = []
        for port in range(0, N_PORTS, 2):
            now = [self.at(port) or 0, self.at(port + 1) or 0]
            if now != self._told[port : port + 2]:
                self._told[port : port + 2] = now
                pairs.append((port, *now))
        return pairs  # type: ignore[return-value]
