"""The teacher observes the arm on a time grid of its own, not on that of the physics steps."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from skinnet.body.teacher.finger import ApproachLine
from skinnet.body.teacher.finger_task import FingerPhase
from skinnet.body.teacher.lesson_touch import LessonTouchServo

MS = 1_000_000
LINE = ApproachLine(np.zeros(3), np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("step_ms", [0.5, 1.0, 2.0, 3.0, 7.0])
def test_the_arm_is_observed_fifty_times_a_second_whatever_the_step(step_ms: float) -> None:
    observed_ms: list[float] = []
    t_ns, step_ns = 0, round(step_ms * MS)

    def usable_height_m(_line: ApproachLine) -> float:
        observed_ms.append(t_ns / MS)
        return 0.02

    lesson: Any = SimpleNamespace(
        usable_height_m=usable_height_m, evasion=SimpleNamespace(position_rad=lambda: np.zeros(1))
    )
    servo = LessonTouchServo(cast(Any, lesson), 0, np.zeros(1, dtype=np.int64), 0.02, 0)
    for k in range(round(1000 / step_ms)):
        t_ns = k * step_ns
        servo.update(FingerPhase.WITHDRAW, LINE, 0.01, t_ns)
    assert len(observed_ms) == 50
    late_ms = np.array(observed_ms) - 20.0 * np.arange(50)
    assert (late_ms >= 0.0).all()
    assert (late_ms < step_ms).all()
