"""Warm-up of compiled functions by one tick, before other processes wait for the controller."""

import numpy as np

from controller.cell_input import CellInput
from controller.controller import Controller
from skinnet.deployment import Deployment
from skinnet.protocol.messages import STREAM_ROW, Events, Stream

__all__ = ["warm_up"]


def warm_up(deployment: Deployment) -> None:
    """Call the compiled functions once: loading their code takes half a second."""
    skin = CellInput({"none": 1})
    one = [0]
    events = Events(
        patch="none", gateway=0, cell=one, t_sampled_ns=one, t_delivered_ns=one, seq=one,
        modality=one, channel=one, kind=one, level=one, value=[0.0],
    )  # fmt: skip
    skin.add_events("none", events)
    rows = np.zeros(1, dtype=STREAM_ROW).tobytes()
    skin.add_stream("none", Stream(patch="none", t_ns=0, watermark_ns=0, n_events=0, rows=rows))
    still = np.zeros(len(deployment.body.joints))
    Controller(deployment.controller, skin, 1).tick(1, still, 1, 1, ready=False)
