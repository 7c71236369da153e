"""Findings on servos at home, by linear dynamics: too slow for the map, or giving way to a load."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from skinnet.body.servo_response import (
    MAX_SAG_HOME,
    MAX_SAG_PUSHED,
    MIN_FREQUENCY_HZ,
    ServoResponse,
    servo_response,
)
from skinnet.body.simulation import BodySimulation
from skinnet.deployment import Deployment
from skinnet.diagnosis.finding import Finding, listed

__all__ = ["servo_findings"]

_M_PER_MM = 1e-3


def servo_findings(deployment: Deployment, body: BodySimulation) -> list[Finding]:
    """Findings on the servos of the controlled joints; of several joints with one fault, one finding."""
    compensated = bool(deployment.body.servo.gravity_compensation)
    response = servo_response(body.model, is_compensated=compensated)
    return [*_slow(deployment, response), *_overloaded(response), *_sagging(response), *_yielding(response)]


def _slow(deployment: Deployment, response: ServoResponse) -> Iterable[Finding]:
    """Servos below twice the frequency of the map, whose joints lag behind its sine."""
    slow = response.frequency_hz < MIN_FREQUENCY_HZ * (1.0 - 1e-9)
    if slow.any():
        stages = deployment.controller.stages
        maps = any(stages[name].kind == "map" for name in deployment.controller.program)
        yield Finding(
            "warning" if maps else "remark",
            "servo_slow",
            _joints(response, slow),
            f"servo frequency below {MIN_FREQUENCY_HZ:g} Hz, down to "
            f"{response.frequency_hz[slow].min():.2g} Hz: the joint lags behind the sine of the map",
            "set body.servo.frequency_hz = 12, or for single joints under body.joint_servos",
        )


def _overloaded(response: ServoResponse) -> Iterable[Finding]:
    overloaded = np.isinf(response.sag_home_rad)
    if overloaded.any():
        most_nm = float(np.abs(response.load_nm[overloaded]).max())
        yield Finding(
            "error",
            "servo_overloaded",
            _joints(response, overloaded),
            f"the load at home, up to {most_nm:.3g} Nm (N), is beyond the torque of its servo",
            "raise body.servo.torque_limit_nm (or actuatorfrcrange in the model), or choose another home",
        )


def _sagging(response: ServoResponse) -> Iterable[Finding]:
    sag = response.sag_home_rad
    sagging = np.isfinite(sag) & (sag > MAX_SAG_HOME)
    if sagging.any():
        yield Finding(
            "warning",
            "servo_sags",
            _joints(response, sagging),
            f"rests up to {sag[sagging].max() / _M_PER_MM:.2g} mrad (mm) off home under its load",
            "set body.servo.gravity_compensation = true, or stiffer servos",
        )


def _yielding(response: ServoResponse) -> Iterable[Finding]:
    pushed = response.sag_pushed_rad
    yields = (pushed > MAX_SAG_PUSHED) & np.isfinite(response.sag_home_rad)
    if yields.any():
        most = float(pushed[yields].max())
        text = "beyond its torque" if np.isinf(most) else f"up to {most / _M_PER_MM:.3g} mrad (mm)"
        yield Finding(
            "warning",
            "servo_yields",
            _joints(response, yields),
            f"10 N on its link turn it by more than {MAX_SAG_PUSHED / _M_PER_MM:g} mrad (mm), {text}",
            "set a higher body.servo.frequency_hz or torque_limit_nm, if the skin is to be pushed there",
        )


def _joints(response: ServoResponse, which: NDArray[np.bool_]) -> str:
    names = [name for name, is_one in zip(response.joints, which.tolist(), strict=True) if is_one]
    return f"joint{'s' if len(names) > 1 else ''} {listed(names)}"
