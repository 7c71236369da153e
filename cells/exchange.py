"""Where cells and network meet, compiled: samples become packets, and packets readings, for a whole host."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cells.packets import PacketKind
from skinnet.compiled import compiled

__all__ = ["enter", "take_readings"]

_EVENT, _READING = int(PacketKind.EVENT), int(PacketKind.READING)


@compiled
def enter(
    event_cell: NDArray[np.int64],
    modality: NDArray[np.uint8],
    channel: NDArray[np.uint8],
    event_kind: NDArray[np.uint8],
    level: NDArray[np.uint8],
    value: NDArray[np.float32],
    full_cell: NDArray[np.int64],
    readings: NDArray[np.float32],
    t_sampled_ns: NDArray[np.int64],
    packet_id: NDArray[np.int64],
    payload: NDArray[Any],
    cell: NDArray[np.int64],
    t_ns: NDArray[np.int64],
) -> None:
    """Writes the payloads of events, then of full readings, and the cell and time of each packet.

    Args:
        event_cell: (e,) cells of events, and their columns as in `Emission`:
        modality: (e,) what was felt.
        channel: (e,) channel within the modality.
        event_kind: (e,) why it is sent.
        level: (e,) the new level.
        value: (e,) the reading.
        full_cell: (f,) cells that send their full reading.
        readings: (cells, 8) of all cells.
        t_sampled_ns: (cells,) when each cell took its sample.
        packet_id: (e + f,) rows of `payload` to write.
        payload: (rows,) `PAYLOAD` records of the pool.
        cell: (e + f,) out.
        t_ns: (e + f,) out.
    """
    n_events = event_cell.size
    for i in range(n_events + full_cell.size):
        row = packet_id[i]
        who = event_cell[i] if i < n_events else full_cell[i - n_events]
        cell[i] = who
        t_ns[i] = t_sampled_ns[who]
        payload[row].t_sampled_ns = t_sampled_ns[who]
        payload[row].cell = who
        is_event = i < n_events
        payload[row].kind = _EVENT if is_event else _READING
        # whatever the row carried before is overwritten
        payload[row].modality = modality[i] if is_event else 0
        payload[row].channel = channel[i] if is_event else 0
        payload[row].event_kind = event_kind[i] if is_event else 0
        payload[row].level = level[i] if is_event else 0
        payload[row].value = value[i] if is_event else 0.0
        for column in range(readings.shape[1]):
            payload[row].values[column] = 0.0 if is_event else readings[who, column]


@compiled
def take_readings(
    index: NDArray[np.int64],
    packet_id: NDArray[np.int64],
    t_ns: NDArray[np.int64],
    patch: NDArray[np.int64],
    gateway: NDArray[np.int64],
    payload: NDArray[Any],
    start: NDArray[np.int64],
    rows: NDArray[Any],
) -> None:
    """Writes full readings as `STREAM_ROW` records, patch after patch, each in the order of delivery.

    Args:
        index: (n,) which of the packets that ended to take.
        packet_id: (k,) of all that ended, and the next three.
        t_ns: (k,) times of delivery.
        patch: (k,) patch at whose interface each arrived.
        gateway: (k,) port of the interface.
        payload: Records of the pool.
        start: (patches + 1,) out: rows of patch p are start[p] to start[p + 1].
        rows: (n,) out; `cell` counts through the host, `seq` is zero.
    """
    start[:] = 0
    for i in index:
        start[patch[i] + 1] += 1
    for p in range(start.size - 1):
        start[p + 1] += start[p]
    fill = start.copy()
    for i in index:
        row = packet_id[i]
        to = fill[patch[i]]
        fill[patch[i]] += 1
        rows[to].t_sampled_ns = payload[row].t_sampled_ns
        rows[to].t_delivered_ns = t_ns[i]
        rows[to].seq = 0
        rows[to].cell = payload[row].cell
        rows[to].gateway = gateway[i]
        for column in range(payload[row].values.size):
            rows[to].values[column] = payload[row].values[column]
