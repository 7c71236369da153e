"""Construction of a cell or board process, with a warm-up that compiles all Numba kernels beforehand."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from cells.cell_process import CellProcess
from cells.sheets.board_process import BoardProcess
from skinnet.deployment import Deployment
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.deployment.skin.cells import EncodingSpec
from skinnet.deployment.skin.patches import InterfaceSpec, LatticeSpec, PatchSpec
from skinnet.protocol.messages import STIMULUS_NAMES, Stimulus, encode
from skinnet.protocol.sheet_messages import Pressures
from skinnet.skin.tactile_sheets import place_sheets

__all__ = ["build", "warm_up"]

_WARM_UP_PERIODS = 40
"""Warm-up periods: more than two cells need to form their network and to stream."""
_WARM_UP_PATCH = PatchSpec(
    name="rehearsal",
    body="",
    lattice=LatticeSpec(columns=2, rows=1, origin_m=(0, 0, 0), normal=(0, 0, 1), up=(0, 1, 0)),
    interfaces=(InterfaceSpec(cell=0, port=2),),
)


def build(
    deployment: Deployment, name: str, base: Path, out: Path | None, *, recorded: bool = False
) -> CellProcess | BoardProcess:
    """Build the process `name` of `deployment`: of cells, or of the boards of tactile sheets."""
    if name == BOARD_PROCESS:
        _warm_up_boards(deployment)
        return BoardProcess(deployment, name, recorded=recorded)
    warm_up(deployment)
    return CellProcess(deployment, name, recorded=recorded)


def _warm_up_boards(deployment: Deployment) -> None:
    """Warm up with one period of all boards, without pressure."""
    node = BoardProcess(deployment, BOARD_PROCESS)
    felt = np.zeros(sum(sheet.n_elements for sheet in place_sheets(deployment.surfaces, deployment.sheets)))
    for t_ns in (0, deployment.boards.period_ns):
        pressures = Pressures(t_ns=t_ns, watermark_ns=t_ns, values=felt.astype("<f4").tobytes())
        node.accept("pressures", (), encode(pressures))
    node.step(_discard)
    node.result()


def warm_up(deployment: Deployment) -> int:
    """Warm up with two cells that stream; return the number of readings delivered."""
    stage = replace(
        deployment,
        cell_processes=1,
        patches=(_WARM_UP_PATCH,),
        bridges=(),
        surfaces=(),
        sheets=(),
        faults=(),
        power=None,
        cells=replace(deployment.cells, encoding=EncodingSpec(kind="periodic")),
    )
    node = CellProcess(stage, "cells0")
    felt = np.zeros((_WARM_UP_PATCH.n_cells, len(STIMULUS_NAMES)), dtype="<f4").tobytes()
    node.start(_discard)
    for frame in range(_WARM_UP_PERIODS + 1):
        t_ns = frame * stage.body.stimulus_period_ns
        stimulus = Stimulus(process="cells0", t_ns=t_ns, watermark_ns=t_ns, values=felt)
        node.accept("stimulus", ("cells0",), encode(stimulus))
        if frame:
            node.step(_discard)
    delivered: int = node.result().facts["network"]["reading"]["delivered"]
    return delivered


def _discard(_key: str, _payload: bytes) -> None:
    """Discard a message of the warm-up."""
