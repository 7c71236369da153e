"""Protobuf without its library: decodes a message by a FileDescriptorSet, and refuses what is not in it.

Written from the encoding guide and descriptor.proto: enough for Foxglove's schemas.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

_VARINT, _I64, _LEN, _I32 = 0, 1, 2, 5
_DOUBLE, _FLOAT, _MESSAGE, _STRING, _BYTES, _FIXED32 = 1, 2, 11, 9, 12, 7
_WIRE = {_DOUBLE: _I64, _FLOAT: _I32, _MESSAGE: _LEN, _STRING: _LEN, _BYTES: _LEN, _FIXED32: _I32}
_REPEATED = 3


def _varint(content: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = content[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at


def fields_of(content: bytes) -> Iterator[tuple[int, int, Any]]:
    """Number, wire type and value of every field."""
    at = 0
    while at < len(content):
        tag, at = _varint(content, at)
        number, wire = tag >> 3, tag & 7
        if wire == _VARINT:
            value, at = _varint(content, at)
        else:
            size = {_I64: 8, _I32: 4}.get(wire)
            if size is None:
                assert wire == _LEN
                size, at = _varint(content, at)
            value, at = content[at : at + size], at + size
            assert len(value) == size, "cut"
        yield number, wire, value


def _fields(content: bytes) -> dict[int, list[Any]]:
    found: dict[int, list[Any]] = defaultdict(list)
    for number, _, value in fields_of(content):
        found[number].append(value)
    return found


class Schema:
    """The messages of a FileDescriptorSet."""

    def __init__(self, descriptors: bytes) -> None:
        self.fields: dict[str, dict[int, tuple[str, int, int, str]]] = {}
        for file in _fields(descriptors)[1]:
            whole = _fields(file)
            package = whole[2][0].decode() if whole[2] else ""
            for message in whole[4]:
                self._add(package, message)

    def _add(self, scope: str, content: bytes) -> None:
        message = _fields(content)
        name = f"{scope}.{message[1][0].decode()}"
        own = self.fields[name] = {}
        for field in map(_fields, message[2]):
            kind = field[6][0].decode().lstrip(".") if field[6] else ""
            own[field[3][0]] = field[1][0].decode(), field[4][0], field[5][0], kind
        for nested in message[3]:
            self._add(name, nested)

    def decode(self, name: str, content: bytes) -> dict[str, Any]:
        """A message as a tree; fails on fields that the schema does not have or has of another type."""
        found: dict[str, Any] = {}
        for number, wire, value in fields_of(content):
            field, label, kind, of = self.fields[name][number]
            assert wire == _WIRE.get(kind, _VARINT) or (label == _REPEATED and wire == _LEN), field
            if kind == _MESSAGE:
                value = self.decode(of, value)
            elif kind == _STRING:
                value = value.decode()
            elif kind == _DOUBLE:
                (value,) = struct.unpack("<d", value)
            if label == _REPEATED:
                found.setdefault(field, []).append(value)
            else:
                found[field] = value
        return found
