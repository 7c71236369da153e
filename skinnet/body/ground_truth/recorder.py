"""Ground-truth recorder of a body: contact onsets, forces, teaching, grasp and payload, merged once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.body.ground_truth.contact_onsets import PeakForceTrace, reaction_crossing_detector
from skinnet.body.ground_truth.grasp_outcome import GraspGroundTruth
from skinnet.body.ground_truth.motion_onset import MotionOnsets
from skinnet.body.ground_truth.payload_outcome import PayloadGroundTruth
from skinnet.body.ground_truth.teaching_outcome import TeachingOutcome
from skinnet.body.ground_truth.unsensed_force import UnsensedForce
from skinnet.body.plant import GroundTruth
from skinnet.deployment.deployment import Deployment

__all__ = ["GroundTruthRecorder"]

Floats = NDArray[np.float64]


class GroundTruthRecorder:
    """Recorder of all ground truth of a body.

    Attributes:
        crossings: Crossings of the reaction thresholds of the program's stages.
        force_trace: Largest forces on force cells.
        motion: Onsets of commanded motion.
        teaching: Tasks of the teacher, which fills them in.
        grasp: Motion and contacts of object and stand, if there is a stand.
        payload: Motion of the payload, if there is one.
        unsensed: Load on the rigid shell under skin, if there is a shell.
    """

    def __init__(
        self,
        deployment: Deployment,
        force_period_ns: int,
        *,
        teaching: TeachingOutcome | None = None,
        grasp: GraspGroundTruth | None = None,
        payload: PayloadGroundTruth | None = None,
        unsensed: UnsensedForce | None = None,
    ) -> None:
        """Initialise empty records; peak forces have the period `force_period_ns` [ns]."""
        self.crossings = reaction_crossing_detector(deployment.controller.stages.values(), deployment.cells)
        self.force_trace = PeakForceTrace(force_period_ns)
        self.motion = MotionOnsets()
        self.teaching = TeachingOutcome() if teaching is None else teaching
        self.grasp, self.payload, self.unsensed = grasp, payload, unsensed

    def begin_stage(self, name: str) -> None:
        """Begin stage `name` of the controller's program."""
        self.force_trace.begin_stage(name)
        if self.grasp is not None:
            self.grasp.begin_stage(name)

    def record(self, t_ns: int, step_s: float, peak_force_n: float) -> None:
        """Record the state at `t_ns` [ns], which counts for `step_s` [s]; `peak_force_n` on a force cell."""
        self.force_trace.observe(t_ns, peak_force_n)
        if self.grasp is not None:
            self.grasp.record(t_ns, step_s)

    def ground_truth(self, refused_commands: int) -> GroundTruth:
        """Merge facts and arrays of all records, with the number of refused commands."""
        facts: dict[str, Any] = {
            **self.teaching.facts(),
            "threshold_crossings": self.crossings.facts(),
            "motion_onsets": self.motion.facts(),
            "refused_commands": refused_commands,
            "peak_force_by_stage_n": self.force_trace.by_stage_n,
        }
        arrays = self.force_trace.arrays()
        if self.unsensed is not None:
            facts["unsensed_force"] = self.unsensed.facts()
        if self.payload is not None:
            facts["payload"] = self.payload.facts()
            arrays |= self.payload.arrays()
        if self.grasp is not None:
            facts |= self.grasp.facts()
            arrays |= self.grasp.arrays()
        return GroundTruth(facts, arrays)
