"""Elastic foundation of a whole skin, coupled to one MuJoCo simulation."""

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.model import PAYLOAD
from skinnet.body.scene import Motion, Scene
from skinnet.body.surface import Surface
from skinnet.body.things import OBJECT
from skinnet.body.winkler import Foam, Pressed, Scratch, press
from skinnet.body.yielding import Yielding, share_of, yielding_of
from skinnet.deployment.schema import Deployment, FoamSpec
from skinnet.deployment.things import NO_OBJECT, THINGS

__all__ = ["Foundation", "elastic_bodies", "foam_of"]

Floats = NDArray[np.float64]


def foam_of(spec: FoamSpec) -> Foam:
    """Build the foam of a deployment."""
    return Foam(spec.thickness_m, spec.stiffness_pa_per_m, spec.damping_pa_s_per_m, spec.friction)


def elastic_bodies(mj: mujoco.MjModel, deployment: Deployment) -> dict[int, Yielding]:
    """Compliance of the elastic bodies (payload, object), by body id."""
    foam, payload = deployment.body.foam, deployment.payload
    elastic = {}
    if payload is not None:
        elastic[PAYLOAD] = Yielding(share_of(payload.sheet_stiffness_pa_per_m, foam))
    if deployment.stand is not None and deployment.object != NO_OBJECT:
        elastic[OBJECT] = yielding_of(THINGS[deployment.object].stiffness_pa_per_m, foam)
    return {int(mj.body(name).id): yielding for name, yielding in elastic.items()}


@dataclass
class Foundation:
    """Elastic foundation (Winkler) of all cells; the contact law is in `winkler`.

    Attributes:
        surface: The cells.
        scene: The solids that skin can contact.
        foam: Material of the foam.
        motion: MuJoCo's poses and velocities, read in place.
        temperature_c: (nbody,) temperatures of the bodies [°C].
        wrench: (nbody, 6) MuJoCo's `xfrc_applied`; forces are added in place.
        pressed: Contact state of the last call of `press`.
        touching: Number of cells in contact.
    """

    surface: Surface
    scene: Scene
    foam: Foam
    motion: Motion
    temperature_c: Floats
    wrench: Floats
    pressed: Pressed = field(init=False)
    touching: int = 0
    _scratch: Scratch = field(init=False)

    def __post_init__(self) -> None:
        n, n_samples, n_bodies = len(self.surface.body), len(self.surface.sample_m), len(self.temperature_c)
        self.pressed = Pressed(
            force_n=np.zeros((n, self.surface.n_elements)),
            touch_c=np.full(n, np.nan),
            on_body_n=np.zeros(n_bodies),
            by_patch_n=np.zeros((len(self.surface.patch_body), n_bodies)),
            peak_n=np.zeros(1),
            slid_n_m=np.zeros(n_bodies),
            shear_m=np.zeros((n, n_samples, 2)),
            loaded=np.zeros(n, dtype=np.bool_),
        )
        solids = len(self.scene.geom)
        self._scratch = Scratch(
            near=np.zeros(solids, dtype=np.int64),
            close=np.zeros(solids, dtype=np.int64),
            hit=np.zeros(n_samples, dtype=np.int64),
            nearest_m=np.zeros(n_samples),
        )

    def press(self, step_s: float) -> None:
        """Compute contact forces at the present poses and add them to `wrench`; step `step_s` [s]."""
        if not len(self.surface.body):  # the call alone, with all its arrays, costs 7 µs
            return
        self.touching = press(
            self.surface,
            self.scene,
            self.motion,
            self.foam,
            self.temperature_c,
            step_s,
            self.pressed,
            self.wrench,
            self._scratch,
        )
