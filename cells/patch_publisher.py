"""Publisher of one patch: events, stream and period ends, in order of delivery."""

import hashlib
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import Events, PeriodEnd, Stream, Topology, encode
from skinnet.runtime.loop import Put

__all__ = ["PatchPublisher"]


class PatchPublisher:
    """Publisher of the data that the gateways of a patch received, and of its period ends.

    All messages enter the hash of the patch's log, so that two runs can be compared bit by bit.
    """

    def __init__(self, patch: str, keys: Keys, bundle: bool) -> None:
        self.patch = patch
        self.topology_version = 0
        self._bundle = bundle
        self._keys = keys
        self._stream_key = keys.of("stream", patch)
        self._period_end_key = keys.of("period_end", patch)
        self._log_hash = hashlib.sha256()
        self._seq = 0
        self._n_published = 0

    @property
    def log_sha256(self) -> str:
        """SHA-256 of all messages published so far, hexadecimal."""
        return self._log_hash.hexdigest()

    def publish_topology(self, put: Put, topology: Topology) -> tuple[str, bytes]:
        """Publish a topology as part of the period that ends next; return its key and payload."""
        self.topology_version = topology.version
        self._n_published += 1
        message = self._keys.of("topology", self.patch), encode(topology)
        self._publish(put, *message)
        return message

    def publish_events(
        self, put: Put, rows: NDArray[Any], gateway: NDArray[np.int64], t_ns: NDArray[np.int64]
    ) -> None:
        """Publish events in order of delivery, one message per cell, or per gateway if bundled.

        Args:
            put: Publishing function.
            rows: (n,) `PAYLOAD` with cell indices within this patch.
            gateway: (n,) gateway port at which each event arrived.
            t_ns: (n,) delivery times [ns].
        """
        if not len(rows):
            return
        self._n_published += len(rows)
        seq = self._next_seq(len(rows))
        split, key_of = (gateway, self._bundle_key) if self._bundle else (rows["cell"], self._cell_key)
        order = np.argsort(split, kind="stable")
        split, rows = split[order], rows[order]
        ports = gateway[order].tolist()
        values = split.tolist()
        # convert to lists once for all messages: most have one or two events
        columns = {
            "cell": rows["cell"].tolist(),
            "t_sampled_ns": rows["t_sampled_ns"].tolist(),
            "t_delivered_ns": t_ns[order].tolist(),
            "seq": seq[order].tolist(),
            "modality": rows["modality"].tolist(),
            "channel": rows["channel"].tolist(),
            "kind": rows["event_kind"].tolist(),
            "level": rows["level"].tolist(),
            "value": rows["value"].astype(np.float64).tolist(),
        }
        ends = [0, *(np.flatnonzero(split[1:] != split[:-1]) + 1).tolist(), len(split)]
        for a, b in pairwise(ends):
            some = {name: column[a:b] for name, column in columns.items()}
            message = Events(patch=self.patch, gateway=ports[a], **some)
            self._publish(put, key_of(values[a]), encode(message))

    def end_period(
        self,
        put: Put,
        t_ns: int,
        watermark_ns: int,
        stream: NDArray[Any] | None,
    ) -> None:
        """Publish the period end, alone or with the stream of the period.

        Args:
            put: Publishing function.
            t_ns: Begin of the period [ns].
            watermark_ns: Watermark: end of the period [ns].
            stream: Full readings of the period in order of delivery, `STREAM_ROW` with cell indices within
                this patch; sequence numbers are written here. None if no cell streams.
        """
        events, self._n_published = self._n_published, 0
        if stream is None:
            frame = PeriodEnd(patch=self.patch, t_ns=t_ns, watermark_ns=watermark_ns, n_events=events)
            self._publish(put, self._period_end_key, encode(frame))
            return
        stream["seq"] = self._next_seq(len(stream))
        message = Stream(
            patch=self.patch, t_ns=t_ns, watermark_ns=watermark_ns, n_events=events, rows=stream.tobytes()
        )
        self._publish(put, self._stream_key, encode(message))

    def _bundle_key(self, _gateway: int) -> str:
        return self._keys.of("bundle", self.patch)

    def _cell_key(self, cell: int) -> str:
        return self._keys.of("events", self.patch, cell)

    def _next_seq(self, n: int) -> NDArray[np.int64]:
        self._seq += n
        return np.arange(self._seq - n, self._seq, dtype=np.int64)

    def _publish(self, put: Put, key: str, payload: bytes) -> None:
        self._log_hash.update(payload)
        put(key, payload)
