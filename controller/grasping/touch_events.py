"""Tactile events of the state machine, from the levels that the cells report [M14, V.C]."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from controller.grasping.directives import Area
from controller.grasping.state_machine import Event
from controller.touch.fusion import TactilePicture
from skinnet.deployment.session import SessionSpec
from skinnet.messages import Modality

__all__ = ["TouchEvents", "limbs_of"]

Cells = NDArray[np.int64]


def limbs_of(cells: Cells, activity: NDArray[np.bool_]) -> list[Cells]:
    """Group cells by limb: two cells that share a moving DoF are on the same limb.

    Args:
        cells: (n,) cells of an area.
        activity: (S, D) from the structural exploration; cells that no DoF moves are on no limb.
    """
    limbs: list[tuple[NDArray[np.bool_], list[int]]] = []
    for cell in cells.tolist():
        moved_by, members = activity[cell], [cell]
        if not moved_by.any():
            continue
        apart = []
        for dofs, others in limbs:
            if (dofs & moved_by).any():
                moved_by, members = dofs | moved_by, others + members
            else:
                apart.append((dofs, others))
        limbs = [*apart, (moved_by, members)]
    return sorted((np.array(sorted(members)) for _, members in limbs), key=lambda limb: int(limb[0]))


class TouchEvents:
    """Detector of tactile events in one state, given the taught areas.

    A contact at the start of the state is no pat, and the timeout of a lost object starts with the state.

    Args:
        spec: Levels and times.
        areas: Cells of the taught areas.
        activity: (S, D) from the structural exploration.
        picture: Tactile state at the start of the state.
        t_ns: Start time of the state.

    Attributes:
        arms: Cells of the contact area on each arm.
    """

    def __init__(
        self,
        spec: SessionSpec,
        areas: Mapping[Area, Cells],
        activity: NDArray[np.bool_],
        picture: TactilePicture,
        t_ns: int,
    ) -> None:
        none = np.zeros(0, dtype=np.int64)
        self._spec = spec
        self._pat, self._chest = areas.get(Area.PAT, none), areas.get(Area.CHEST, none)
        self.arms = limbs_of(areas.get(Area.CONTACT, none), activity)
        self._held_ns = np.full(len(self.arms), t_ns)
        self._patted = self._contact(picture)

    @property
    def missing(self) -> str:
        """Unmet requirement of a grasp; empty if all are met."""
        if len(self.arms) < 2:
            return f"the contact area must be on two arms, it is on {len(self.arms)}"
        return "" if len(self._chest) else "the chest area has no cells"

    def sense(self, t_ns: int, picture: TactilePicture) -> set[Event]:
        """Detect the events at `t_ns`."""
        spec = self._spec
        force, contact = picture.level(Modality.FORCE), self._contact(picture)
        near = contact | (self._proximity(picture) >= spec.near_level)
        held = np.array([bool(contact[arm].any()) for arm in self.arms], dtype=np.bool_)
        self._held_ns[held] = t_ns
        new, self._patted = contact & ~self._patted, contact
        both = len(self.arms) >= 2
        conditions = {
            Event.PATTED: new[self._pat].any(),
            Event.OBJECT_NEAR: both and all(near[arm].any() for arm in self.arms),
            Event.OBJECT_TOUCHED: both and held.all(),
            Event.OBJECT_LOADED: both and all((force[arm] >= spec.load_level).any() for arm in self.arms),
            Event.OBJECT_LOST: bool((t_ns - self._held_ns > spec.lost_ns).any()),
            Event.CHEST_TOUCHED: contact[self._chest].any(),
            Event.PAIN: (force >= spec.pain_level).any(),
            Event.SKIN_LOST: self._blind(picture.found),
        }
        return {event for event, holds in conditions.items() if holds}

    def contacts(self, picture: TactilePicture) -> tuple[int, ...]:
        """Count the cells in contact: on each arm, then on the chest."""
        contact = self._contact(picture)
        return tuple(int(contact[cells].sum()) for cells in (*self.arms, self._chest))

    def _proximity(self, picture: TactilePicture) -> NDArray[np.int64]:
        level = picture.level(Modality.PROXIMITY)
        return level if self._spec.pre_contact else np.zeros_like(level)

    def _contact(self, picture: TactilePicture) -> NDArray[np.bool_]:
        close = self._proximity(picture) >= self._spec.contact_level
        touched: NDArray[np.bool_] = close | (picture.level(Modality.FORCE) > 0)
        return touched

    def _blind(self, found: NDArray[np.bool_]) -> bool:
        groups = [*self.arms, self._chest]
        return any(len(cells) and found[cells].mean() < self._spec.least_skin for cells in groups)
