"""Neighbour table of a cell: network IDs at its ports, and those last reported to the computer."""

from collections.abc import Iterable

from skinnet.skin.lattice import N_PORTS

__all__ = ["NeighbourTable"]

_UNREPORTED = -1


class NeighbourTable:
    """Neighbour table: network IDs at the ports of a cell.

    Attributes:
        generation: Count of cold epochs, modulo 8, for which IDs are valid; IDs of another age are void.
    """

    def __init__(self) -> None:
        self.generation = 0
        self._entries: list[tuple[int, int] | None] = [None] * N_PORTS
        self._reported = [_UNREPORTED] * N_PORTS

    def id_at(self, port: int) -> int | None:
        """Return the network ID at a port; None while it is unknown or void."""
        known = self._entries[port]
        return known[0] if known is not None and known[1] == self.generation else None

    def is_complete(self, ports: Iterable[int]) -> bool:
        """Return True if the IDs at all of these ports are known."""
        return all(self.id_at(port) is not None for port in ports)

    def update(self, port: int, network_id: int, generation: int) -> bool:
        """Record the neighbour's ID at a port; return True if the valid ID has changed."""
        before = self.id_at(port)
        self._entries[port] = (network_id, generation)
        return self.id_at(port) != before

    def remove(self, port: int) -> None:
        """Remove the neighbour at a port, whose link is down."""
        self._entries[port] = None

    def mark_all_unreported(self) -> None:
        """Mark all neighbours as unreported, since earlier reports may have been lost."""
        self._reported = [_UNREPORTED] * N_PORTS

    def take_unreported(self) -> list[tuple[int, int, int]]:
        """Return unreported neighbours, by pair of ports, and mark them as reported.

        Each entry is (first port, ID there, ID at the next port).
        """
        pairs = []
        for port in range(0, N_PORTS, 2):
            now = [self.id_at(port) or 0, self.id_at(port + 1) or 0]
            if now != self._reported[port : port + 2]:
                self._reported[port : port + 2] = now
                pairs.append((port, *now))
        return pairs  # type: ignore[return-value]
