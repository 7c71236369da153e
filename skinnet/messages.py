"""The wire: frozen MessagePack structs, one per channel of `skinnet.channels`.

Every message is a map that names its type and its schema version, so that any MessagePack decoder reads it.
New fields come last, with a default. Bulk numbers travel as little-endian bytes of the stated type.

Time: `t_ns` is simulated time. A frame closes its period with `covered_ns`: whatever its sender had to say
about the time before it has been said (the receivers' guarantee in the conservative simulation).
"""

from enum import IntEnum
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError

__all__ = [
    "FORCE_CHANNELS",
    "FOREVER_NS",
    "READING_NAMES",
    "SCHEMA",
    "STIMULUS_NAMES",
    "STREAM_ROW",
    "Answer",
    "Command",
    "Config",
    "ControllerState",
    "EventKind",
    "Events",
    "Joints",
    "Message",
    "Modality",
    "Request",
    "SkinFrame",
    "Stimulus",
    "Stream",
    "Topology",
    "decode",
    "encode",
    "pack",
    "unpack",
]

SCHEMA = 1
FOREVER_NS = 2**62
FORCE_CHANNELS = 3
STIMULUS_NAMES = (
    "force0_n",
    "force1_n",
    "force2_n",
    "distance_m",
    "ax_m_s2",
    "ay_m_s2",
    "az_m_s2",
    "temperature_c",
)
"""Columns of a stimulus, per cell, in the cell's frame (z: outward normal); distance is inf beyond reach."""
READING_NAMES = ("force0", "force1", "force2", "proximity", "ax_g", "ay_g", "az_g", "temperature_c")
"""Columns of a full reading, per cell."""

STREAM_ROW = np.dtype(
    [
        ("t_sampled_ns", "<i8"),
        ("t_delivered_ns", "<i8"),
        ("seq", "<i8"),
        ("values", "<f4", len(READING_NAMES)),
        ("cell", "<u2"),
        ("gateway", "<u2"),
    ]
)
"""One full reading: 60 bytes, no padding; `values` in `READING_NAMES` order."""


class Modality(IntEnum):
    """What a cell feels; the first reading column of each is (0, 3, 4, 7)."""

    FORCE = 0
    PROXIMITY = 1
    ACCELERATION = 2
    TEMPERATURE = 3


class EventKind(IntEnum):
    """Why an event was sent."""

    LEVEL = 0
    """The reading went from one level of Table I to another; `level` is the new one, 0 for none."""
    DELTA = 1
    """The reading moved by more than the cell's delta since the last one sent."""


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """Root of all messages."""

    schema: int = SCHEMA


class Stimulus(Message, frozen=True, kw_only=True, tag="stimulus"):
    """What the cells of one host feel at `t_ns`: (cells, 8) float32 rows in `STIMULUS_NAMES` order.

    The body knows all commands that took effect before `t_ns`. It passes on how many configurations they sent
    to the host's patches since the last frame, and where the run ends, so that hosts need no frames of the
    controller.
    """

    host: str
    t_ns: int
    covered_ns: int
    values: bytes
    configs: int = 0
    end_ns: int | None = None


class Joints(Message, frozen=True, kw_only=True, tag="joints"):
    """Position feedback [rad] of the controlled joints at `t_ns`; its length is the number of DoFs."""

    t_ns: int
    covered_ns: int
    position_rad: list[float]


class Command(Message, frozen=True, kw_only=True, tag="command"):
    """Joint velocities [rad/s] computed at `t_ns`, in effect from `effect_ns` until the next command's.

    `configs` counts the configuration messages per patch that this period sent. With `end_ns` the run
    ends there.
    """

    t_ns: int
    effect_ns: int
    covered_ns: int
    velocity_rad_s: list[float]
    stage: str = ""
    configs: dict[str, int] = {}
    end_ns: int | None = None


class Config(Message, frozen=True, kw_only=True, tag="config"):
    """New settings of one cell; what is None stays. Leaves the gateway at `t_ns` (0: as soon as it arrives).

    `levels` are ascending thresholds of a modality ("force" or "proximity"). The board of a tactile sheet
    (patch "boards", its number as cell) sends its raw pattern every `pattern_every` frames, 0 for no more.
    """

    patch: str
    cell: int
    t_ns: int = 0
    stream: bool | None = None
    encoding: str | None = None
    levels: dict[str, list[float]] | None = None
    hysteresis: dict[str, float] | None = None
    deltas: dict[str, float] | None = None
    pattern_every: int | None = None


