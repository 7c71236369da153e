"""Elastic foundation of a whole skin, coupled to one MuJoCo simulation."""

from dataclasses import dataclass, field
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import added_id
from skinnet.body.contact.broad_phase import ActiveCells
from skinnet.body.contact.compliant_layer import CompliantLayer, compliant_layer, foam_fraction
from skinnet.body.contact.contact_problem import (
    RAY_START_DEPTH_M,
    ContactProblem,
    ContactState,
    Workspace,
)
from skinnet.body.contact.contact_scene import ContactScene, build_contact_scene
from skinnet.body.contact.foam import Foam
from skinnet.body.contact.link_thickness import start_depths_m
from skinnet.body.contact.loaded_points import no_loaded_points
from skinnet.body.contact.point_kinematics import Motion, motion_views
from skinnet.body.contact.skin_surface import SkinSurface
from skinnet.body.contact.winkler import compute_contact
from skinnet.body.environment.stand_model import OBJECT
from skinnet.body.model import PAYLOAD, BodyModel
from skinnet.compiled_reference import reference
from skinnet.deployment.deployment import Deployment
from skinnet.deployment.environment.objects import NO_OBJECT, OBJECTS
from skinnet.errors import ModelError

__all__ = ["Foundation"]

Floats = NDArray[np.float64]
_SPARE_POINTS = 1000
"""Loaded points beyond a pressed and a near part of all samples, where several solids share them."""


def _compliant_layers(mj: mujoco.MjModel, deployment: Deployment) -> dict[int, CompliantLayer]:
    """Compliance of the elastic bodies (payload, object), by body id."""
    foam, payload = deployment.body.foam, deployment.payload
    elastic = {}
    if payload is not None:
        elastic[PAYLOAD] = CompliantLayer(foam_fraction(payload.sheet_stiffness_pa_per_m, foam))
    if deployment.stand is not None and deployment.object != NO_OBJECT:
        elastic[OBJECT] = compliant_layer(OBJECTS[deployment.object].stiffness_pa_per_m, foam)
    return {added_id(mj, mujoco.mjtObj.mjOBJ_BODY, name): yielding for name, yielding in elastic.items()}


@dataclass
class Foundation:
    """Elastic foundation (Winkler) of all cells; the contact law is in `winkler`.

    Attributes:
        surface: The cells.
        scene: The solids that skin can contact.
        foam: Material of the foam.
        motion: MuJoCo's poses and velocities, read in place.
        temperature_c: (nbody,) temperatures of the bodies [°C].
        applied_wrench: (nbody, 6) MuJoCo's `xfrc_applied`; forces are added in place.
        contact: Contact state of the last call of `compute_contact`.
        n_in_contact: Number of cells in contact.
        problem: All of these, a `reference` for compiled code.
    """

    surface: SkinSurface
    scene: ContactScene
    foam: Foam
    motion: Motion
    temperature_c: Floats
    applied_wrench: Floats
    contact: ContactState = field(init=False)
    n_in_contact: int = 0
    problem: ContactProblem = field(init=False)

    def __post_init__(self) -> None:
        n, n_samples, n_bodies = (
            len(self.surface.body_id),
            self.surface.grid.n_samples,
            len(self.temperature_c),
        )
        self.contact = ContactState(
            force_n=np.zeros((n, self.surface.n_taxels)),
            contact_temperature_c=np.full(n, np.nan),
            body_normal_force_n=np.zeros(n_bodies),
            patch_body_force_n=np.zeros((len(self.surface.patch_body_id), n_bodies)),
            peak_force_n=np.zeros(1),
            force_weighted_slip_n_m=np.zeros(n_bodies),
            shear_m=np.zeros((n, 2, n_samples)),
            play_m=np.full((n, n_samples) if self.foam.reversal_m > 0.0 else (0, 0), -self.foam.reversal_m),
            in_contact=np.zeros(n, dtype=np.bool_),
        )
        solids, n_points = len(self.scene.geom_id), len(self.surface.grid.x_m)
        self.problem = reference(
            ContactProblem(
                self.surface,
                self.scene,
                self.motion,
                self.foam,
                self.temperature_c,
                self.contact,
                self.applied_wrench,
                no_loaded_points(2 * n * n_samples + _SPARE_POINTS),
                start_depths_m(
                    self.surface,
                    self.scene,
                    self.motion,
                    RAY_START_DEPTH_M + self.scene.largest_indentation_m,
                ),
                Workspace(
                    near=np.zeros(solids, dtype=np.int64),
                    active=ActiveCells.of(self.surface),
                    close=np.zeros(solids, dtype=np.int64),
                    hit=np.zeros(n_points, dtype=np.int64),
                    nearest_m=np.zeros(n_points),
                    height_m=np.zeros(n_points),
                    at_point=np.zeros((5, 2 * n_samples)),
                    inner_grid=np.zeros(n_samples, dtype=np.int64),
                ),
            )
        )

    @classmethod
    def build(
        cls, surface: SkinSurface, model: BodyModel, data: mujoco.MjData, deployment: Deployment
    ) -> Self:
        """Build the foundation of `surface` on the bodies of `model`, coupled to its state `data`.

        Raises:
            ModelError: a contact geom is a height field or a signed distance field.
        """
        mj, foam = model.mj, deployment.body.foam
        return cls(
            surface=surface,
            scene=build_contact_scene(
                mj, surface, _compliant_layers(mj, deployment), always_felt=(model.finger_body_id,)
            ),
            foam=Foam.of(foam),
            motion=motion_views(mj, data),
            temperature_c=model.temperature_c,
            applied_wrench=data.xfrc_applied,
        )

    def compute_contact(self, step_s: float) -> None:
        """Compute contact forces at the present poses and add them to `applied_wrench`; step `step_s` [s].

        Raises:
            ModelError: more solids share the samples of the skin than there is space for.
        """
        if not len(self.surface.body_id):
            return
        self.n_in_contact = compute_contact(self.problem, step_s)
        lost = int(self.problem.points.lost[0])
        if lost:
            raise ModelError(
                f"contact of skin: {lost} loaded points beyond the {len(self.problem.points.sample)} that "
                "are expected at most; several solids press most samples of all cells: merge their geoms"
            )
