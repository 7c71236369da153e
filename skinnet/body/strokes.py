"""Stroke task: the finger brushes over a sequence of cells at constant depth in the foam."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skinnet.body.finger import Finger, Phase, Spot
from skinnet.body.foundation import Foundation
from skinnet.body.teaching_truth import StrokeTruth
from skinnet.clock import NS_PER_S
from skinnet.deployment.teacher import StrokeSpec
from skinnet.skin.lattice import pitch_m

__all__ = ["Stroke", "Sweep", "sweeps_over"]

Floats = NDArray[np.float64]

_NEIGHBOURS = 1.45
"""Neighbour distance limit, in lattice pitches: on a curved body the faces of neighbours lie apart."""
_FINENESS = 24
"""Number of path segments from one cell to its neighbour, 1 mm each."""
_TOUCHED_N = 0.02
"""Minimum normal force [N] of a touched cell: a stroke 2 mm deep exerts 0.15 N (assumed)."""


class Sweep:
    """Finger path over neighbouring cells of a patch without lifting, in the frame of the body.

    Attributes:
        spots: Contact targets along the path.
        length_m: Path length [m].
    """

    def __init__(self, spots: Sequence[Spot]) -> None:
        """Interpolate a path from the first of `spots` to the last, over the face of the foam."""
        self.spots = list(spots)
        pieces = [_between(one, other) for one, other in itertools.pairwise(spots)]
        ends = (spots[-1].point_m[None], spots[-1].normal[None])
        self._point_m, self._normal = (np.concatenate(part) for part in zip(*pieces, ends, strict=True))
        steps_m = np.linalg.norm(np.diff(self._point_m, axis=0), axis=1)
        self._way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        self.length_m = float(self._way_m[-1])

    def at(self, way_m: float) -> Spot:
        """Contact target on the path at arc length `way_m` [m]."""
        point_m, normal = (
            np.array([np.interp(way_m, self._way_m, values[:, axis]) for axis in range(3)])
            for values in (self._point_m, self._normal)
        )
        return self.spots[0]._replace(point_m=point_m, normal=normal / np.linalg.norm(normal))


class Stroke:
    """Stroke task of the teacher's script.

    Attributes:
        phase: Motion phase of the finger.
        over: The stroke has ended and the finger is parked.
        truth: Ground truth of the stroke.
    """

    def __init__(
        self,
        finger: Finger,
        foundation: Foundation,
        spec: StrokeSpec,
        sweeps: Sequence[Sweep],
        truth: StrokeTruth,
    ) -> None:
        """Place the finger above the beginning of the first of `sweeps`."""
        self.phase = Phase.APPROACH
        self.over = False
        self.truth = truth
        self._finger, self._foundation, self._spec, self._left = finger, foundation, spec, list(sweeps)
        self._peak_n = np.zeros(len(foundation.surface.body))
        self._left_off = False
        self._way_m, self._height_m = 0.0, spec.approach_m
        self._begin(self._left.pop(0))

    def leave(self, t_ns: int) -> None:
        """Abort the stroke: the finger withdraws."""
        self.phase, self._left_off = Phase.WITHDRAW, True

    def step(self, t_ns: int, step_ns: int) -> None:
        """Move the finger to its pose at `t_ns + step_ns`, given poses and forces at `t_ns` [ns]."""
        step_s, spec, truth = step_ns / NS_PER_S, self._spec, self.truth
        np.maximum(self._peak_n, self._foundation.pressed.force_n.sum(axis=1), out=self._peak_n)
        truth.touched = np.flatnonzero(self._peak_n >= _TOUCHED_N).tolist()
        truth.peak_n = max(truth.peak_n, self._finger.force_n())
        if self.phase is Phase.APPROACH:
            self._height_m = max(self._height_m - spec.speed_m_s * step_s, -spec.depth_m)
            if self._height_m <= -spec.depth_m:
                self.phase = Phase.HOLD
        elif self.phase is Phase.HOLD:
            self._way_m = min(self._way_m + spec.speed_m_s * step_s, self._sweep.length_m)
            if self._way_m >= self._sweep.length_m:
                self.phase = Phase.WITHDRAW
        else:
            self._height_m += spec.speed_m_s * step_s
            if self._height_m >= spec.approach_m:
                self._finish(t_ns)
                return
        self._finger.move(self._finger.line(self._sweep.at(self._way_m)), self._height_m, step_s)

    def _begin(self, sweep: Sweep) -> None:
        self._sweep, self._way_m, self._height_m = sweep, 0.0, self._spec.approach_m
        self.phase = Phase.APPROACH
        self._finger.appear(self._finger.line(sweep.at(0.0)), self._height_m)

    def _finish(self, t_ns: int) -> None:
        """Begin the next sweep, or end the stroke and park the finger."""
        if self._left and not self._left_off:
            self._begin(self._left.pop(0))
            return
        self.truth.end_ns = t_ns
        self.phase, self.over = Phase.PARKED, True
        self._finger.park()


def sweeps_over(spots: Sequence[Spot], side_m: float) -> list[list[Spot]]:
    """Order contact targets of one patch into sweeps (nearest-neighbour tour).

    The tour begins at the cell farthest from the centroid and goes on to the nearest remaining cell, the
    first of equals; where that is no neighbour, another sweep begins.

    Args:
        spots: One on each cell.
        side_m: Side length of a cell [m].
    """
    left, point_m = list(range(len(spots))), np.array([spot.point_m for spot in spots])
    here = _farthest(np.linalg.norm(point_m - point_m.mean(axis=0), axis=1))
    sweeps = [[spots[here]]]
    left.remove(here)
    while left:
        distance_m = np.linalg.norm(point_m[left] - point_m[here], axis=1)
        nearest = _farthest(-distance_m)
        here = left.pop(nearest)
        if distance_m[nearest] > _NEIGHBOURS * pitch_m(side_m):
            sweeps.append([])
        sweeps[-1].append(spots[here])
    return sweeps


def _farthest(values: Floats) -> int:
    """Index of the largest value, the first of those equal up to rounding."""
    return int(np.argmax(values >= values.max() - 1e-6))


def _between(one: Spot, other: Spot) -> tuple[Floats, Floats]:
    """Interpolate points (m, 3) [m] and normals (m, 3) from one spot up to the other, exclusive.

    A cubic Hermite curve with tangents in the faces of the cells; on a cylinder it approximates the arc.
    """
    chord_m = other.point_m - one.point_m
    tangents_m = [chord_m - (chord_m @ spot.normal) * spot.normal for spot in (one, other)]
    start_m, end_m = (t * np.linalg.norm(chord_m) / np.linalg.norm(t) for t in tangents_m)
    t = np.arange(_FINENESS)[:, None] / _FINENESS
    point_m = (
        (2 * t**3 - 3 * t**2 + 1) * one.point_m
        + (t**3 - 2 * t**2 + t) * start_m
        + (3 * t**2 - 2 * t**3) * other.point_m
        + (t**3 - t**2) * end_m
    )
    return point_m, (1 - t) * one.normal + t * other.normal
