"""A controller process on wires of its own, with a small robot's skin and body played by hand."""

from typing import Any

import numpy as np
from small_robot import small

from controller.cell_input import CellInput
from controller.controller import Controller, TickOutput
from controller.process import ControllerProcess
from controller.stages.core import StageCore
from skinnet.deployment import Deployment
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import (
    Command,
    Config,
    EventKind,
    Events,
    Joints,
    Message,
    Modality,
    PeriodEnd,
    Topology,
    decode,
    encode,
)
from skinnet.runtime.process_result import ProcessResult

TICK_NS = 5_000_000


SIZES = {"arm": 3, "hand": 2}


S = sum(SIZES.values())


STAGES: dict[str, Any] = {
    "home": {"kind": "posture"},
    "bow": {"kind": "posture", "pose": "bow"},
    "structure": {"kind": "structure"},
    "map": {"kind": "map"},
    "guide": {"kind": "guide", "duration_s": 2.0, "force_gain": 1.0, "force_threshold": 0.05},
    "listen": {"kind": "passive", "duration_s": 0.5},
}


FAST = {
    "structure": {"settle_s": 0.0, "averaging_s": 0.01},
    "map": {"settle_s": 0.0, "periods": 1, "frequency_hz": 10.0},
    "poses_rad": {"bow": (0.3, -0.2)},
    "stages": STAGES,
}


HOME_RAD = np.array([0.1, 0.2])


WEIGHTS = np.zeros((S, 2))
WEIGHTS[:, 0] = 1.0


def events(patch: str, *rows: tuple[int, int, float], t_ns: int = 0, seq: int = 0, **columns: Any) -> Events:
    """Level events of force cells: (cell, level, value), sampled at `t_ns` and delivered 1 µs later."""
    n = len(rows)
    message: dict[str, Any] = {
        "cell": [row[0] for row in rows],
        "t_sampled_ns": [t_ns] * n,
        "t_delivered_ns": [t_ns + 1000] * n,
        "seq": list(range(seq, seq + n)),
        "modality": [int(Modality.FORCE)] * n,
        "channel": [0] * n,
        "kind": [int(EventKind.LEVEL_CROSSING)] * n,
        "level": [row[1] for row in rows],
        "value": [row[2] for row in rows],
    }
    return Events(patch=patch, gateway=0, **message | columns)


class Robot:
    """A brain whose joints move exactly as it says."""

    def __init__(self, *program: str, **tables: Any) -> None:
        control = small(controller=FAST | {"program": program} | tables).controller
        self.skin = CellInput(SIZES)
        self.brain = Controller(control, self.skin, S)
        self.t_ns = 0
        self.position_rad = HOME_RAD.copy()

    def know(self) -> "Robot":
        """Gives it a map, so that it can react."""
        self.brain.self_model.sensory_motor_map.add(HOME_RAD, WEIGHTS)
        return self

    def feel(self, patch: str, *rows: tuple[int, int, float], **more: Any) -> None:
        self.skin.add_events(patch, events(patch, *rows, t_ns=self.t_ns - 2000, **more))

    def tick(self, *, ready: bool = True, skin_lag_ns: int = 0) -> TickOutput:
        t_ns = self.t_ns
        tick, _, _ = self.brain.tick(t_ns, self.position_rad, t_ns, t_ns - skin_lag_ns, ready=ready)
        self.position_rad = self.position_rad + tick.velocity_rad_s * TICK_NS * 1e-9
        self.t_ns += TICK_NS
        return tick

    def live(self, ticks: int = 4000) -> list[TickOutput]:
        """Ticks until the program is through."""
        lived = []
        while not self.brain.done:
            lived.append(self.tick())
            assert len(lived) < ticks
        return lived


KEYS = Keys("bot")


class Wired:
    """A controller node whose skin is at rest; patches that are not named have lost their host."""

    def __init__(
        self,
        *program: str,
        here: tuple[str, ...] = ("arm", "hand"),
        lost: bool = True,
        formed_ns: int = 0,
        **more: Any,
    ) -> None:
        control = FAST | {"program": program} | more
        deployment: Deployment = small(
            controller=control, cell_processes="per_patch", run={"tolerated_losses": ("cells",)}
        )
        self.core = StageCore(deployment.controller, SIZES)
        self.node = ControllerProcess(deployment, "controller", self.core)
        self.sent: list[tuple[str, bytes]] = []
        self.position_rad = HOME_RAD
        self.t_ns = 0
        self.here = here
        for patch in here:
            n = SIZES[patch]
            found = Topology(
                patch=patch,
                version=1,
                t_ns=formed_ns,
                network_id=[1] * n,
                gateway=[0] * n,
                master_port=[0] * n,
                parent=[-1] * n,
                depth=[1] * n,
                neighbours=[[-1] * 4] * n,
            )
            self.accept("topology", found, patch)
        for name, upstream in self.node.upstreams.items():
            if lost and name not in (*here, "body"):
                upstream.lost = True
                self.node.on_upstream_lost(upstream)

    def accept(self, channel: str, message: Message, *fields: str) -> None:
        self.node.accept(channel, fields, encode(message))

    def step(self, measured_ns: int | None = None) -> Command:
        """One tick, on joint positions measured at `measured_ns`, or now."""
        measured_ns = self.t_ns if measured_ns is None else measured_ns
        self.accept(
            "joints",
            Joints(t_ns=measured_ns, watermark_ns=self.t_ns, position_rad=self.position_rad.tolist()),
        )
        for patch in self.here:
            frame = PeriodEnd(
                patch=patch, t_ns=self.t_ns, watermark_ns=self.t_ns, n_events=int(self.t_ns == 0)
            )
            self.accept("period_end", frame, patch)
        needs = self.node.needs()
        assert needs is not None
        ups = self.node.upstreams
        assert all(ups[name].lost or ups[name].watermark_ns >= t_ns for name, t_ns in needs.items())
        self.sent.clear()
        self.node.step(lambda key, payload: self.sent.append((key, payload)))
        self.t_ns += TICK_NS
        command = decode(self.sent[-1][1], Command)
        self.position_rad = self.position_rad + 0.005 * np.array(command.velocity_rad_s)
        return command

    @property
    def configs(self) -> list[Config]:
        return [decode(payload, Config) for key, payload in self.sent if KEYS.parse(key)[0].name == "config"]

    @property
    def result(self) -> ProcessResult:
        return self.node.result()
