"""Packet input and output of cells, compiled: samples to packets, packets to rows of readings."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cells.networking.packet_pool import PacketKind
from cells.sensing.encoding import EncoderOutput
from skinnet.compilation import compiled

__all__ = ["read_stream_rows", "write_packets"]

_EVENT, _READING = int(PacketKind.EVENT), int(PacketKind.READING)


@compiled
def write_packets(
    output: EncoderOutput,
    readings: NDArray[np.float32],
    t_sampled_ns: NDArray[np.int64],
    packet_id: NDArray[np.int64],
    payload: NDArray[Any],
    cell: NDArray[np.int64],
    t_ns: NDArray[np.int64],
) -> None:
    """Write packet payloads of events, then of full readings, and the cell and time of each packet.

    Args:
        output: Events (e) and cells that send their full reading (f).
        readings: (cells, 8) readings of all cells.
        t_sampled_ns: (cells,) sampling times [ns].
        packet_id: (e + f,) rows of `payload` to write.
        payload: (rows,) `PAYLOAD` records of the pool.
        cell: (e + f,) out: cell of each packet.
        t_ns: (e + f,) out: time at which each packet is sent [ns].
    """
    event_cell, full_cell = output.cell, output.full_cell
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
        # overwrite every field: rows are reused
        payload[row].modality = output.modality[i] if is_event else 0
        payload[row].channel = output.channel[i] if is_event else 0
        payload[row].event_kind = output.kind[i] if is_event else 0
        payload[row].level = output.level[i] if is_event else 0
        payload[row].value = output.value[i] if is_event else 0.0
        for column in range(readings.shape[1]):
            payload[row].values[column] = 0.0 if is_event else readings[who, column]


@compiled
def read_stream_rows(
    selected: NDArray[np.int64],
    packet_id: NDArray[np.int64],
    t_ns: NDArray[np.int64],
    patch: NDArray[np.int64],
    gateway: NDArray[np.int64],
    payload: NDArray[Any],
    start: NDArray[np.int64],
    rows: NDArray[Any],
) -> None:
    """Write full readings as `STREAM_ROW` records, grouped by patch, each in order of delivery.

    Args:
        selected: (n,) indices of the finished packets to read.
        packet_id: (k,) rows of the pool of all finished packets.
        t_ns: (k,) delivery times [ns].
        patch: (k,) patch of each packet's cell.
        gateway: (k,) port of the interface at which each packet arrived.
        payload: `PAYLOAD` records of the pool.
        start: (patches + 1,) out: rows of patch p are start[p] to start[p + 1].
        rows: (n,) out; `cell` is the index within the process, `seq` is zero.
    """
    start[:] = 0
    for i in selected:
        start[patch[i] + 1] += 1
    for p in range(start.size - 1):
        start[p + 1] += start[p]
    fill = start.copy()
    for i in selected:
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
