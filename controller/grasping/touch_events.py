"""Tactile events of the state machine, from the levels that the cells report [M14, V.C]."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from controller.grasping.state_machine import Event
from controller.grasping.state_parameters import Area
from controller.touch.tactile_state import TactileState
from skinnet.deployment.controller.teach_and_grasp import TeachAndGraspSpec
from skinnet.protocol.messages import Modality

__all__ = ["TouchEventDetector", "group_by_limb"]

Cells = NDArray[np.int64]


def group_by_limb(cells: Cells, activity: NDArray[np.bool_]) -> list[Cells]:
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


class TouchEventDetector:
    """Detector of tactile events in one state, given the taught areas.

    A contact at the start of the state is no pat, and the timeout of a lost object starts with the state.

    Args:
        spec: Levels and times.
        areas: Cells of the taught areas.
        activity: (S, D) from the structural exploration.
        tactile_state: Tactile state at the start of the state.
        t_ns: Start time of the state.

    Attributes:
        arms: Cells of the contact area on each arm.
    """

    def __init__(
        self,
        spec: TeachAndGraspSpec,
        areas: Mapping[Area, Cells],
        activity: NDArray[np.bool_],
        tactile_state: TactileState,
        t_ns: int,
    ) -> None:
        none = np.zeros(0, dtype=np.int64)
        self._spec = spec
        self._pat, self._chest = areas.get(Area.PAT, none), areas.get(Area.CHEST, none)
        self.arms = group_by_limb(areas.get(Area.CONTACT, none), activity)
        self._last_contact_ns = np.full(len(self.arms), t_ns)
        self._previous_contact = self._contact(tactile_state)

    @property
    def unmet_requirement(self) -> str:
        """Unmet requirement of a grasp; empty if all are met."""
        if len(self.arms) < 2:
            return f"the contact area must cover two arms, but covers {len(self.arms)}"
        return "" if len(self._chest) else "the chest area has no cells"

    def detect(self, t_ns: int, tactile_state: TactileState) -> set[Event]:
        """Detect the events at `t_ns`."""
        spec = self._spec
        force, contact = tactile_state.level(Modality.FORCE), self._contact(tactile_state)
        near = contact | (self._proximity(tactile_state) >= spec.near_level)
        held = np.array([bool(contact[arm].any()) for arm in self.arms], dtype=np.bool_)
        self._last_contact_ns[held] = t_ns
        new, self._previous_contact = contact & ~self._previous_contact, contact
        both = len(self.arms) >= 2
        conditions = {
            Event.PATTED: new[self._pat].any(),
            Event.OBJECT_NEAR: both and all(near[arm].any() for arm in self.arms),
            Event.OBJECT_TOUCHED: both and held.all(),
            Event.OBJECT_LOADED: both and all((force[arm] >= spec.load_level).any() for arm in self.arms),
            Event.OBJECT_LOST: bool((t_ns - self._last_contact_ns > spec.contact_timeout_ns).any()),
            Event.CHEST_TOUCHED: contact[self._chest].any(),
            Event.PAIN: (force >= spec.pain_level).any(),
            Event.SKIN_LOST: self._is_skin_lost(tactile_state.present),
        }
        return {event for event, holds in conditions.items() if holds}

    def contact_counts(self, tactile_state: TactileState) -> tuple[int, ...]:
        """Count the cells in contact: on each arm, then on the chest."""
        contact = self._contact(tactile_state)
        return tuple(int(contact[cells].sum()) for cells in (*self.arms, self._chest))

    def _proximity(self, tactile_state: TactileState) -> NDArray[np.int64]:
        level = tactile_state.level(Modality.PROXIMITY)
        return level if self._spec.pre_contact else np.zeros_like(level)

    def _contact(self, tactile_state: TactileState) -> NDArray[np.bool_]:
        close = self._proximity(tactile_state) >= self._spec.contact_level
        touched: NDArray[np.bool_] = close | (tactile_state.level(Modality.FORCE) > 0)
        return touched

    def _is_skin_lost(self, present: NDArray[np.bool_]) -> bool:
        groups = [*self.arms, self._chest]
        return any(len(cells) and present[cells].mean() < self._spec.min_skin_fraction for cells in groups)
