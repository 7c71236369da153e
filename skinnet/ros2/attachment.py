"""Attachment of each rmw_zenoh message: sequence number, source time and sender's GID.

33 bytes, little-endian: int64 sequence number from 1, int64 nanoseconds since the epoch, the length of the
GID, its 16 bytes (docs/design.md, Publishers). The GID is XXH3-128 of the sender's liveliness token, the low
half first (`Entity` in liveliness_utils.cpp).
"""

import struct
from typing import NamedTuple

import xxhash

from skinnet.errors import ProtocolError

__all__ = ["Attachment", "gid_of"]

_GID_BYTES = 16
_STRUCT = struct.Struct(f"<qqB{_GID_BYTES}s")


class Attachment(NamedTuple):
    """Attachment fields: sequence number, wall time [ns since the epoch], GID of the sender (16 bytes)."""

    sequence_number: int
    source_time_ns: int
    gid: bytes

    def pack(self) -> bytes:
        """Encode the attachment (33 bytes)."""
        return _STRUCT.pack(self.sequence_number, self.source_time_ns, _GID_BYTES, self.gid)

    @classmethod
    def unpack(cls, payload: bytes | None) -> "Attachment":
        """Decode an attachment.

        Raises:
            ProtocolError: there is none, or its layout differs.
        """
        if payload is None:
            raise ProtocolError("missing attachment; rmw_zenoh publishers send one")
        if len(payload) != _STRUCT.size or payload[2 * 8] != _GID_BYTES:
            raise ProtocolError(
                f"an attachment of {len(payload)} bytes; rmw_zenoh since 0.2.4 sends {_STRUCT.size}"
            )
        sequence, t_ns, _, gid = _STRUCT.unpack(payload)
        return cls(sequence, t_ns, gid)


def gid_of(token: str) -> bytes:
    """GID (16 bytes) of the entity that declares `token`."""
    return xxhash.xxh3_128_digest(token.encode())[::-1]
