"""Collision filter: which geoms MuJoCo collides with each other, and hence which of them skin feels."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["felt_flex", "geoms_felt_by_bodies", "geoms_that_collide", "has_contacts_disabled"]

Bools = NDArray[np.bool_]
Indices = NDArray[np.int64]

_DEFAULT_MASK = 1
"""MuJoCo's default `contype` and `conaffinity`: those of the skin of a body without geoms."""
_WITHOUT_VOLUME = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


def geoms_that_collide(mj: mujoco.MjModel, geoms: Sequence[int] | Indices) -> Bools:
    """Geoms that MuJoCo collides with each of `geoms` (r): (r, ngeom), as `mj_collision` decides.

    An explicit `<pair>` always collides, also if its geoms have `contype` and `conaffinity` 0 or their
    bodies are excluded. Of all other pairs, these never collide: of one body or of bodies welded together;
    of two bodies that cannot move; of parent and child (unless the parent is welded to the world, or
    `filterparent` is disabled); of bodies that an `<exclude>` names; of geoms whose masks do not match.
    Nothing collides while contacts are disabled.
    """
    rows = np.asarray(geoms, dtype=np.int64)
    body = mj.geom_bodyid.astype(np.int64)
    if has_contacts_disabled(mj):
        return np.zeros((len(rows), mj.ngeom), dtype=np.bool_)
    collides = (
        _masks_match(mj, mj.geom_contype[rows], mj.geom_conaffinity[rows])
        & _bodies_collide(mj, body[rows])[:, body]
        & ~_excluded(mj, body[rows])[:, body]
    )
    collides |= _paired(mj, rows)
    flat = np.isin(mj.geom_type, _WITHOUT_VOLUME)
    return np.asarray(collides & ~(flat[rows, None] & flat), dtype=np.bool_)


def geoms_felt_by_bodies(mj: mujoco.MjModel, bodies: Sequence[int] | Indices) -> Bools:
    """Geoms that the skin of each of `bodies` (r) feels: (r, ngeom).

    Skin stands for the geoms of its body: it feels what collides with any of them (`geoms_that_collide`). The
    skin of a body without geoms has MuJoCo's default masks. One pair is felt that MuJoCo leaves out, as its
    contact could not move anything: two bodies that cannot move, such as fixed skin and a fixed table. There,
    only a body itself and its direct parent and children are left out.
    """
    felt = np.zeros((len(bodies), mj.ngeom), dtype=np.bool_)
    body = mj.geom_bodyid
    for row, index in enumerate(bodies):
        own = np.flatnonzero(body == index)
        felt[row] = geoms_that_collide(mj, own).any(axis=0)
        if has_contacts_disabled(mj):
            continue
        masks = (mj.geom_contype[own], mj.geom_conaffinity[own])
        if not len(own):
            masks = (np.array([_DEFAULT_MASK]), np.array([_DEFAULT_MASK]))
        owner = np.array([index])
        related = _both_fixed(mj, owner) & ~_adjacent(mj, int(index))
        if not len(own):
            related |= _bodies_collide(mj, owner)
        related &= ~_excluded(mj, owner)
        felt[row] |= _masks_match(mj, *masks).any(axis=0) & related[0, body]
    return felt


def felt_flex(mj: mujoco.MjModel, bodies: Sequence[int] | Indices, flex: int) -> bool:
    """True if skin of one of `bodies` may touch `flex`: its masks match those of a geom of the body."""
    if has_contacts_disabled(mj):
        return False
    for index in bodies:
        own = np.flatnonzero(mj.geom_bodyid == index)
        contype, conaffinity = mj.geom_contype[own], mj.geom_conaffinity[own]
        if not len(own):
            contype, conaffinity = np.array([_DEFAULT_MASK]), np.array([_DEFAULT_MASK])
        there = (contype & mj.flex_conaffinity[flex]) | (mj.flex_contype[flex] & conaffinity)
        if there.any():
            return True
    return False


def has_contacts_disabled(mj: mujoco.MjModel) -> bool:
    """True if flags of the model disable contacts or all constraints."""
    off = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return bool(mj.opt.disableflags & off)


def _masks_match(mj: mujoco.MjModel, contype: NDArray[np.int32], conaffinity: NDArray[np.int32]) -> Bools:
    """Compare masks (r) with those of all geoms: (r, ngeom), True where one's type is in other's affinity."""
    there = (contype[:, None] & mj.geom_conaffinity) | (mj.geom_contype & conaffinity[:, None])
    return np.asarray(there != 0, dtype=np.bool_)


def _bodies_collide(mj: mujoco.MjModel, bodies: Indices) -> Bools:
    """Bodies that can collide with each of `bodies` (r) by their places in the kinematic tree: (r, nbody)."""
    weld = mj.body_weldid.astype(np.int64)
    up = weld[mj.body_parentid[weld]]
    same = weld[bodies, None] == weld
    collide = ~same & ~_both_fixed(mj, bodies)
    if not mj.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        family = (weld[bodies, None] == up) | (up[bodies, None] == weld)
        collide &= ~(family & (weld[bodies, None] != 0) & (weld != 0))
    return np.asarray(collide, dtype=np.bool_)


def _both_fixed(mj: mujoco.MjModel, bodies: Indices) -> Bools:
    """Bodies that cannot move, for those of `bodies` (r) that cannot: (r, nbody); mocap bodies cannot."""
    fixed = mj.body_treeid < 0
    return np.asarray(fixed[bodies, None] & fixed, dtype=np.bool_)


def _adjacent(mj: mujoco.MjModel, body: int) -> Bools:
    """Body `body` with its direct parent and children, but the world as a parent: (nbody,)."""
    parent = mj.body_parentid
    adjacent = (parent == body) & (np.arange(mj.nbody) != 0)
    adjacent[[body, int(parent[body]) or body]] = True
    return np.asarray(adjacent, dtype=np.bool_)


def _excluded(mj: mujoco.MjModel, bodies: Indices) -> Bools:
    """Bodies that an `<exclude>` names together with each of `bodies` (r): (r, nbody)."""
    excluded = np.zeros((mj.nbody, mj.nbody), dtype=np.bool_)
    first, second = mj.exclude_signature >> 16, mj.exclude_signature & 0xFFFF
    excluded[first, second] = excluded[second, first] = True
    return excluded[bodies]


def _paired(mj: mujoco.MjModel, geoms: Indices) -> Bools:
    """Geoms that a `<pair>` names together with each of `geoms` (r): (r, ngeom)."""
    paired = np.zeros((len(geoms), mj.ngeom), dtype=np.bool_)
    for one, other in ((mj.pair_geom1, mj.pair_geom2), (mj.pair_geom2, mj.pair_geom1)):
        for a, b in zip(one, other, strict=True):
            paired[geoms == a, b] = True
    return paired
