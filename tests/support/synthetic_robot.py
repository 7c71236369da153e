"""A robot with skin from rotations only: the truth that the self-organisation is tested against.

Arms of seven DoFs with cells on upper arm, elbow, forearm and hand, and a torso at rest; velocity servos with
a first-order lag; accelerometers with noise and quantisation. Recursive kinematics, nothing shared with the
controller.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skinnet.random_streams import generator

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TICK_NS = 5_000_000
SAMPLE_MS = 4
G_M_S2 = 9.80665
UP = np.array([0.0, 0.0, 1.0])
AXES = np.eye(3)[[1, 0, 2, 1, 2, 1, 0]]
"""Pitch, roll, yaw of the shoulder; pitch and yaw of the elbow; pitch and roll of the wrist."""
OFFSETS_M = np.array([0, 0, 0, -0.25, -0.12, -0.13, 0])[:, None] * UP
HOME_RAD = np.array([0.3, 0.25, 0.2, -1.2, 0.3, 0.3, 0.2])
SKINNED = {2: (0.05, 0.22), 3: (0.045, 0.1), 4: (0.045, 0.12), 6: (0.04, 0.12)}
"""Radius and length [m] of the skin behind a DoF of each arm."""
SLOTS_S: Any = (np.arange(5) + 0.5) / 1e3
"""Sample times in a tick. Not at the tick itself, where the acceleration of these servos jumps."""


class Program(Protocol):
    @property
    def done(self) -> bool: ...
    def step(self, t_ns: int, position_rad: Floats) -> Floats: ...
    def add_samples(self, cells: Ints, t_sampled_ns: Ints, acceleration_g: Floats) -> None: ...


def rotation(axis: Floats, angle: Any) -> Floats:
    """Rodrigues' formula, (..., 3, 3) for angles (...)."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.asarray(angle)[..., None, None]
    R: Floats = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew)
    return R


def cross(a: Floats, b: Floats) -> Floats:
    """numpy.cross of many vectors, several times as fast."""
    following, preceding = [1, 2, 0], [2, 0, 1]
    return a[..., following] * b[..., preceding] - a[..., preceding] * b[..., following]


