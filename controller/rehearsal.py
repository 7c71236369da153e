"""A rehearsal of a tick, so that everything is compiled before others wait for it."""

import numpy as np

from controller.brain import Brain
from controller.skin_input import SkinInput
from skinnet.deployment import Deployment
from skinnet.messages import STREAM_ROW, Events, Stream

__all__ = ["rehearse"]


def rehearse(deployment: Deployment) -> None:
    """Calls once what is compiled: loading the machine code takes half a second."""
    skin = SkinInput({"none": 1})
    one = [0]
    events = Events(
        patch="none", gateway=0, cell=one, t_sampled_ns=one, t_delivered_ns=one, seq=one,
        modality=one, channel=one, kind=one, level=one, value=[0.0],
    )  # fmt: skip
    skin.add_events("none", events)
    rows = np.zeros(1, dtype=STREAM_ROW).tobytes()
    skin.add_stream("none", Stream(patch="none", t_ns=0, covered_ns=0, events=0, rows=rows))
    still = np.zeros(len(deployment.body.joints))
    Brain(deployment.controller, skin, 1).tick(1, still, 1, 1, ready=False)
