"""Kinematic structure of body parts and joints, from changes of gravity in the cells' frames.

Equation (1) of [M14] (Mittendorfer et al., A general tactile approach for grasping unknown objects, 2014)
gives the activity matrix: which DoF moves which cell. Cells with equal rows form a body part, DoFs with equal
columns form a joint, and a joint connects two parts whose rows differ by it alone. Every kinematic tree has
such a matrix; a disturbed measurement mostly has not, and `KinematicStructure.problems` lists the violations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "KinematicStructure",
    "activity_matrix",
    "barely_active",
    "complete_structure",
    "count_wrong_entries",
    "find_structure",
    "format_members",
]

_CLEAR_RATIO = 1.25
"""Change of gravity of a DoF, as a multiple of the threshold, up to which noise decides for some cells.

A rigid rotation changes gravity alike in all cells that it moves; their averages scatter by a tenth of 10 mg.
"""


@dataclass(frozen=True, eq=False)
class KinematicStructure:
    """Kinematic tree found by exploration; reliable only if `problems` is empty.

    Parts are ordered by their depth, then by their first cell; joints by their first DoF.
    """

    activity: NDArray[np.bool_]
    """Activity matrix (S, D): DoF d moves cell s; the row of an unmeasured cell is false."""
    parts: tuple[tuple[int, ...], ...]
    """Cells of each body part."""
    joints: tuple[tuple[int, ...], ...]
    """DoFs of each joint; a DoF that moves no cell is in none."""
    part_activity: NDArray[np.bool_]
    """Reduced activity matrix (parts, joints)."""
    parent_part: tuple[int, ...]
    """Parent of each part, towards the root; −1 for the root and where it is not unique."""
    parent_joint: tuple[int, ...]
    """Joint between each part and its parent; −1 without a parent."""
    unmeasured: tuple[int, ...]
    """Cells with an unmeasured entry; they are in no part."""
    step_problems: tuple[str, ...]
    """Problems of the measurement, one line each."""
    problems: tuple[str, ...]
    """Problems of the measurement, and violations of a tree with one stationary root, one line each."""

    @property
    def untold(self) -> NDArray[np.bool_]:
        """DoFs (D,) that move no cell, as far as is known."""
        untold: NDArray[np.bool_] = ~np.logical_or.reduce(self.activity, axis=0)
        return untold


def activity_matrix(
    before_g: NDArray[np.float64],
    after_g: NDArray[np.float64],
    threshold_g: float = 0.01,
    lost: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Compute the activity matrix from gravity changes: equation (1) of [M14], runs combined by 'or'.

    Args:
        before_g: (P, D, S, 3) mean acceleration of cell s before DoF d moved in run p [g, cell frame];
            NaN where it was not measured.
        after_g: (P, D, S, 3) the same after the move.
        threshold_g: minimum distance of the two normalised vectors; 0.01 [M14].
        lost: (P, D) moves without a measurement, which say nothing about any cell; none unless given.

    Returns:
        (S, D) active entries, and (S, D) unknown ones: not active, with an unmeasured run.
    """
    change = _gravity_change(before_g, after_g)
    active = np.logical_or.reduce(change > threshold_g, axis=0)
    missing = np.isnan(change)
    if lost is not None:
        missing &= ~lost[:, :, None]
    unknown = ~active & np.logical_or.reduce(missing, axis=0)
    return active.T.copy(), unknown.T.copy()


def barely_active(
    before_g: NDArray[np.float64], after_g: NDArray[np.float64], threshold_g: float
) -> NDArray[np.bool_]:
    """Find the DoFs (D,) whose active entries noise decides; arguments as in `activity_matrix`."""
    change = np.nan_to_num(_gravity_change(before_g, after_g)).max(axis=0)
    active = change > threshold_g
    n_active = active.sum(axis=1)
    barely: NDArray[np.bool_] = (n_active > 0) & (
        np.where(active, change, 0.0).sum(axis=1) <= _CLEAR_RATIO * threshold_g * n_active
    )
    return barely


def find_structure(
    activity: NDArray[np.bool_],
    unknown: NDArray[np.bool_] | None = None,
    problems: Sequence[str] = (),
    *,
    accelerated: NDArray[np.bool_] | None = None,
    dof_names: Sequence[str] = (),
    cell_names: Sequence[str] = (),
) -> KinematicStructure:
    """Find body parts, joints and their kinematic tree from an activity matrix.

    Args:
        activity: (S, D) from `activity_matrix`.
        unknown: (S, D) unmeasured entries; their cells belong to no part.
        problems: problems of the measurement, listed first in the structure's problems.
        accelerated: (D,) DoFs whose activity was measured by acceleration as well; none unless given.
        dof_names: (D,) names of the DoFs in the problems; their numbers unless given.
        cell_names: (S,) names of the cells likewise.
    """
    unknown = np.zeros_like(activity) if unknown is None else unknown
    unmeasured = np.logical_or.reduce(unknown, axis=1)
    activity = activity & ~unmeasured[:, None]
    parts, part_dofs = _group_equal_rows(activity, np.flatnonzero(~unmeasured))
    joints, joint_parts = _group_equal_rows(part_dofs.T, np.flatnonzero(part_dofs.any(axis=0)))
    order = np.argsort(joint_parts.sum(axis=0), kind="stable")
    parts = tuple(parts[p] for p in order)
    part_activity = joint_parts.T[order]
    parent_part, parent_joint, broken = _find_tree(part_activity, parts, joints, dof_names, cell_names)

    found = list(problems)
    if unmeasured.any():
        found.append(
            f"{format_members('cell', np.flatnonzero(unmeasured), cell_names)} measured with too few samples"
        )
    idle = ~part_dofs.any(axis=0)
    shaken = np.zeros_like(idle) if accelerated is None else accelerated
    for dofs, why in (
        (idle & ~shaken, "no skin distal to it, or its axis is parallel to gravity"),
        (idle & shaken, "no skin distal to it, as neither gravity nor acceleration changes in any cell"),
    ):
        if dofs.any():
            found.append(f"{format_members('DoF', np.flatnonzero(dofs), dof_names)} moves no cell: {why}")
    return KinematicStructure(
        activity=activity,
        parts=parts,
        joints=joints,
        part_activity=part_activity,
        parent_part=parent_part,
        parent_joint=parent_joint,
        unmeasured=tuple(np.flatnonzero(unmeasured).tolist()),
        step_problems=tuple(problems),
        problems=(*found, *broken),
    )


