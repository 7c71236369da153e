"""Grasp ground truth: object pose, contact forces on it, and rigid contacts with bare links."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.stand import Phase, Stand
from skinnet.body.things import OBJECT, STAND, Presented
from skinnet.body.winkler import Pressed
from skinnet.clock import NS_PER_S
from skinnet.errors import DeploymentError

__all__ = ["GraspTruth", "Met"]

Floats = NDArray[np.float64]
_TOUCH_N = 0.1
"""Minimum force [N] of a rigid contact: a link under skin exerts up to this on a compliant object."""
_GONE = (Phase.LOWERING, Phase.AWAY, Phase.RETURNING)
"""Phases of the stand in which it does not support the object that the robot holds."""


@dataclass
class Met:
    """Rigid contact of object or stand with one geom of the robot or the world, from 0.1 N on.

    Attributes:
        first_ns: Time of the first contact [ns].
        peak_n: Largest normal force [N].
        peak_ns: Time of the largest force [ns].
        total_s: Total duration of contact [s].
        stages: Duration in each stage of the controller's program [s].
    """

    first_ns: int
    peak_n: float = 0.0
    peak_ns: int = 0
    total_s: float = 0.0
    stages: dict[str, float] = field(default_factory=dict)

    def observe(self, t_ns: int, step_s: float, force_n: float, stage: str) -> None:
        """Add a contact of one step from `t_ns` [ns] on, with the normal force `force_n` [N]."""
        if force_n > self.peak_n:
            self.peak_n, self.peak_ns = force_n, t_ns
        self.total_s += step_s
        self.stages[stage] = self.stages.get(stage, 0.0) + step_s


class _Pair(NamedTuple):
    """Contact pair: object or stand, the other geom, and `between` if the other is object or stand too."""

    mine: int
    other: int
    between: bool


class GraspTruth:
    """Ground-truth recorder of object and stand during a grasp.

    Attributes:
        object_met: Rigid contacts of the object, except with skin and stand, by geom name.
        stand_met: Rigid contacts of the stand, except with the object, by geom name.
        left_ns: Time at which the object first lost contact with the stand [ns], or None.
        dropped_ns: Time at which its centre first was below the stand's top [ns], or None.
        carried_s: Time off the stand before it was dropped [s].
        carried_away_s: Part of `carried_s` while the stand was away [s].
        sunk_m: Largest descent while the stand was lowering, away or returning [m].
        peak_speed_m_s: Largest speed off the stand [m/s].
    """

    def __init__(
        self, data: mujoco.MjData, presented: Presented, stand: Stand, pressed: Pressed, every_ns: int
    ) -> None:
        """Initialise the recorder before the first step.

        Args:
            data: MuJoCo's state.
            presented: Stand and object in front of the robot.
            stand: Motion of the stand.
            pressed: Contact state of the cells' foundation.
            every_ns: Recording period [ns].
        """
        self.object_met: dict[str, Met] = {}
        self.stand_met: dict[str, Met] = {}
        self.left_ns: int | None = None
        self.dropped_ns: int | None = None
        self.carried_s = self.carried_away_s = self.sunk_m = self.peak_speed_m_s = 0.0
        self._data, self._presented, self._stand, self._pressed = data, presented, stand, pressed
        self._every_ns, self._stage = every_ns, ""
        mj = data.model
        there = presented.thing is not None
        self._body = int(mj.body(OBJECT).id) if there else -1
        self._dof = int(mj.joint(OBJECT).dofadr[0]) if there and not presented.stand.stuck else -1
        self._owner = mj.geom_bodyid.tolist()
        stand_body = int(mj.body(STAND).id)
        self._ours = [stand_body, self._body] if there else [stand_body]
        self._names = [mj.geom(i).name or f"{mj.body(b).name}[{i}]" for i, b in enumerate(self._owner)]
        self._wrench = np.zeros(6)
        self._held_at_m: float | None = None
        self._t_ns: list[int] = []
        self._top_m: list[float] = []
        self._poses: list[Floats] = []
        self._patch_n: list[Floats] = []
        self._speeds_m_s: list[float] = []
        self._standing_n: list[float] = []

    def require_clear(self) -> None:
        """Check that object and stand are clear of robot and skin; needs contacts at the present state.

        Raises:
            DeploymentError: a geom or the skin touches them.
        """
        pairs = map(self._of_ours, self._data.contact.geom.tolist())
        touched = [self._names[pair.other] for pair in pairs if pair is not None and not pair.between]
        if self._pressed.by_patch_n[:, self._ours].any():
            touched.append("skin")
        if touched:
            raise DeploymentError(
                f"stand: object or stand touch {', '.join(sorted(set(touched)))} at the start; present them "
                "from farther below (stand.below_m) or farther away (stand.near_x_m), or change body.home_rad"
            )

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self._stage = name

    def observe(self, t_ns: int, step_s: float) -> None:
        """Record contacts and poses at `t_ns` [ns]; they count for `step_s` [s]."""
        record = t_ns % self._every_ns == 0
        standing_n = self._watch_contacts(t_ns, step_s, record) if self._data.ncon else 0.0
        if record:
            self._t_ns.append(t_ns)
            self._top_m.append(float(self._data.xpos[self._ours[0], 2]))
            if self._body >= 0:
                self._watch_object(t_ns, standing_n)

    def facts(self) -> dict[str, Any]:
        """Facts of the grasp for the body's process result."""
        presented = self._presented
        stand = {
            "phases": [[t_ns, phase.value] for t_ns, phase in self._stand.history],
            "met": {name: vars(met) for name, met in self.stand_met.items()},
        }
        if presented.thing is None:
            return {"stand": stand, "object": None}
        thing = {
            "name": presented.name,
            "size_m": presented.thing.size_m,
            "mass_kg": presented.thing.mass_kg,
            "stiffness_pa_per_m": presented.thing.stiffness_pa_per_m,
            "placed_m": presented.at_m,
            "yaw_rad": presented.yaw_rad,
            "stuck": presented.stand.stuck,
            "left_stand_ns": self.left_ns,
            "dropped_ns": self.dropped_ns,
            "carried_s": self.carried_s,
            "carried_away_s": self.carried_away_s,
            "sunk_m": self.sunk_m,
            "peak_speed_m_s": self.peak_speed_m_s,
            "met": {name: vars(met) for name, met in self.object_met.items()},
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
        n_patches = len(self._pressed.by_patch_n)
        return arrays | {
            "object_t_ns": arrays["stand_t_ns"],
            "object_pose": np.array(self._poses, dtype=np.float32).reshape(-1, 7),
            "object_patch_n": np.array(self._patch_n, dtype=np.float32).reshape(-1, n_patches),
            "object_speed_m_s": np.array(self._speeds_m_s, dtype=np.float32),
            "object_on_stand_n": np.array(self._standing_n, dtype=np.float32),
        }

    def _of_ours(self, geoms: list[int]) -> _Pair | None:
        """Contact pair of two geoms if object or stand is one of them, else None."""
        one, other = geoms
        mine, theirs = self._owner[one], self._owner[other]
        if mine in self._ours:
            return _Pair(mine, other, theirs in self._ours)
        return _Pair(theirs, one, between=False) if theirs in self._ours else None

    def _watch_contacts(self, t_ns: int, step_s: float, record: bool) -> float:
        """Record rigid contacts of object and stand; return the force between them [N], 0 if not recorded."""
        standing_n = 0.0
        forces: dict[_Pair, float] = {}
        for index, geoms in enumerate(self._data.contact.geom.tolist()):
            pair = self._of_ours(geoms)
            if pair is None or (pair.between and not record):
                continue
            mujoco.mj_contactForce(self._data.model, self._data, index, self._wrench)
            force_n = float(self._wrench[0])
            if pair.between:
                standing_n += force_n
            else:
                forces[pair] = forces.get(pair, 0.0) + force_n
        for pair, force_n in forces.items():
            if force_n < _TOUCH_N:
                continue
            met = self.object_met if pair.mine == self._body else self.stand_met
            name = self._names[pair.other]
            met.setdefault(name, Met(t_ns)).observe(t_ns, step_s, force_n, self._stage)
        return standing_n

    def _watch_object(self, t_ns: int, standing_n: float) -> None:
        data, body, phase = self._data, self._body, self._stand.phase
        height_m = float(data.xpos[body, 2])
        free = self._dof >= 0
        speed_m_s = float(np.linalg.norm(data.qvel[self._dof : self._dof + 3])) if free else 0.0
        self._poses.append(np.concatenate([data.xpos[body], data.xquat[body]]))
        self._patch_n.append(self._pressed.by_patch_n[:, body].copy())
        self._speeds_m_s.append(speed_m_s)
        self._standing_n.append(standing_n)
        if self.dropped_ns is None and height_m < self._top_m[-1]:
            self.dropped_ns = t_ns
        if free and t_ns > 0 and standing_n == 0.0:
            period_s = self._every_ns / NS_PER_S
            self.left_ns = t_ns if self.left_ns is None else self.left_ns
            self.peak_speed_m_s = max(self.peak_speed_m_s, speed_m_s)
            if self.dropped_ns is None:
                self.carried_s += period_s
                self.carried_away_s += period_s if phase is Phase.AWAY else 0.0
        if phase not in _GONE:
            self._held_at_m = height_m
        elif self._held_at_m is not None:
            self.sunk_m = max(self.sunk_m, self._held_at_m - height_m)
