"""A cell process on wires of its own."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cells.cell_process import CellProcess
from skinnet.deployment import Deployment
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import (
    Config,
    Message,
    Stimulus,
    decode,
    encode,
    pack,
)
from skinnet.random_streams import generator

MS = 1_000_000


Floats = NDArray[np.float64]


class Host:
    """A host node with its wires in hand: the body's stimulus goes in, messages come out.

    Touches come and go, of every cell at times of its own, from `quiet_ms` on.
    """

    def __init__(self, deployment: Deployment, name: str = "cells0", quiet_ms: int = 0) -> None:
        self.node = CellProcess(deployment, name)
        self.keys = Keys(deployment.robot)
        self.period_ns = deployment.cells.period_ns
        self.quiet_ns = quiet_ms * MS
        self.patches = [p for p in deployment.patches if p.name in deployment.patches_by_process()[name]]
        self.patches.sort(key=lambda p: deployment.patches_by_process()[name].index(p.name))
        self.sent: list[tuple[str, bytes]] = []
        self.t_ns = 0
        self.n_announced = 0
        self.feel(0)
        self.node.start(self.put)

    def put(self, key: str, payload: bytes) -> None:
        self.sent.append((key, payload))

    def _felt(self, name: str, n: int, t_ns: int) -> Floats:
        rest = np.array([0, 0, 0, np.inf, 0, 0, 9.81, 23.0])
        felt = np.tile(rest, (n, 1))
        if t_ns >= self.quiet_ns:
            random = generator(t_ns, name)
            felt[:, :3] = random.uniform(0.0, 5.0, (n, 3)) * (random.random((n, 1)) < 0.3)
            felt[:, 3] = random.uniform(0.0, 0.06, n)
            felt[:, 4:7] += random.normal(0.0, 1.0, (n, 3))
        return felt

    def feel(self, t_ns: int, end_ns: int | None = None) -> None:
        values = np.vstack([self._felt(p.name, p.n_cells, t_ns) for p in self.patches])
        frame = Stimulus(
            process=self.node.name,
            t_ns=t_ns,
            watermark_ns=t_ns,
            values=pack(values, "<f4"),
            n_configs=self.n_announced,
            end_ns=end_ns,
        )
        self.n_announced = 0
        self.node.accept("stimulus", (self.node.name,), encode(frame))

    def send_config(self, config: Config) -> None:
        """A configuration by the controller, or by a stranger if it has no time."""
        self.node.accept("config", (config.patch, str(config.cell)), encode(config))
        self.n_announced += bool(config.t_ns)

    def run(self, n_periods: int) -> "Host":
        for _ in range(n_periods):
            self.t_ns += self.period_ns
            self.feel(self.t_ns)
            assert self.ready
            self.node.step(self.put)
        return self

    @property
    def ready(self) -> bool:
        needs = self.node.needs()
        assert needs is not None
        return all(self.node.upstreams[name].watermark_ns >= t_ns for name, t_ns in needs.items())

    def published(self, *kinds: type[Message]) -> list[Any]:
        """What was said, of some kinds, in order."""
        messages = [(self.keys.parse(key)[0].message, payload) for key, payload in self.sent]
        return [decode(payload, kind) for kind, payload in messages if kind in kinds]

    @property
    def facts(self) -> dict[str, Any]:
        return self.node.result().facts
