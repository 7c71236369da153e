"""Transducer models of cells, from stimulus to readings, vectorised.

Each cell samples once a period at its own phase. Noise depends only on the cell's key and the index of the
sample, so readings do not depend on how cells are distributed over processes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinnet import pinned_math
from skinnet.compilation import compiled
from skinnet.deployment.skin.cells import CellSpec
from skinnet.errors import DeploymentError
from skinnet.protocol.messages import N_FORCE_CHANNELS, READING_NAMES, STIMULUS_NAMES
from skinnet.random_streams import StreamName, standard_normal, stream_key, uniform

__all__ = [
    "STANDARD_GRAVITY_M_S2",
    "ChannelScales",
    "Transducers",
    "channel_scales",
    "noise_keys",
    "phases_ns",
]

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard gravity [m/s²], by definition (CGPM, 1901)."""
_N_CHANNELS = len(READING_NAMES)
_PROXIMITY = STIMULUS_NAMES.index("distance_m")
_TEMPERATURE = STIMULUS_NAMES.index("temperature_c")


def noise_keys(seed: int, patch: str, n: int) -> NDArray[np.uint64]:
    """Return the noise keys (n,) of the cells of `patch`, one random stream per cell."""
    return np.array(
        [stream_key(seed, patch, cell, StreamName.SENSOR_NOISE) for cell in range(n)], dtype=np.uint64
    )


def phases_ns(seed: int, patch: str, n: int, period_ns: int) -> NDArray[np.int64]:
    """Return the sampling phases (n,) [ns] of the cells of `patch` in [0, period_ns); clocks run freely."""
    shares = [
        uniform(stream_key(seed, patch, cell, StreamName.SAMPLING_PHASE), np.uint64(0)) for cell in range(n)
    ]
    return np.array([int(share * period_ns) for share in shares], dtype=np.int64)


class ChannelScales(NamedTuple):
    """Noise, quantisation and range of the channels, each (8,).

    `noise` (standard deviation) and `lsb` are in units of the reading; `lowest` and `highest` are the ends of
    the range in whole steps of `lsb`.
    """

    noise: NDArray[np.float64]
    lsb: NDArray[np.float64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]


class _SensorBank(NamedTuple):
    """Sensors of a set of cells, as compiled code reads them.

    Attributes:
        keys: (n,) noise keys of the cells.
        phase_fraction: (n,) sampling phases, as fractions of the period.
        temperature_c: (n,) temperatures of the sensors [°C], updated; NaN before the first sample.
        calibration: (2, k) forces [N] and readings.
        reference_distance_m: Distance d0 of the proximity law [m].
        scales: Noise, quantisation and range of the channels.
    """

    keys: NDArray[np.uint64]
    phase_fraction: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    calibration: NDArray[np.float64]
    reference_distance_m: float
    scales: ChannelScales


class Transducers:
    """Transducers of a set of cells.

    Force sensors follow a piecewise-linear calibration [M14], proximity the law (d0 / (d0 + d))² (assumed),
    the accelerometer reads ±8 g in steps of 4 mg [T11], temperature is a first-order lag of 2.6 s [T11]. All
    add Gaussian noise, then quantise to the nearest step within the range.
    """

    def __init__(self, spec: CellSpec, cell_keys: NDArray[np.uint64], phases_ns: NDArray[np.int64]) -> None:
        """Create the transducers of n cells from noise keys (n,) and phases (n,) [ns] in [0, period).

        Raises:
            DeploymentError: an invalid calibration or range in `spec`.
        """
        force, proximity = spec.force, spec.proximity
        calibration = _calibration(force.calibration_n, force.calibration_reading)
        if not proximity.reading_at_range < 1.0:
            raise DeploymentError(
                f"cells.proximity.reading_at_range = {proximity.reading_at_range}: must be below 1"
            )
        root = math.sqrt(proximity.reading_at_range)
        self._period_ns = spec.period_ns
        self._lag_rate = spec.period_ns * 1e-9 / spec.temperature.time_constant_s
        self._phases_ns = np.array(phases_ns, dtype=np.int64)
        n = len(cell_keys)
        self._sensors = _SensorBank(
            keys=np.array(cell_keys, dtype=np.uint64),
            phase_fraction=self._phases_ns / spec.period_ns,
            temperature_c=np.full(n, math.nan),
            calibration=calibration,
            reference_distance_m=proximity.range_m * root / (1.0 - root),
            scales=channel_scales(spec),
        )
        self._before, self._after = np.empty((n, _N_CHANNELS)), np.empty((n, _N_CHANNELS))
        self._period_index = -1

    def sample_times_ns(self, period_index: int) -> NDArray[np.int64]:
        """Return the sampling times (n,) [ns] of the cells in period `period_index`."""
        return period_index * self._period_ns + self._phases_ns

    def sample(
        self,
        period_index: int,
        before: NDArray[np.floating],
        after: NDArray[np.floating],
        out: NDArray[np.float32],
    ) -> None:
        """Sample all cells in period `period_index` and write their readings into `out`.

        Args:
            period_index: Index of the period; it increases from call to call, and may skip.
            before: Stimulus (n, 8) in `STIMULUS_NAMES` order at the start of the period.
            after: Stimulus (n, 8) at its end. In between, forces, accelerations and temperatures are linear
                in time, and so is the *reading* of proximity (a distance may be inf).
            out: Readings (n, 8) float32 in `READING_NAMES` order.
        """
        assert period_index > self._period_index, f"frame {period_index} after frame {self._period_index}"
        assert before.shape == after.shape == out.shape == self._before.shape
        # copies, so that any dtype and read-only arrays use one compiled signature
        np.copyto(self._before, before)
        np.copyto(self._after, after)
        warming = -pinned_math.expm1(-self._lag_rate * (period_index - self._period_index))
        self._period_index = period_index
        _sample(self._before, self._after, period_index, warming, self._sensors, out)

    def reset(self, cells: NDArray[np.int64]) -> None:
        """Reset `cells` after a power cycle: their temperature sensors start at ambient temperature."""
        self._sensors.temperature_c[cells] = math.nan