class Events(Message, frozen=True, kw_only=True, tag="events"):
    """A list of events, as columns of equal length, from one cell or from a gateway that bundles.

    `cell` indexes the patch; `channel` counts within the modality; `seq` counts the gateway's deliveries.
    """

    patch: str
    gateway: int
    cell: list[int]
    t_sampled_ns: list[int]
    t_delivered_ns: list[int]
    seq: list[int]
    modality: list[int]
    channel: list[int]
    kind: list[int]
    level: list[int]
    value: list[float]


class Stream(Message, frozen=True, kw_only=True, tag="stream"):
    """Full readings of the cells that stream, in the order of delivery: bytes of `STREAM_ROW` records.

    It closes its period as a `SkinFrame` does, so that a patch that streams sends one message less.
    """

    patch: str
    t_ns: int
    covered_ns: int
    events: int
    rows: bytes


class SkinFrame(Message, frozen=True, kw_only=True, tag="skin_frame"):
    """Closes a period of a patch in which nothing streamed: how many events were delivered in it."""

    patch: str
    t_ns: int
    covered_ns: int
    events: int


class Topology(Message, frozen=True, kw_only=True, tag="topology"):
    """What a patch's cells found out about their network, as lists over its cells.

    `network_id` 0 means unreached; `parent` −1 is the gateway, or a cell of another patch; `neighbours` are
    cells, by port, −1 for an open port. `bridged` has (cell, port, number through all patches that are joined
    by bridges) of every neighbour in another patch. A new version replaces the one before.
    """

    patch: str
    version: int
    t_ns: int
    network_id: list[int]
    gateway: list[int]
    master_port: list[int]
    parent: list[int]
    depth: list[int]
    neighbours: list[list[int]]
    bridged: list[list[int]] = msgspec.field(default_factory=list)


class Request(Message, frozen=True, kw_only=True, tag="request"):
    """What a user asks the controller for; the key says what, `argument` says how.

    Users do not send it: they query the key at the watch endpoint, and get the `Answer` of the same `id`.
    """

    id: int
    argument: str = ""


class Answer(Message, frozen=True, kw_only=True, tag="answer"):
    """What became of request `id` at the tick `t_ns`: the state after it; if it was refused, `why`."""

    id: int
    t_ns: int
    accepted: bool
    state: str
    why: str = ""


class ControllerState(Message, frozen=True, kw_only=True, tag="controller_state"):
    """What the controller does, for watchers: sent when its stage changes, and now and then between."""

    t_ns: int
    stage: str
    progress: float
    text: str = ""


_encoder = msgspec.msgpack.Encoder()
encode = _encoder.encode
"""Bytes of a message."""

M = TypeVar("M", bound=Message)
_decoders: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {}


def decode(payload: bytes, kind: type[M]) -> M:
    """Message of type `kind` in `payload`.

    Raises:
        ProtocolError: the payload does not decode, is of another type or of another schema version.
    """
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = msgspec.msgpack.Decoder(kind)
    try:
        message: M = decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(f"not a {kind.__name__}: {error}") from error
    if message.schema != SCHEMA:
        raise ProtocolError(f"{kind.__name__} of schema {message.schema}; this program reads {SCHEMA}")
    return message


def pack(array: NDArray[Any], dtype: str) -> bytes:
    """Bytes of `array` as `dtype` (little-endian, such as "<f4"), in C order."""
    return np.ascontiguousarray(array, dtype=dtype).tobytes()


def unpack(payload: bytes, dtype: np.dtype[Any] | str, columns: int | None = None) -> NDArray[Any]:
    """Array of shape (n,) or (n, columns) over little-endian `payload`; read-only, no copy.

    Raises:
        ProtocolError: the length does not fit.
    """
    kind = np.dtype(dtype)
    if len(payload) % (kind.itemsize * (columns or 1)):
        raise ProtocolError(f"{len(payload)} bytes are no rows of {columns or 1} × {dtype}")
    array: NDArray[Any] = np.frombuffer(payload, dtype=kind)
    return array if columns is None else array.reshape(-1, columns)
