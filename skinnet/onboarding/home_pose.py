"""Home pose of a robot: a keyframe if one will do, else a search.

Wanted are axes away from gravity, since accelerometers do not see a turn about gravity, room for the steps of
an exploration within the limits, and links that do not touch. The search goes from joint to joint and takes
the best of a few positions of each, as long as that helps; a start from elsewhere follows if it ends badly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinnet.onboarding.pose_faults import PoseFaults, PoseJudge
from skinnet.onboarding.robot_survey import RobotSurvey
from skinnet.random_streams import StreamName, generator

__all__ = ["HomePose", "find_home"]

Floats = NDArray[np.float64]

_CANDIDATES = 9
"""Positions of each joint that are tried."""
_REACH = 2.2
"""Greatest distance of a candidate from the start [rad or m]."""
_SWEEPS = 4
_RESTARTS = 6
_DIGITS = 3


@dataclass(frozen=True)
class HomePose:
    """Home pose of a robot.

    Attributes:
        position: Position of each controlled joint, by id [rad or m].
        source: Where it comes from, as text.
        rejected: Keyframes that would not do, each with the reason.
        faults: What is still wrong with it.
    """

    position: dict[int, float]
    source: str
    rejected: tuple[str, ...]
    faults: PoseFaults


def find_home(survey: RobotSurvey) -> HomePose:
    """Find the home pose of a robot: the first keyframe without faults, else the best pose of a search."""
    judge = PoseJudge(survey)
    keyframes = [_keyframe(survey, judge, key) for key in range(survey.mj.nkey)]
    rejected: list[str] = []
    for name, position in keyframes:
        faults = judge.faults(position)
        if not faults.avoidable:
            return HomePose(judge.positions(position), f"keyframe {name}", tuple(rejected), faults)
        rejected.append(f"keyframe {name}: {'; '.join(faults.avoidable)}")
    start = keyframes[0][1] if keyframes else judge.clipped(judge.reference)
    position, source = _search(judge, judge.clipped(start)), "search"
    faults = judge.faults(position)
    for name, at in keyframes:  # the search may end no better than where the file's author stands
        there = judge.faults(at)
        if len(there.avoidable) <= len(faults.avoidable) and not there.outside:
            position, source, faults = at, f"keyframe {name}, as no better pose was found", there
            break
    return HomePose(judge.positions(position), source, tuple(rejected), faults)


def _keyframe(survey: RobotSurvey, judge: PoseJudge, key: int) -> tuple[str, Floats]:
    name = survey.mj.key(key).name
    position = np.round(survey.mj.key_qpos[key][judge.qpos_address], _DIGITS)
    return f'"{name}"' if name else str(key), position


def _search(judge: PoseJudge, start: Floats) -> Floats:
    best, least = _descend(judge, start, start)
    random = generator(0, StreamName.HOME_POSE)
    for _ in range(_RESTARTS):
        if not judge.faults(best).avoidable:
            break
        from_there = judge.low + random.random(len(start)) * (judge.high - judge.low)
        found, cost = _descend(judge, judge.clipped(np.round(from_there, _DIGITS)), start)
        if cost < least:
            best, least = found, cost
    return best


def _descend(judge: PoseJudge, position: Floats, start: Floats) -> tuple[Floats, float]:
    """Best pose by changes of one joint at a time, and its cost; `start` is what it stays near to."""
    position = position.copy()
    least = judge.cost(position, start)
    for _ in range(_SWEEPS):
        before = least
        for joint in range(len(position)):
            kept = position[joint]
            for value in _candidates(judge.low[joint], judge.high[joint], start[joint]):
                position[joint] = value
                cost = judge.cost(position, start)
                if cost < least - 1e-6:
                    kept, least = value, cost
            position[joint] = kept
        if least > before - 1e-6:
            break
    return position, least


def _candidates(low: float, high: float, start: float) -> Floats:
    lowest, highest = max(low, start - _REACH), min(high, start + _REACH)
    values: Floats = np.round(np.linspace(lowest, highest, _CANDIDATES), _DIGITS)
    return values
