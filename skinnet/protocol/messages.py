"""Messages of the loop: frozen MessagePack structs, one per channel of `skinnet.protocol.channels`.

Every message is a map that names its type and its schema version, so that any MessagePack decoder reads it.
New fields come last, with a default. Bulk numbers are little-endian bytes of the stated type.

Time: `t_ns` is simulated time. A period end carries the watermark `watermark_ns`: its sender publishes
nothing more about the time before it (the lower bound on time stamps of conservative synchronisation,
Chandy-Misra-Bryant).
"""

from enum import IntEnum
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import ProtocolError

__all__ = [
    "FOREVER_NS",
    "INVALID_CONTENT",
    "N_FORCE_CHANNELS",
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
    "JointRanges",
    "Joints",
    "Message",
    "Modality",
    "PeriodEnd",
    "Request",
    "Stimulus",
    "Stream",
    "Topology",
    "decode",
    "encode",
    "header",
    "pack",
    "unpack",
]

SCHEMA = 2
FOREVER_NS = 2**62
N_FORCE_CHANNELS = 3
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
"""Stimulus columns per cell, in the cell's frame (z: outward normal); distance is inf beyond the range."""
READING_NAMES = ("force0", "force1", "force2", "proximity", "ax_g", "ay_g", "az_g", "temperature_c")
"""Reading columns per cell."""

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
    """Sensor modality of a cell; the first reading column of each is (0, 3, 4, 7)."""

    FORCE = 0
    PROXIMITY = 1
    ACCELERATION = 2
    TEMPERATURE = 3


class EventKind(IntEnum):
    """Event kind: the send condition of its encoding."""

    LEVEL_CROSSING = 0
    """Level crossing: the reading changed its level of Table I; `level` is the new one, 0 for none."""
    SEND_ON_DELTA = 1
    """Send-on-delta: the reading changed by more than the cell's delta since the last one sent."""


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """Base struct of all messages."""

    schema: int = SCHEMA


class Stimulus(Message, frozen=True, kw_only=True, tag="stimulus"):
    """Stimulus of the cells of one cell process at `t_ns`: (cells, 8) float32 rows in `STIMULUS_NAMES` order.

    The body has received all commands in effect before `t_ns`. It forwards the number of configurations sent
    to the patches of the cell process since the last period end, and the end of the run, so that cell
    processes need no period ends of the controller.
    """

    process: str
    t_ns: int
    watermark_ns: int
    values: bytes
    n_configs: int = 0
    end_ns: int | None = None


class Joints(Message, frozen=True, kw_only=True, tag="joints"):
    """Joint position feedback [rad] measured at `t_ns`, (n_dof,) in the order of the controlled joints.

    A source without a new measurement repeats the last one, with its time, under a new watermark.
    """

    t_ns: int
    watermark_ns: int
    position_rad: list[float]


class JointRanges(Message, frozen=True, kw_only=True, tag="joint_ranges"):
    """Position limits [rad, m for a slide] of the controlled joints, (n_dof,) each; infinite without a limit.

    The body sends them once, before the first joint feedback.
    """

    lowest_rad: list[float]
    highest_rad: list[float]


class Command(Message, frozen=True, kw_only=True, tag="command"):
    """Joint velocity command [rad/s] computed at `t_ns`, in effect from `effect_ns` until that of the next.

    `config_counts` counts the configuration messages sent in this period, by patch. `end_ns`, if given, ends
    the run.
    """

    t_ns: int
    effect_ns: int
    watermark_ns: int
    velocity_rad_s: list[float]
    stage: str = ""
    config_counts: dict[str, int] = {}
    end_ns: int | None = None


class Config(Message, frozen=True, kw_only=True, tag="config"):
    """Configuration of one cell; fields of None stay as they are.

    It leaves the gateway at `t_ns` (0: as soon as it arrives). `levels` are ascending thresholds of a
    modality ("force" or "proximity"). The board of a tactile sheet (patch "boards", its number as cell) sends
    its raw pattern every `pattern_interval_scans` scan frames, 0 for never.
    """

    patch: str
    cell: int
    t_ns: int = 0
    stream: bool | None = None
    encoding: str | None = None
    levels: dict[str, list[float]] | None = None
    hysteresis: dict[str, float] | None = None
    deltas: dict[str, float] | None = None
    pattern_interval_scans: int | None = None