def complete_structure(
    structure: KinematicStructure,
    accelerates: NDArray[np.bool_],
    measured: NDArray[np.bool_],
    *,
    dof_names: Sequence[str] = (),
    cell_names: Sequence[str] = (),
) -> KinematicStructure:
    """Complete a structure by acceleration where gravity tells nothing: axes parallel to it.

    Args:
        structure: structure from changes of gravity.
        accelerates: (S, D) True where a cell accelerates with a DoF.
        measured: (D,) DoFs for which this was measured.
        dof_names: (D,) names of the DoFs in the problems; their numbers unless given.
        cell_names: (S,) names of the cells likewise.

    Returns:
        The completed structure; `structure` itself if gravity has told all that was measured.
    """
    added = structure.untold & measured
    if not added.any():
        return structure
    unknown = np.zeros_like(structure.activity)
    unknown[list(structure.unmeasured)] = True
    return find_structure(
        np.where(added, accelerates, structure.activity),
        unknown,
        structure.step_problems,
        accelerated=added,
        dof_names=dof_names,
        cell_names=cell_names,
    )


def count_wrong_entries(structure: KinematicStructure, ground_truth: NDArray[np.bool_]) -> int:
    """Count the entries of the activity matrix that differ from the ground truth (S, D)."""
    return int(np.count_nonzero(structure.activity != ground_truth))


def _gravity_change(before_g: NDArray[np.float64], after_g: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance (P, D, S) of the normalised accelerations before and after a move."""
    change: NDArray[np.float64] = np.linalg.norm(_normalise(before_g) - _normalise(after_g), axis=-1)
    return change


def _normalise(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalise vectors along the last axis; NaN for a zero vector."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    result: NDArray[np.float64] = np.divide(
        vector, length, out=np.full_like(vector, np.nan), where=length > 0
    )
    return result


def _group_equal_rows(
    matrix: NDArray[np.bool_], members: NDArray[np.int64]
) -> tuple[tuple[tuple[int, ...], ...], NDArray[np.bool_]]:
    """Group members by equal rows of `matrix`, ordered by first member; also return the row of each class."""
    groups: dict[bytes, list[int]] = {}
    for member in members.tolist():
        groups.setdefault(matrix[member].tobytes(), []).append(member)
    classes = tuple(tuple(group) for group in groups.values())
    return classes, matrix[[group[0] for group in classes]].reshape(len(classes), matrix.shape[1])


def _find_tree(
    part_activity: NDArray[np.bool_],
    parts: tuple[tuple[int, ...], ...],
    joints: tuple[tuple[int, ...], ...],
    dof_names: Sequence[str],
    cell_names: Sequence[str],
) -> tuple[tuple[int, ...], tuple[int, ...], list[str]]:
    """Find parent and joint of each part, and list the violations of a tree.

    A tree needs one part without activity, one parent for every other part, and a separate joint for each.
    Then the row of a part is the set of joints between it and the root.
    """
    parent_part, parent_joint = [-1] * len(parts), [-1] * len(parts)
    problems = []
    if not len(parts) or part_activity[0].any():
        problems.append("no stationary part: every cell moves, so the tree has no root")
    for part, row in enumerate(part_activity):
        if not row.any():
            continue
        missing = row & ~part_activity
        candidates = np.flatnonzero((missing.sum(axis=1) == 1) & ~(part_activity & ~row).any(axis=1))
        if len(candidates) == 1:
            parent_part[part] = int(candidates[0])
            parent_joint[part] = int(np.flatnonzero(missing[candidates[0]])[0])
        else:
            which = "has no parent" if not len(candidates) else f"has {len(candidates)} possible parents"
            problems.append(f"the part of {format_members('cell', parts[part], cell_names)} {which}")
    for joint, dofs in enumerate(joints):
        children = parent_joint.count(joint)
        if children > 1:
            problems.append(
                f"the joint of {format_members('DoF', dofs, dof_names)} leads to {children} parts"
            )
    return tuple(parent_part), tuple(parent_joint), problems


def format_members(
    noun: str,
    numbers: Sequence[int] | NDArray[np.int64],
    names: Sequence[str] = (),
    max_listed: int = 8,
) -> str:
    """Format a shortened list of members by name, or by number without names: 'cells 3, 4, 5, … (20)'."""
    plural = f"{noun}s" if len(numbers) > 1 else noun
    more = f", … ({len(numbers)})" if len(numbers) > max_listed else ""
    return f"{plural} {', '.join(names[n] if names else str(n) for n in numbers[:max_listed])}{more}"
