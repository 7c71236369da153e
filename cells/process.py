"""A cell host as a process: it rehearses with two cells, so all is compiled before others wait for it."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from cells.boards_host import BoardsNode
from cells.host import HostNode
from skinnet.deployment import Deployment
from skinnet.deployment.schema import BOARDS, EncodingSpec, InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.messages import STIMULUS_NAMES, Stimulus, encode

__all__ = ["build", "rehearse"]

_PERIODS = 40
"""More than two cells need to form their network and to stream."""
_PATCH = PatchSpec(
    name="rehearsal",
    body="",
    lattice=LatticeSpec(columns=2, rows=1, origin_m=(0, 0, 0), normal=(0, 0, 1), up=(0, 1, 0)),
    interfaces=(InterfaceSpec(cell=0, port=2),),
)


def build(deployment: Deployment, name: str, base: Path, out: Path | None) -> HostNode | BoardsNode:
    """The host `name` of `deployment`: of cells, or of the boards of tactile sheets."""
    if name == BOARDS:
        return BoardsNode(deployment, name)
    rehearse(deployment)
    return HostNode(deployment, name)


def rehearse(deployment: Deployment) -> int:
    """Runs a host of two cells that stream; returns how many of their readings arrived."""
    stage = replace(
        deployment,
        hosts=1,
        patches=(_PATCH,),
        bridges=(),
        surfaces=(),
        sheets=(),
        faults=(),
        power=None,
        cells=replace(deployment.cells, encoding=EncodingSpec(kind="clock")),
    )
    node = HostNode(stage, "host0")
    felt = np.zeros((_PATCH.n_cells, len(STIMULUS_NAMES)), dtype="<f4").tobytes()
    node.start(_nowhere)
    for frame in range(_PERIODS + 1):
        t_ns = frame * stage.body.stimulus_ns
        stimulus = Stimulus(host="host0", t_ns=t_ns, covered_ns=t_ns, values=felt)
        node.accept("stimulus", ("host0",), encode(stimulus))
        if frame:
            node.step(_nowhere)
    delivered: int = node.result().facts["network"]["reading"]["delivered"]
    return delivered


def _nowhere(_key: str, _payload: bytes) -> None:
    """Nobody hears a rehearsal."""
