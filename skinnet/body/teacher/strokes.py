"""Stroke task: the finger brushes over a sequence of cells at constant depth in the foam."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.contact.skin_foundation import Foundation
from skinnet.body.ground_truth.teaching_outcome import StrokeGroundTruth
from skinnet.body.teacher.finger import ContactTarget, Finger
from skinnet.body.teacher.finger_task import FingerPhase, FingerTask
from skinnet.clock import NS_PER_S
from skinnet.deployment.environment.teacher import StrokeSpec
from skinnet.pinned_linalg import dot, norm
from skinnet.skin.lattice import pitch_m

__all__ = ["Stroke", "SweepPath", "plan_sweeps"]

Floats = NDArray[np.float64]

_MAX_NEIGHBOUR_PITCHES = 1.45
"""Neighbour distance limit, in lattice pitches: on a curved body the faces of neighbours lie apart."""
_SEGMENTS_PER_CELL = 24
"""Number of path segments from one cell to its neighbour, 1 mm each."""
_MIN_TOUCH_N = 0.02
"""Minimum normal force [N] of a touched cell: a stroke 2 mm deep exerts 0.15 N (assumed)."""


class SweepPath:
    """Finger path over neighbouring cells of a patch without lifting, in the frame of the body.

    Attributes:
        targets: Contact targets along the path.
        length_m: Path length [m].
    """

    def __init__(self, targets: Sequence[ContactTarget]) -> None:
        """Interpolate a path from the first of `targets` to the last, over the face of the foam."""
        self.targets = list(targets)
        pieces = [_interpolate(one, other) for one, other in itertools.pairwise(targets)]
        ends = (targets[-1].point_m[None], targets[-1].normal[None])
        self._point_m, self._normal = (np.concatenate(part) for part in zip(*pieces, ends, strict=True))
        steps_m = np.linalg.norm(np.diff(self._point_m, axis=0), axis=1)
        self._arc_length_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        self.length_m = float(self._arc_length_m[-1])

    def target_at(self, arc_length_m: float) -> ContactTarget:
        """Contact target on the path at arc length `arc_length_m` [m]."""
        point_m, normal = (
            np.array([np.interp(arc_length_m, self._arc_length_m, values[:, axis]) for axis in range(3)])
            for values in (self._point_m, self._normal)
        )
        return self.targets[0]._replace(point_m=point_m, normal=normal / norm(normal))


class Stroke(FingerTask):
    """Stroke task of the teacher's script.

    Attributes:
        ground_truth: Ground truth of the stroke.
    """

    def __init__(
        self,
        finger: Finger,
        foundation: Foundation,
        spec: StrokeSpec,
        sweeps: Sequence[SweepPath],
        ground_truth: StrokeGroundTruth,
    ) -> None:
        """Place the finger above the beginning of the first of `sweeps`."""
        super().__init__(finger, ground_truth)
        self.ground_truth = ground_truth
        self._foundation, self._spec, self._remaining_sweeps = foundation, spec, list(sweeps)
        self._peak_n = np.zeros(len(foundation.surface.body_id))
        self._aborted = False
        self._arc_length_m = 0.0
        self._begin(self._remaining_sweeps.pop(0))

    def abort(self, t_ns: int) -> None:
        """Abort the stroke at `t_ns` [ns]: the finger withdraws, and the remaining sweeps are dropped."""
        super().abort(t_ns)
        self._aborted = True

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        step_s, spec, truth = step_ns / NS_PER_S, self._spec, self.ground_truth
        np.maximum(self._peak_n, self._foundation.contact.force_n.sum(axis=1), out=self._peak_n)
        truth.touched_cells = np.flatnonzero(self._peak_n >= _MIN_TOUCH_N).tolist()
        truth.peak_force_n = max(truth.peak_force_n, self._finger.force_n())
        if self.phase is FingerPhase.APPROACH:
            if self._lower(spec, spec.depth_m, step_s):
                self._enter(FingerPhase.HOLD)
        elif self.phase is FingerPhase.HOLD:
            self._arc_length_m = min(self._arc_length_m + spec.speed_m_s * step_s, self._sweep.length_m)
            if self._arc_length_m >= self._sweep.length_m:
                self._enter(FingerPhase.WITHDRAW)
        elif self._raise(spec, step_s):
            if self._aborted or not self._remaining_sweeps:
                self._finish(t_ns)
            else:
                self._begin(self._remaining_sweeps.pop(0))
            return
        self._finger.move(
            self._finger.approach_line(self._sweep.target_at(self._arc_length_m)), self._height_m, step_s
        )

    def _begin(self, sweep: SweepPath) -> None:
        self._sweep, self._arc_length_m, self._height_m = sweep, 0.0, self._spec.approach_m
        self._enter(FingerPhase.APPROACH)
        self._finger.place(self._finger.approach_line(sweep.target_at(0.0)), self._height_m)


def plan_sweeps(targets: Sequence[ContactTarget], side_m: float) -> list[list[ContactTarget]]:
    """Order contact targets of one patch into sweeps (nearest-neighbour tour).

    The tour begins at the cell farthest from the centroid and goes on to the nearest remaining cell, the
    first of equals; where that is no neighbour, another sweep begins.

    Args:
        targets: One on each cell.
        side_m: Side length of a cell [m].
    """
    left, point_m = list(range(len(targets))), np.array([spot.point_m for spot in targets])
    here = _argmax_with_tolerance(np.linalg.norm(point_m - point_m.mean(axis=0), axis=1))
    sweeps = [[targets[here]]]
    left.remove(here)
    while left:
        distance_m = np.linalg.norm(point_m[left] - point_m[here], axis=1)
        nearest = _argmax_with_tolerance(-distance_m)
        here = left.pop(nearest)
        if distance_m[nearest] > _MAX_NEIGHBOUR_PITCHES * pitch_m(side_m):
            sweeps.append([])
        sweeps[-1].append(targets[here])
    return sweeps


def _argmax_with_tolerance(values: Floats) -> int:
    """Index of the largest value, the first of those equal up to rounding."""
    return int(np.argmax(values >= values.max() - 1e-6))


def _interpolate(one: ContactTarget, other: ContactTarget) -> tuple[Floats, Floats]:
    """Interpolate points (m, 3) [m] and normals (m, 3) from one spot up to the other, exclusive.

    A cubic Hermite curve with tangents in the faces of the cells; on a cylinder it approximates the arc.
    """
    chord_m = other.point_m - one.point_m
    tangents_m = [chord_m - dot(chord_m, spot.normal) * spot.normal for spot in (one, other)]
    start_m, end_m = (t * norm(chord_m) / norm(t) for t in tangents_m)
    t = np.arange(_SEGMENTS_PER_CELL)[:, None] / _SEGMENTS_PER_CELL
    t2, t3 = t * t, t * t * t
    point_m = (
        (2 * t3 - 3 * t2 + 1) * one.point_m
        + (t3 - 2 * t2 + t) * start_m
        + (3 * t2 - 2 * t3) * other.point_m
        + (t3 - t2) * end_m
    )
    return point_m, (1 - t) * one.normal + t * other.normal