def _calibration(force_n: tuple[float, ...], reading: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the force calibration as a table (2, k) of forces [N] and readings.

    Raises:
        DeploymentError: fewer than two points, forces that do not rise or readings that fall.
    """
    table = [list(force_n), list(reading)]
    if (
        len(force_n) != len(reading)
        or len(force_n) < 2
        or not np.isfinite(table).all()
        or np.any(np.diff(table[0]) <= 0.0)
        or np.any(np.diff(table[1]) < 0.0)
    ):
        raise DeploymentError(
            f"cells.force.calibration_n = {table[0]}, calibration_reading = {table[1]}: needs two or more "
            "points, strictly increasing forces and non-decreasing readings"
        )
    return np.array(table)


def channel_scales(spec: CellSpec) -> ChannelScales:
    """Return noise, quantisation and range of a cell's channels, in `READING_NAMES` order.

    Raises:
        DeploymentError: an empty range.
    """
    force, proximity = spec.force, spec.proximity
    acceleration, temperature = spec.accelerometer, spec.temperature
    channels = (
        (force.noise, force.lsb, 0.0, 1.0, N_FORCE_CHANNELS),
        (proximity.noise, proximity.lsb, 0.0, 1.0, 1),
        (acceleration.noise_g, acceleration.lsb_g, -acceleration.range_g, acceleration.range_g, 3),
        (temperature.noise_c, temperature.lsb_c, temperature.min_c, temperature.max_c, 1),
    )
    noise, lsb, low, high = np.repeat([c[:4] for c in channels], [c[4] for c in channels], axis=0).T
    if np.any(low >= high):
        raise DeploymentError(
            f"cells: the minimum of each sensor's range must be below its maximum; got {low.tolist()} to "
            f"{high.tolist()}"
        )
    # the tolerance keeps an end that is a whole number of steps; + 0.0 turns -0.0 into 0.0
    return ChannelScales(
        noise.copy(), lsb.copy(), np.ceil(low / lsb - 1e-9) + 0.0, np.floor(high / lsb + 1e-9)
    )


@compiled
def _force_reading(force_n: float, calibration: NDArray[np.float64]) -> float:
    """Return the force reading on the piecewise-linear calibration, extrapolated, clipped to [0, 1]."""
    last = calibration.shape[1] - 2
    segment = 0
    while segment < last and force_n >= calibration[0, segment + 1]:
        segment += 1
    width_n = calibration[0, segment + 1] - calibration[0, segment]
    slope = (calibration[1, segment + 1] - calibration[1, segment]) / width_n
    reading: float = calibration[1, segment] + slope * (force_n - calibration[0, segment])
    return min(max(reading, 0.0), 1.0)


@compiled
def _proximity_reading(distance_m: float, reference_distance_m: float) -> float:
    """Return the proximity reading at a distance [m]: 1 at contact, 0 at infinity."""
    share = reference_distance_m / (reference_distance_m + max(distance_m, 0.0))
    return share * share


@compiled
def _sample(
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    period_index: int,
    lag_gain: float,
    sensors: _SensorBank,
    out: NDArray[np.float32],
) -> None:
    noise, lsb, lowest, highest = sensors.scales
    sensor_temperature_c, calibration = sensors.temperature_c, sensors.calibration
    for cell in range(out.shape[0]):
        for channel in range(_N_CHANNELS):
            start, end = before[cell, channel], after[cell, channel]
            if channel == _PROXIMITY:
                start = _proximity_reading(start, sensors.reference_distance_m)
                end = _proximity_reading(end, sensors.reference_distance_m)
            value = start + sensors.phase_fraction[cell] * (end - start)
            if channel < _PROXIMITY:
                value = _force_reading(value, calibration)
            elif channel == _TEMPERATURE:
                if math.isnan(sensor_temperature_c[cell]):
                    sensor_temperature_c[cell] = value  # ambient temperature at power-up
                sensor_temperature_c[cell] += lag_gain * (value - sensor_temperature_c[cell])
                value = sensor_temperature_c[cell]
            elif channel > _PROXIMITY:
                value /= STANDARD_GRAVITY_M_S2
            if noise[channel] > 0.0:
                value += noise[channel] * standard_normal(
                    sensors.keys[cell], np.uint64(period_index * _N_CHANNELS + channel)
                )
            steps = np.floor(value / lsb[channel] + 0.5)
            if not steps > lowest[channel]:  # also for a NaN stimulus
                steps = lowest[channel]
            out[cell, channel] = lsb[channel] * min(steps, highest[channel])
