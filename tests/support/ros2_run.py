"""Messages of a small run, as the ROS 2 bridge gets them."""

from typing import Any

import numpy as np
from locations import DEPLOYMENTS

from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import (
    STREAM_ROW,
    Events,
    Joints,
    Stream,
    Topology,
    encode,
)

ARM = DEPLOYMENTS / "two_link_arm.toml"


KEYS = Keys("arm")


def joints(t_ns: int, *position_rad: float) -> bytes:
    return encode(Joints(t_ns=t_ns, watermark_ns=t_ns + 5_000_000, position_rad=list(position_rad)))


def events(patch: str, *rows: tuple[int, int, int, int, float], seq: int = 0) -> Events:
    """Rows of (cell, modality, channel, time, value)."""
    cell, modality, channel, t_ns, value = (list(column) for column in zip(*rows, strict=True))
    n = len(rows)
    return Events(
        patch=patch,
        gateway=0,
        cell=cell,
        t_sampled_ns=t_ns,
        t_delivered_ns=t_ns,
        seq=list(range(seq, seq + n)),
        modality=modality,
        channel=channel,
        kind=[0] * n,
        level=[1] * n,
        value=value,
    )


def stream(patch: str, *rows: tuple[int, int, int, tuple[float, ...]]) -> Stream:
    """Rows of (seq, cell, time, values)."""
    table = np.zeros(len(rows), dtype=STREAM_ROW)
    for row, (seq, cell, t_ns, values) in zip(table, rows, strict=True):
        row["seq"], row["cell"], row["t_sampled_ns"], row["values"] = seq, cell, t_ns, values
    return Stream(patch=patch, t_ns=0, watermark_ns=0, n_events=0, rows=table.tobytes())


def topology(patch: str, *network_id: int) -> Topology:
    n = len(network_id)
    lists: dict[str, Any] = {name: [0] * n for name in ("gateway", "master_port", "parent", "depth")}
    return Topology(patch=patch, version=1, t_ns=0, network_id=list(network_id), neighbours=[[]] * n, **lists)
