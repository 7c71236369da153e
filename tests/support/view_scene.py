"""A small skin for tests of the live page, and messages as its cells, boards and controller send them."""

from typing import Any

import numpy as np
from small_robot import patch, small

from skinnet.deployment import Deployment
from skinnet.protocol.messages import (
    STREAM_ROW,
    ControllerState,
    EventKind,
    Events,
    Joints,
    Message,
    Modality,
    Stream,
    Topology,
)
from skinnet.view.state.run_state import ReceivedMessage, RunState
from skinnet.view.state.skin_layout import SkinLayout, build_skin_layout

MS = 1_000_000
SHEETS: dict[str, Any] = {
    "surfaces": (
        {
            "name": "side",
            "body": "arm",
            "origin_m": (0.0, 0.5, 0.0),
            "normal": (0.0, 1.0, 0.0),
            "up": (0.0, 0.0, 1.0),
        },
    ),
    "sheets": (
        {"name": "inside", "surface": "side", "columns": 4, "rows": 3, "mask": ("####", "#..#", "####")},
        {"name": "outside", "surface": "side", "columns": 2, "rows": 2, "centre_xi_m": (0.2, 0.0)},
    ),
}


def deployment(**tables: Any) -> Deployment:
    """Six cells on an arm, two on a hand; sheets if asked for."""
    return small(patch("arm"), patch("hand", 2, 1), **tables)


def scene(**tables: Any) -> tuple[RunState, SkinLayout]:
    deployed = deployment(**tables)
    atlas = build_skin_layout(deployed)
    return RunState(deployed, atlas), atlas


def told(channel: str, message: Message, t_ns: int, *fields: str) -> ReceivedMessage:
    return ReceivedMessage(channel, fields, message, t_ns)


def event(
    name: str,
    cell: int,
    value: float,
    *,
    level: int = 2,
    t_ms: int = 4,
    seq: int = 0,
    modality: Modality = Modality.FORCE,
    channel: int = 0,
) -> ReceivedMessage:
    """A cell crossed a level; it took half a millisecond to tell."""
    message = Events(
        patch=name,
        gateway=0,
        cell=[cell],
        t_sampled_ns=[t_ms * MS],
        t_delivered_ns=[t_ms * MS + MS // 2],
        seq=[seq],
        modality=[int(modality)],
        channel=[channel],
        kind=[int(EventKind.LEVEL_CROSSING)],
        level=[level],
        value=[value],
    )
    return told("events", message, t_ms * MS, name, str(cell))


def stream(name: str, values: np.ndarray[Any, Any], t_ms: int = 4, first_seq: int = 0) -> ReceivedMessage:
    """All cells of a patch send full readings (cells, 8)."""
    rows = np.zeros(len(values), dtype=STREAM_ROW)
    rows["cell"] = np.arange(len(values))
    rows["values"] = values
    rows["t_sampled_ns"], rows["t_delivered_ns"] = t_ms * MS, t_ms * MS + MS
    rows["seq"] = first_seq + np.arange(len(values))
    message = Stream(
        patch=name, t_ns=t_ms * MS, watermark_ns=(t_ms + 4) * MS, n_events=len(values), rows=rows.tobytes()
    )
    return told("stream", message, t_ms * MS, name)


def topology(
    atlas: SkinLayout, name: str, *dead: int, cut: tuple[int, ...] = (), version: int = 1
) -> ReceivedMessage:
    """A patch found itself as it was built, but for dead cells, and for wires that are cut, by number."""
    start = atlas.first_taxel[name]
    placed = next(p for p in atlas.patches if p.name == name)
    n = placed.n_cells
    neighbours = [[-1] * 4 for _ in range(n)]
    for wire, (a, port_a, b, port_b) in enumerate(atlas.wires.tolist()):
        inside = start <= a < start + n and start <= b < start + n
        if inside and wire not in cut and a - start not in dead and b - start not in dead:
            neighbours[a - start][port_a], neighbours[b - start][port_b] = b - start, a - start
    gate, port = (int(x) for x in placed.interfaces[0])
    parent, master, depth = [-1] * n, [-1] * n, [0] * n
    master[gate], waiting, seen = port, [gate], {gate}
    while waiting:
        cell = waiting.pop(0)
        for other in neighbours[cell]:
            if other >= 0 and other not in seen:
                seen.add(other)
                waiting.append(other)
                parent[other], depth[other] = cell, depth[cell] + 1
                master[other] = neighbours[other].index(cell)
    ids = [0 if cell in dead or cell not in seen else cell + 1 for cell in range(n)]
    message = Topology(
        patch=name,
        version=version,
        t_ns=MS,
        network_id=ids,
        gateway=[0] * n,
        master_port=master,
        parent=parent,
        depth=depth,
        neighbours=neighbours,
    )
    return told("topology", message, MS, name)


def joints(t_ms: int, *angles: float) -> ReceivedMessage:
    message = Joints(t_ns=t_ms * MS, watermark_ns=(t_ms + 5) * MS, position_rad=list(angles))
    return told("joints", message, t_ms * MS)


def state(t_ms: int, stage: str, text: str = "") -> ReceivedMessage:
    message = ControllerState(t_ns=t_ms * MS, stage=stage, progress=0.5, text=text)
    return told("state", message, t_ms * MS)
