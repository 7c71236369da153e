"""Contact margins where skin can be touched: set to 0, so that rigid contact begins at the rigid surface."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.collision_filter import geoms_felt_by_bodies

__all__ = ["clear_contact_margins", "geom_label"]

_MM_PER_M = 1e3


def clear_contact_margins(mj: mujoco.MjModel, bodies: Sequence[int] | NDArray[np.int64]) -> list[str]:
    """Set margin and gap to 0 of all geoms and pairs of `bodies`, which carry skin, and that they may touch.

    With a margin, MuJoCo's contact holds things off the foam, which then feels nothing; with a gap, things
    sink into the rigid surface. Margins of two geoms add up, so both sides are set.

    Returns:
        What was set, with its former values, in words.
    """
    carries = np.isin(mj.geom_bodyid, bodies)
    skinned = carries | geoms_felt_by_bodies(mj, bodies).any(axis=0)
    paired = (
        carries[mj.pair_geom1] | carries[mj.pair_geom2] if mj.npair else np.zeros(mj.npair, dtype=np.bool_)
    )
    cleared = []
    for index in np.flatnonzero(skinned & ((mj.geom_margin != 0.0) | (mj.geom_gap != 0.0))):
        cleared.append(geom_label(mj, int(index)) + _values(mj.geom_margin[index], mj.geom_gap[index]))
        mj.geom_margin[index] = mj.geom_gap[index] = 0.0
    for index in np.flatnonzero(paired & ((mj.pair_margin != 0.0) | (mj.pair_gap != 0.0))):
        ends = (geom_label(mj, int(end[index])) for end in (mj.pair_geom1, mj.pair_geom2))
        cleared.append(f"pair of {' and '.join(ends)}{_values(mj.pair_margin[index], mj.pair_gap[index])}")
        mj.pair_margin[index] = mj.pair_gap[index] = 0.0
    overrides = bool(mj.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    if overrides and mj.opt.o_margin != 0.0 and len(bodies):
        cleared.append(f"option o_margin{_values(mj.opt.o_margin, 0.0)}")
        mj.opt.o_margin = 0.0
    return cleared


def geom_label(mj: mujoco.MjModel, index: int) -> str:
    """Geom `index` in words: by its name, else by its number and body."""
    name = mj.geom(index).name
    return (
        f'geom "{name}"' if name else f'geom number {index} of body "{mj.body(mj.geom_bodyid[index]).name}"'
    )


def _values(margin_m: float, gap_m: float) -> str:
    values = {"margin": margin_m, "gap": gap_m}
    told = [f"{name} {_MM_PER_M * value_m:g} mm" for name, value_m in values.items() if value_m != 0.0]
    return f" ({', '.join(told)})"
