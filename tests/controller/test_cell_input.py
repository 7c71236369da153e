"""The controller's ear puts what the gateways deliver into the one order, whatever order it came in."""

import random
from typing import Any, NamedTuple

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cell_input import CellInput
from skinnet.protocol.messages import N_FORCE_CHANNELS, STREAM_ROW, Events, Modality, Stream

SIZES = {"arm": 3, "hand": 2, "leg": 1}
FIRST = {"arm": 0, "hand": 3, "leg": 5}
RANK = {patch: i for i, patch in enumerate(SIZES)}
WIDTH = {
    Modality.FORCE: N_FORCE_CHANNELS,
    Modality.PROXIMITY: 1,
    Modality.ACCELERATION: 3,
    Modality.TEMPERATURE: 1,
}


class Said(NamedTuple):
    """One event or full reading as plain numbers."""

    t_delivered_ns: int
    patch: str
    gateway: int
    seq: int
    cell: int
    t_sampled_ns: int
    modality: int
    channel: int
    value: float

    @property
    def place(self) -> tuple[int, int, int, int]:
        return self.t_delivered_ns, RANK[self.patch], self.gateway, self.seq


@st.composite
def speeches(draw: st.DrawFn) -> list[list[Said]]:
    """Messages, each of one patch and gateway; times are few, so that many things happen at once."""
    messages = []
    next_seq = dict.fromkeys(SIZES, 0)
    for _ in range(draw(st.integers(0, 12))):
        patch = draw(st.sampled_from(sorted(SIZES)))
        gateway = draw(st.integers(0, 2))
        rows = []
        for _ in range(draw(st.integers(0, 4))):
            modality = draw(st.sampled_from(sorted(WIDTH)))
            rows.append(
                Said(
                    t_delivered_ns=draw(st.integers(0, 6)),
                    patch=patch,
                    gateway=gateway,
                    seq=next_seq[patch],
                    cell=draw(st.integers(0, SIZES[patch] - 1)),
                    t_sampled_ns=draw(st.integers(-5, 5)),
                    modality=int(modality),
                    channel=draw(st.integers(0, WIDTH[modality] - 1)),
                    value=draw(st.floats(-1.0, 1.0, width=32)),
                )
            )
            next_seq[patch] += 1
        messages.append(rows)
    return [rows for rows in messages if rows]


def as_events(rows: list[Said]) -> Events:
    columns: dict[str, list[Any]] = {
        name: [getattr(row, name) for row in rows]
        for name in ("cell", "t_sampled_ns", "t_delivered_ns", "seq", "modality", "channel", "value")
    }
    return Events(
        patch=rows[0].patch,
        gateway=rows[0].gateway,
        kind=[1] * len(rows),
        level=list(range(len(rows))),
        **columns,
    )


def as_stream(rows: list[Said]) -> Stream:
    table = np.zeros(len(rows), dtype=STREAM_ROW)
    for i, row in enumerate(rows):
        table[i] = (row.t_sampled_ns, row.t_delivered_ns, row.seq, [row.value] * 8, row.cell, row.gateway)
    return Stream(patch=rows[0].patch, t_ns=0, watermark_ns=0, n_events=0, rows=table.tobytes())


@settings(deadline=None, max_examples=150)
@given(events=speeches(), streams=speeches(), seed=st.integers(0, 99), ticks=st.sets(st.integers(0, 8)))
def test_rows_come_out_once_at_their_time_and_in_their_order(
    events: list[list[Said]], streams: list[list[Said]], seed: int, ticks: set[int]
) -> None:
    """Against a sorted list of everything; messages arrive at any time before they are due, in any order."""
    rng = random.Random(seed)
    skin = CellInput(SIZES)
    steps = [*sorted(ticks), 99]
    arrivals: dict[int, list[tuple[bool, list[Said]]]] = {t_ns: [] for t_ns in steps}
    for is_event, messages in ((True, events), (False, streams)):
        for rows in messages:
            # no later than the first tick that hands out a row of it
            last = next(t_ns for t_ns in steps if t_ns > min(row.t_delivered_ns for row in rows))
            arrivals[rng.choice([t_ns for t_ns in steps if t_ns <= last])].append((is_event, rows))
    taken: tuple[list[Any], list[Any]] = ([], [])
    for t_ns in steps:
        rng.shuffle(arrivals[t_ns])
        for is_event, rows in arrivals[t_ns]:
            patch = rows[0].patch
            count = (
                skin.add_events(patch, as_events(rows))
                if is_event
                else skin.add_stream(patch, as_stream(rows))
            )
            assert count == len(rows)
        for kind, (cell, rows_out) in enumerate(skin.take_delivered(t_ns)):
            assert all(t < t_ns for t in rows_out["t_delivered_ns"].tolist())
            taken[kind].extend(zip(cell.tolist(), rows_out.copy(), strict=True))
    for kind, messages in enumerate((events, streams)):
        expected = sorted((row for rows in messages for row in rows), key=lambda row: row.place)
        assert len(taken[kind]) == len(expected)
        for (cell, out), row in zip(taken[kind], expected, strict=True):
            assert cell == FIRST[row.patch] + row.cell
            for name in ("t_delivered_ns", "t_sampled_ns", "seq", "cell", "gateway"):
                assert out[name] == getattr(row, name)
            if kind == 0:
                assert (out["modality"], out["channel"], out["kind"]) == (row.modality, row.channel, 1)
                assert out["value"] == row.value
            else:
                assert out["values"].tolist() == [row.value] * 8


@settings(deadline=None, max_examples=50)
@given(events=speeches(), lost=st.integers(0, 11))
def test_what_is_missing_is_counted_by_sequence_numbers(events: list[list[Said]], lost: int) -> None:
    """A loss shows as soon as something of the same patch comes after it."""
    skin = CellInput(SIZES)
    left = [rows for i, rows in enumerate(events) if i != lost]
    for rows in left:
        skin.add_events(rows[0].patch, as_events(rows))
    skin.take_delivered(99)
    seqs = {patch: [row.seq for rows in left for row in rows if row.patch == patch] for patch in SIZES}
    assert skin.received == sum(map(len, seqs.values()))
    assert skin.missing == sum(max(some) + 1 - len(some) for some in seqs.values() if some)