class SkinnedArms:
    """Kinematics: one or two mirrored arms on a torso at rest, and their cells."""

    def __init__(
        self, n_arms: int = 2, cells_per_part: int = 8, torso_cells: int = 10, up: Floats = UP
    ) -> None:
        self.up = up
        self.n_arms, self.n_dofs = n_arms, 7 * n_arms
        sides = np.array([1, -1])[:n_arms]
        mirror = np.where([1, 0, 0, 1, 0, 1, 0], 1, sides[:, None])
        self.home_rad = (HOME_RAD * mirror).ravel()
        self.shoulder_m = np.stack([0 * sides, 0.25 * sides, 0 * sides + 1.2], axis=1)
        rng = generator(7, "cells")
        outward = rotation(
            np.array([0.0, 1.0, 0.0]), np.pi / 2
        )  # the normal of a cell, z, to the x of its link
        arm, dof, place, frame = [], [], [], []
        for a in range(n_arms):
            for d, (radius, length) in SKINNED.items():
                for around, spin, along in rng.uniform(-1, 1, (cells_per_part, 3)):
                    R = rotation(UP, np.pi * around) @ outward @ rotation(UP, np.pi * spin)
                    arm.append(a)
                    dof.append(d)
                    frame.append(R)
                    place.append(radius * R[:, 2] - length * (0.55 + 0.45 * along) * UP)
        self.arm, self.dof = np.array(arm), np.array(dof)
        self.R_link_cell, self.position_link_m = np.array(frame), np.array(place)
        self.n_arm_cells, self.n_cells = len(arm), len(arm) + torso_cells
        self.torso_up = np.array(
            [rotation(UP, s).T @ rotation(AXES[0], -1.5) @ up for s in range(torso_cells)]
        )

    @property
    def activity(self) -> NDArray[np.bool_]:
        """(S, D) which DoF moves which cell."""
        dof = np.arange(self.n_dofs)
        moved = (dof // 7 == self.arm[:, None]) & (dof % 7 <= self.dof[:, None])
        return np.vstack([moved, np.zeros((self.n_cells - self.n_arm_cells, self.n_dofs), dtype=bool)])

    def positions_m(self, q: Floats) -> Floats:
        """(T, S', 3) of the cells on the arms in the world, for joint positions (T, D)."""
        _, origin, R_world_link = self._links(q, 0 * q, 0 * q)[:3]
        position: Floats = origin + np.einsum("tsij,sj->tsi", R_world_link, self.position_link_m)
        return position

    def accelerometers_g(self, q: Floats, v: Floats, a: Floats) -> Floats:
        """(T, S, 3) specific force in the cells' frames; (T, D) each."""
        acceleration, _, R, omega, alpha = self._links(q, v, a)
        arm = np.einsum("tsij,sj->tsi", R, self.position_link_m)
        acceleration = acceleration + cross(alpha, arm) + cross(omega, cross(omega, arm))
        on_arms = ((acceleration / G_M_S2 + self.up)[..., None, :] @ R @ self.R_link_cell)[..., 0, :]
        return np.concatenate([on_arms, np.tile(self.torso_up, (len(q), 1, 1))], axis=1)

    def jacobian(self, q: Floats) -> Floats:
        """(S, D, 3) velocity of the cells along their axes per joint velocity, by finite differences."""
        R_world_cell = self._links(q[None], 0 * q[None], 0 * q[None])[2][0] @ self.R_link_cell
        step = 1e-6 * np.eye(self.n_dofs)
        J_world = (self.positions_m(q + step) - self.positions_m(q - step)) / 2e-6
        J = np.zeros((self.n_cells, self.n_dofs, 3))
        J[: self.n_arm_cells] = np.einsum("sij,dsi->sdj", R_world_cell, J_world)
        return J

    def _links(self, q: Floats, v: Floats, a: Floats) -> list[Floats]:
        """Origin's acceleration and position, frame, ω and α of the cells' links, (T, S', ...)."""
        q, v, a = (x.reshape(len(x), self.n_arms, 7) for x in (q, v, a))
        R = np.broadcast_to(np.eye(3), (*q.shape[:2], 3, 3))
        position = np.broadcast_to(self.shoulder_m, (*q.shape[:2], 3))
        acceleration = omega = alpha = np.zeros((*q.shape[:2], 3))
        links = []
        for d in range(7):
            r, axis = R @ OFFSETS_M[d], R @ AXES[d]
            position = position + r
            acceleration = acceleration + cross(alpha, r) + cross(omega, cross(omega, r))
            spin = axis * v[..., d, None]
            alpha = alpha + axis * a[..., d, None] + cross(omega, spin)
            omega = omega + spin
            R = R @ rotation(AXES[d], q[..., d])
            links.append((acceleration, position, R, omega, alpha))
        at = (slice(None), self.dof, self.arm)
        return [np.stack(x, axis=1)[at] for x in zip(*links, strict=True)]


class Servos:
    """Velocity servos: v̇ = (u − v)/lag, exact between ticks; a command takes effect one tick later."""

    def __init__(self, q: Floats, lag_s: float) -> None:
        self.q, self.v, self.u, self.lag_s = q.copy(), np.zeros_like(q), np.zeros_like(q), lag_s

    def at(self, t_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations (T, D) at times (T,) after the last tick."""
        t = t_s[:, None]
        decay, slip = np.exp(-t / self.lag_s), self.v - self.u
        return (
            self.q + self.u * t + slip * self.lag_s * (1 - decay),
            self.u + slip * decay,
            -slip * decay / self.lag_s,
        )

    def tick(self, u_next: Floats) -> None:
        q, v, _ = self.at(np.array([TICK_NS * 1e-9]))
        self.q, self.v, self.u = q[0], v[0], u_next


def run(
    program: Program,
    arms: SkinnedArms,
    *,
    noise_g: float,
    lsb_g: float = 0.0,
    lag_s: float = 0.005,
    dead_cells: tuple[int, ...] = (),
    stuck_dof: int | None = None,
) -> Servos:
    """Ticks a motion program on the robot until it is done; every cell samples each 4 ms in its own phase."""
    rng = generator(11, "noise")
    phase_ms = rng.integers(0, SAMPLE_MS, arms.n_cells)
    phase_ms[list(dead_cells)] = -1
    # ticks and samples meet again after four ticks: (slots, cells) that are due in each of the four
    due = [np.nonzero((5 * k + np.arange(5))[:, None] % SAMPLE_MS == phase_ms) for k in range(SAMPLE_MS)]
    servos = Servos(arms.home_rad, lag_s)
    truth_g: Floats | None = None
    for tick in range(100_000):
        if program.done:
            return servos
        t_ns = tick * TICK_NS
        if hasattr(program, "add_positions"):
            program.add_positions(t_ns, servos.q)
        command = program.step(t_ns, servos.q)
        if stuck_dof is not None:
            command[stuck_dof] = 0.0
        if truth_g is None or np.any(servos.u) or np.abs(servos.v).max() > 1e-9:
            truth_g = arms.accelerometers_g(*servos.at(SLOTS_S))
        slot, cells = due[tick % SAMPLE_MS]
        reading = truth_g[slot, cells] + noise_g * rng.standard_normal((len(cells), 3))
        if lsb_g:
            reading = np.round(reading / lsb_g) * lsb_g
        program.add_samples(cells, t_ns + np.rint(1e9 * SLOTS_S[slot]).astype(np.int64), reading)
        servos.tick(command)
    raise AssertionError("the motion program does not end")
