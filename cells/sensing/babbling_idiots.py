"""Spurious events of cells that fail as babbling idiots (Kopetz)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sensing.encoding import CHANNEL_OF, MODALITY_OF
from cells.sensing.fault_intervals import FaultIntervals
from cells.sensing.transducers import ChannelScales
from skinnet import pinned_math
from skinnet.compilation import compiled
from skinnet.deployment.experiment.faults import BabblingIdiot
from skinnet.network.faults.fault_schedule import FaultSpan
from skinnet.protocol.messages import EventKind
from skinnet.random_streams import StreamName, uniform

__all__ = ["BabblingIdiots", "SpuriousEvents"]

_MODALITY, _CHANNEL = np.array(MODALITY_OF, dtype=np.uint8), np.array(CHANNEL_OF, dtype=np.uint8)


class SpuriousEvents(NamedTuple):
    """Spurious events, ordered by time, then by cell: columns as in `EncoderOutput`, and `begin_ns`.

    `cell` (index within the process) and `begin_ns` are int64; `modality`, `channel`, `kind` and `level`
    uint8; `value` float32. All have equal length.
    """

    cell: NDArray[np.int64]
    t_ns: NDArray[np.int64]
    modality: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    level: NDArray[np.uint8]
    value: NDArray[np.float32]


class _EventSources(NamedTuple):
    """Event sources, one per babbling-idiot fault: cell, end, random stream, mean interval, state.

    `last_sent_ns` and `n_sent` are updated: time [ns] and number of the events so far.
    """

    cell: NDArray[np.int64]
    end_ns: NDArray[np.int64]
    keys: NDArray[np.uint64]
    mean_interval_ns: NDArray[np.float64]
    last_sent_ns: NDArray[np.int64]
    n_sent: NDArray[np.int64]


class BabblingIdiots:
    """Babbling-idiot cells of a process: sources of spurious events.

    Each sends well-formed events as a Poisson process (a failed cell keeps no clock): a uniformly drawn
    channel and a uniformly drawn value within its range, of the event kind that carries values. Only a
    plausibility check can tell them from measured events.
    """

    def __init__(
        self, spans: Sequence[FaultSpan], first_cell: Mapping[str, int], scales: ChannelScales, seed: int
    ) -> None:
        found = [(span, span.rule) for span in spans if isinstance(span.rule, BabblingIdiot)]
        self._times = FaultIntervals([span for span, _ in found], first_cell)
        self._scales = scales
        self._sources = _EventSources(
            cell=self._times.cell,
            end_ns=self._times.end_ns,
            keys=np.array([span.stream_key(seed, StreamName.BABBLING) for span, _ in found], dtype=np.uint64),
            mean_interval_ns=np.array([1e9 / rule.rate_hz for _, rule in found], dtype=np.float64),
            last_sent_ns=self._times.begin_ns.copy(),
            n_sent=np.zeros(len(found), dtype=np.int64),
        )

    def generate(self, start_ns: int, end_ns: int) -> SpuriousEvents:
        """Generate the spurious events in [start_ns, end_ns), the same however time is split into calls."""
        active = self._times.overlapping(start_ns, end_ns)
        if not active.size:
            return _NO_EVENTS
        cell, t_ns, column, value = _generate(active, self._sources, self._scales, start_ns, end_ns)
        order = np.lexsort((cell, t_ns))
        column = column[order]
        return SpuriousEvents(
            cell=cell[order],
            t_ns=t_ns[order],
            modality=_MODALITY[column],
            channel=_CHANNEL[column],
            kind=np.full(len(order), EventKind.SEND_ON_DELTA, dtype=np.uint8),
            level=np.zeros(len(order), dtype=np.uint8),
            value=value[order],
        )


_NO_EVENTS = SpuriousEvents._make(
    np.empty(0, dtype) for dtype in (np.int64, np.int64, np.uint8, np.uint8, np.uint8, np.uint8, np.float32)
)


@compiled
def _generate(
    active: NDArray[np.int64],
    sources: _EventSources,
    scales: ChannelScales,
    start_ns: int,
    end_ns: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return cell, time [ns], column and value of every event; each event uses three draws of its own."""
    who, when = np.empty(16, dtype=np.int64), np.empty(16, dtype=np.int64)
    what, value = np.empty(16, dtype=np.int64), np.empty(16, dtype=np.float32)
    _, lsb, lowest, highest = scales
    keys, last_sent_ns, n_sent = sources.keys, sources.last_sent_ns, sources.n_sent
    n = 0
    for i in active:
        while True:
            draw = np.uint64(3 * n_sent[i])
            wait_ns = int(-pinned_math.log(uniform(keys[i], draw)) * sources.mean_interval_ns[i] + 0.5)
            t_ns = last_sent_ns[i] + max(wait_ns, 1)
            if t_ns >= min(end_ns, sources.end_ns[i]):
                break
            last_sent_ns[i] = t_ns
            n_sent[i] += 1
            if t_ns < start_ns:
                continue
            if n == who.size:
                who, when = np.concatenate((who, who)), np.concatenate((when, when))
                what, value = np.concatenate((what, what)), np.concatenate((value, value))
            which = int(uniform(keys[i], draw + np.uint64(1)) * lsb.size)
            span = highest[which] - lowest[which] + 1.0
            steps = lowest[which] + np.floor(uniform(keys[i], draw + np.uint64(2)) * span)
            who[n], when[n], what[n], value[n] = sources.cell[i], t_ns, which, lsb[which] * steps
            n += 1
    return who[:n], when[:n], what[:n], value[:n]
