"""Grasp ground truth: object pose, contact forces on it, and rigid contacts with bare links."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.added_elements import added_id
from skinnet.body.contact.contact_problem import ContactState
from skinnet.body.environment.stand import Stand, StandPhase
from skinnet.body.environment.stand_model import OBJECT, STAND, PlacedObject
from skinnet.body.model_file import gravity_m_s2
from skinnet.clock import NS_PER_S
from skinnet.errors import DeploymentError
from skinnet.pinned_linalg import dot, norm

__all__ = ["GraspGroundTruth", "RigidContact"]

Floats = NDArray[np.float64]
_MIN_CONTACT_N = 0.1
"""Minimum force [N] of a rigid contact: a link under skin exerts up to this on a compliant object."""
_UNSUPPORTED_PHASES = (StandPhase.LOWERING, StandPhase.LOWERED, StandPhase.RETURNING)
"""Phases of the stand in which it does not support the object that the robot holds."""


@dataclass
class RigidContact:
    """Rigid contact of object or stand with one geom of the robot or the world, from 0.1 N on.

    Attributes:
        first_ns: Time of the first contact [ns].
        peak_force_n: Largest normal force [N].
        peak_ns: Time of the largest force [ns].
        duration_s: Total duration of contact [s].
        duration_by_stage_s: Duration in each stage of the controller's program [s].
    """

    first_ns: int
    peak_force_n: float = 0.0
    peak_ns: int = 0
    duration_s: float = 0.0
    duration_by_stage_s: dict[str, float] = field(default_factory=dict)

    def record(self, t_ns: int, step_s: float, force_n: float, stage: str) -> None:
        """Add a contact of one step from `t_ns` [ns] on, with the normal force `force_n` [N]."""
        if force_n > self.peak_force_n:
            self.peak_force_n, self.peak_ns = force_n, t_ns
        self.duration_s += step_s
        self.duration_by_stage_s[stage] = self.duration_by_stage_s.get(stage, 0.0) + step_s


class _ContactPair(NamedTuple):
    """Contact pair: object or stand, the other geom, and `is_internal` if that is object or stand too."""

    body_id: int
    geom_id: int
    is_internal: bool


class GraspGroundTruth:
    """Ground-truth recorder of object and stand during a grasp.

    Attributes:
        object_contacts: Rigid contacts of the object, except with skin and stand, by geom name.
        stand_contacts: Rigid contacts of the stand, except with the object, by geom name.
        lift_off_ns: Time at which the object first lost contact with the stand [ns], or None.
        dropped_ns: Time at which it first lay on the lowered stand, or its centre was below the stand's top
            [ns], or None.
        carried_s: Time off the stand before it was dropped [s].
        carried_without_stand_s: Part of `carried_s` while the stand was away [s].
        carried_on_skin_s: Part of that in which bare links and everything else that has no skin bore at most
            the stand's `bare_weight_fraction` of the weight [s].
        descent_m: Largest descent while the stand was lowering, away or returning [m].
        peak_speed_m_s: Largest speed off the stand [m/s].
    """

    def __init__(
        self,
        data: mujoco.MjData,
        placed_object: PlacedObject,
        stand: Stand,
        contact: ContactState,
        period_ns: int,
    ) -> None:
        """Initialise the recorder before the first step.

        Args:
            data: MuJoCo's state.
            placed_object: Stand and object in front of the robot.
            stand: Motion of the stand.
            contact: Contact state of the cells' foundation.
            period_ns: Recording period [ns].
        """
        self.object_contacts: dict[str, RigidContact] = {}
        self.stand_contacts: dict[str, RigidContact] = {}
        self.lift_off_ns: int | None = None
        self.dropped_ns: int | None = None
        self.carried_s = self.carried_without_stand_s = self.carried_on_skin_s = 0.0
        self.descent_m = self.peak_speed_m_s = 0.0
        self._data, self._placed_object, self._stand, self._contact = data, placed_object, stand, contact
        self._period_ns, self._stage = period_ns, ""
        mj = data.model
        there = placed_object.object_model is not None
        self._body = added_id(mj, mujoco.mjtObj.mjOBJ_BODY, OBJECT) if there else -1
        self._dof = int(mj.body_dofadr[self._body]) if there and not placed_object.stand.fix_object else -1
        self._weight_n = norm(gravity_m_s2(mj)) * float(mj.body_mass[self._body]) if there else 0.0
        self._max_bare_lift_n = placed_object.stand.bare_weight_fraction * self._weight_n
        self._geom_body = mj.geom_bodyid.tolist()
        stand_body = added_id(mj, mujoco.mjtObj.mjOBJ_BODY, STAND)
        self._watched_bodies = [stand_body, self._body] if there else [stand_body]
        self._names = [mj.geom(i).name or f"{mj.body(b).name}[{i}]" for i, b in enumerate(self._geom_body)]
        self._wrench = np.zeros(6)
        self._bare_lift_n = 0.0
        self._supported_height_m: float | None = None
        self._t_ns: list[int] = []
        self._top_m: list[float] = []
        self._poses: list[Floats] = []
        self._patch_n: list[Floats] = []
        self._speeds_m_s: list[float] = []
        self._stand_force_n: list[float] = []

    def require_clear(self) -> None:
        """Check that object and stand are clear of robot and skin; needs contacts at the present state.

        Raises:
            DeploymentError: a geom or the skin touches them.
        """
        pairs = map(self._contact_pair, self._data.contact.geom.tolist())
        touched = [self._names[pair.geom_id] for pair in pairs if pair is not None and not pair.is_internal]
        if self._contact.patch_body_force_n[:, self._watched_bodies].any():
            touched.append("skin")
        if touched:
            raise DeploymentError(
                f"stand: object or stand are in contact with {', '.join(sorted(set(touched)))} at the "
                "start; place them "
                "from farther below (stand.rise_m) or farther away (stand.object_face_x_m), or change "
                "body.home_rad"
            )

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self._stage = name

    def record(self, t_ns: int, step_s: float) -> None:
        """Record contacts and poses at `t_ns` [ns]; they count for `step_s` [s]."""
        record = t_ns % self._period_ns == 0
        self._bare_lift_n = 0.0
        standing_n = self._record_contacts(t_ns, step_s, record) if self._data.ncon else 0.0
        if record:
            self._t_ns.append(t_ns)
            self._top_m.append(float(self._data.xpos[self._watched_bodies[0], 2]))
            if self._body >= 0:
                self._record_object(t_ns, standing_n)

    def facts(self) -> dict[str, Any]:
        """Facts of the grasp for the body's process result."""
        presented = self._placed_object
        stand = {
            "phases": [[t_ns, phase.value] for t_ns, phase in self._stand.history],
            "rigid_contacts": {name: vars(met) for name, met in self.stand_contacts.items()},
        }
        if presented.object_model is None:
            return {"stand": stand, "object": None}
        thing = {
            "name": presented.name,
            "size_m": presented.object_model.size_m,
            "mass_kg": presented.object_model.mass_kg,
            "weight_n": self._weight_n,
            "stiffness_pa_per_m": presented.object_model.stiffness_pa_per_m,
            "initial_position_m": presented.position_m,
            "yaw_rad": presented.yaw_rad,
            "stuck": presented.stand.fix_object,
            "lift_off_ns": self.lift_off_ns,
            "dropped_ns": self.dropped_ns,
            "carried_s": self.carried_s,
            "carried_without_stand_s": self.carried_without_stand_s,
            "carried_on_skin_s": self.carried_on_skin_s,
            "max_descent_m": self.descent_m,
            "peak_speed_m_s": self.peak_speed_m_s,
            "rigid_contacts": {name: vars(met) for name, met in self.object_contacts.items()},
        }
        return {"stand": stand, "object": thing}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Time series of the grasp, at the period of the joints; the object's only if there is one.

        Height of the stand's top [m]; position [m] and quaternion (w, x, y, z) of the object, its speed
        [m/s], the normal force of each patch on it [N] and that of the stand [N].
        """
        arrays: dict[str, NDArray[Any]] = {
            "stand_t_ns": np.array(self._t_ns, dtype=np.int64),
            "stand_top_m": np.array(self._top_m, dtype=np.float32),
        }
        if self._body < 0:
            return arrays
        n_patches = len(self._contact.patch_body_force_n)
        return arrays | {
            "object_t_ns": arrays["stand_t_ns"],
            "object_pose": np.array(self._poses, dtype=np.float32).reshape(-1, 7),
            "object_patch_force_n": np.array(self._patch_n, dtype=np.float32).reshape(-1, n_patches),
            "object_speed_m_s": np.array(self._speeds_m_s, dtype=np.float32),
            "object_stand_force_n": np.array(self._stand_force_n, dtype=np.float32),
        }

    def _contact_pair(self, geoms: list[int]) -> _ContactPair | None:
        """Contact pair of two geoms if object or stand is one of them, else None."""
        one, other = geoms
        mine, theirs = self._geom_body[one], self._geom_body[other]
        if mine in self._watched_bodies:
            return _ContactPair(mine, other, theirs in self._watched_bodies)
        return _ContactPair(theirs, one, is_internal=False) if theirs in self._watched_bodies else None

    def _record_contacts(self, t_ns: int, step_s: float, record: bool) -> float:
        """Record rigid contacts of object and stand; return the force between them [N], 0 if not recorded."""
        standing_n = 0.0
        forces: dict[_ContactPair, float] = {}
        for index, geoms in enumerate(self._data.contact.geom.tolist()):
            pair = self._contact_pair(geoms)
            if pair is None or (pair.is_internal and not record):
                continue
            mujoco.mj_contactForce(self._data.model, self._data, index, self._wrench)
            force_n = float(self._wrench[0])
            if pair.is_internal:
                standing_n += force_n
            else:
                forces[pair] = forces.get(pair, 0.0) + force_n
                if pair.body_id == self._body:
                    self._bare_lift_n += self._upward_n(index, on_second=geoms[0] == pair.geom_id)
        for pair, force_n in forces.items():
            if force_n < _MIN_CONTACT_N:
                continue
            met = self.object_contacts if pair.body_id == self._body else self.stand_contacts
            name = self._names[pair.geom_id]
            met.setdefault(name, RigidContact(t_ns)).record(t_ns, step_s, force_n, self._stage)
        return standing_n

    def _upward_n(self, index: int, *, on_second: bool) -> float:
        """Upward force of contact `index` [N], normal and friction, on one of its geoms."""
        # MuJoCo's contact frame: rows are its axes in the world; its force acts on the second geom
        upward_n = dot(self._wrench[:3], self._data.contact[index].frame.reshape(3, 3)[:, 2])
        return upward_n if on_second else -upward_n

    def _is_dropped(self, height_m: float, stand_force_n: float) -> bool:
        return height_m < self._top_m[-1] or (stand_force_n > 0.0 and self._stand.phase is StandPhase.LOWERED)

    def _record_object(self, t_ns: int, stand_force_n: float) -> None:
        data, body, phase = self._data, self._body, self._stand.phase
        height_m = float(data.xpos[body, 2])
        free = self._dof >= 0
        speed_m_s = norm(data.qvel[self._dof : self._dof + 3]) if free else 0.0
        self._poses.append(np.concatenate([data.xpos[body], data.xquat[body]]))
        self._patch_n.append(self._contact.patch_body_force_n[:, body].copy())
        self._speeds_m_s.append(speed_m_s)
        self._stand_force_n.append(stand_force_n)
        if free and self.dropped_ns is None and self._is_dropped(height_m, stand_force_n):
            self.dropped_ns = t_ns
        if free and t_ns > 0 and stand_force_n == 0.0:
            period_s = self._period_ns / NS_PER_S
            self.lift_off_ns = t_ns if self.lift_off_ns is None else self.lift_off_ns
            self.peak_speed_m_s = max(self.peak_speed_m_s, speed_m_s)
            if self.dropped_ns is None:
                self.carried_s += period_s
                if phase is StandPhase.LOWERED:
                    self.carried_without_stand_s += period_s
                    self.carried_on_skin_s += period_s if self._bare_lift_n <= self._max_bare_lift_n else 0.0
        if phase not in _UNSUPPORTED_PHASES:
            self._supported_height_m = height_m
        elif self._supported_height_m is not None:
            self.descent_m = max(self.descent_m, self._supported_height_m - height_m)