class Events(Message, frozen=True, kw_only=True, tag="events"):
    """Skin events as columns of equal length, from one cell or bundled by a gateway.

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
    """Stream of full readings, in the order of delivery: bytes of `STREAM_ROW` records.

    It ends its period as a `PeriodEnd` does, so that a patch that streams sends one message less.
    """

    patch: str
    t_ns: int
    watermark_ns: int
    n_events: int
    rows: bytes


class PeriodEnd(Message, frozen=True, kw_only=True, tag="period_end"):
    """Period end (null message) of a patch without streamed readings; `n_events` counts its deliveries."""

    patch: str
    t_ns: int
    watermark_ns: int
    n_events: int


class Topology(Message, frozen=True, kw_only=True, tag="topology"):
    """Network topology of a patch, as discovered by its cells: lists over its cells.

    `network_id` 0 means unreached; `parent` −1 is the gateway, or a cell of another patch; `neighbours` are
    cells, by port, −1 for an open port. `bridged_neighbours` has (cell, port, cell index across all bridged
    patches) of every neighbour in another patch. A new version replaces the one before.
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
    bridged_neighbours: list[list[int]] = msgspec.field(default_factory=list)


class Request(Message, frozen=True, kw_only=True, tag="request"):
    """Request to the controller; the key names it, `argument` is its argument.

    External clients do not publish it: they query the key at the observer endpoint and get the `Answer` of
    the same `id`.
    """

    id: int
    argument: str = ""


class Answer(Message, frozen=True, kw_only=True, tag="answer"):
    """Answer to request `id` at control tick `t_ns`: the state after it and, if refused, the `reason`."""

    id: int
    t_ns: int
    accepted: bool
    state: str
    reason: str = ""


class ControllerState(Message, frozen=True, kw_only=True, tag="controller_state"):
    """Controller state for observers: stage, its progress (0 to 1) and a status text."""

    t_ns: int
    stage: str
    progress: float
    text: str = ""


_encoder = msgspec.msgpack.Encoder()
encode = _encoder.encode
"""Encode a message as MessagePack bytes."""

M = TypeVar("M", bound=Message)
_decoders: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {}


def decode(payload: bytes, kind: type[M]) -> M:
    """Decode `payload` as a message of type `kind`.

    Raises:
        ProtocolError: the payload does not decode, is of another type or of another schema version.
    """
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = msgspec.msgpack.Decoder(kind)
    try:
        message: M = decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ProtocolError(f"not a {kind.__name__} message: {error}") from error
    if message.schema != SCHEMA:
        raise ProtocolError(
            f"{kind.__name__} of schema version {message.schema}; this program reads version {SCHEMA}"
        )
    return message


INVALID_CONTENT = (ProtocolError, LookupError, ValueError, TypeError, ArithmeticError)
"""Errors by which a decoded message shows that its content does not fit: names, lengths, ranges."""


def header(kind: type[Message], *fields: str) -> type[Message]:
    """Return a message type of the same tag as `kind` with only `fields`; decoding skips the others."""
    own = {field.name: field for field in msgspec.structs.fields(kind)}
    columns: list[Any] = []
    for name in fields:
        if name in own:
            field = own[name]
            columns.append((name, field.type) if field.required else (name, field.type, field.default))
    tag = kind.__struct_config__.tag
    return msgspec.defstruct(  # type: ignore[return-value]
        kind.__name__, columns, bases=(Message,), frozen=True, kw_only=True, tag=tag
    )


def pack(array: NDArray[Any], dtype: str) -> bytes:
    """Return the bytes of `array` as `dtype` (little-endian, such as "<f4"), in C order."""
    return np.ascontiguousarray(array, dtype=dtype).tobytes()


def unpack(payload: bytes, dtype: np.dtype[Any] | str, columns: int | None = None) -> NDArray[Any]:
    """Return a read-only view of little-endian `payload` as an array (n,) or (n, columns).

    Raises:
        ProtocolError: the length does not fit.
    """
    kind = np.dtype(dtype)
    if len(payload) % (kind.itemsize * (columns or 1)):
        raise ProtocolError(
            f"{len(payload)} bytes are not a whole number of rows of {columns or 1} × {dtype}"
        )
    array: NDArray[Any] = np.frombuffer(payload, dtype=kind)
    return array if columns is None else array.reshape(-1, columns)
