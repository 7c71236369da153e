"""Pressure transducers of tactile sheets: from pressure to readings, vectorised over all boards.

A board scans its elements (taxels) sequentially, so each has its own sampling time within the frame. Clocks
of boards are free-running: each board begins its scan at its own phase. Noise depends only on the board's
name, the element and the frame.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cells.sensing.transducers import noise_keys
from skinnet.compilation import compiled
from skinnet.deployment.skin.sheets import BoardSpec
from skinnet.deployment.types import ns_of_ms
from skinnet.errors import DeploymentError
from skinnet.random_streams import StreamName, standard_normal, stream_key, uniform
from skinnet.skin.tactile_sheets import PlacedSheet

__all__ = ["PressureTransducers"]


class _Elements(NamedTuple):
    """Elements of all boards: sampling phases in the frame, noise keys, noise and quantisation [kPa]."""

    sample_fraction: NDArray[np.float64]
    keys: NDArray[np.uint64]
    noise_kpa: float
    lsb_kpa: float
    max_steps: float


class PressureTransducers:
    """Pressure elements of a set of boards.

    A reading is the pressure with Gaussian noise, quantised to 2^bits steps over the range.

    Attributes:
        sample_offset_ns: (n,) time after the start of the frame at which each element is read [ns].
        scan_end_ns: (boards,) time after the start of the frame at which each scan ends [ns].
    """

    def __init__(self, sheets: Sequence[PlacedSheet], spec: BoardSpec, seed: int) -> None:
        """Create the elements of `sheets`, board after board.

        Raises:
            DeploymentError: a scan takes longer than a period.
        """
        element_ns = ns_of_ms(spec.pressure.element_read_us * 1e-3)
        self.scan_end_ns = np.zeros(len(sheets), dtype=np.int64)
        sampled_ns = []
        for b, sheet in enumerate(sheets):
            spare_ns = spec.period_ns - sheet.n_elements * element_ns
            if spare_ns < 0:
                raise DeploymentError(
                    f"sheets.{sheet.name}: {sheet.n_elements} elements of {spec.pressure.element_read_us} µs "
                    f"each take longer than the period of {spec.period_ms} ms; lower element_read_us"
                )
            begin_ns = int(
                uniform(stream_key(seed, sheet.name, StreamName.SAMPLING_PHASE), np.uint64(0)) * spare_ns
            )
            sampled_ns.append(begin_ns + element_ns * np.arange(1, sheet.n_elements + 1))
            self.scan_end_ns[b] = sampled_ns[-1][-1]
        self.sample_offset_ns = np.concatenate(sampled_ns)
        self._elements = _Elements(
            sample_fraction=self.sample_offset_ns / spec.period_ns,
            keys=np.concatenate([noise_keys(seed, sheet.name, sheet.n_elements) for sheet in sheets]),
            noise_kpa=float(spec.pressure.noise_kpa),
            lsb_kpa=float(spec.pressure.lsb_kpa),
            max_steps=float(2**spec.pressure.bits - 1),
        )
        self._before_kpa, self._after_kpa = np.empty((2, len(self._elements.keys)))

    def scan(
        self,
        frame: int,
        before_kpa: NDArray[np.floating],
        after_kpa: NDArray[np.floating],
        out: NDArray[np.float64],
    ) -> None:
        """Scan all boards in one frame and write the readings into `out`.

        Args:
            frame: Index of the scan frame, which spans [frame, frame + 1) periods.
            before_kpa: (n,) pressures at its start [kPa]; in between they are linear in time.
            after_kpa: (n,) pressures at its end [kPa].
            out: (n,) readings [kPa].
        """
        assert before_kpa.shape == after_kpa.shape == out.shape == self._before_kpa.shape
        # copies, so that any dtype and read-only arrays use one compiled signature
        np.copyto(self._before_kpa, before_kpa)
        np.copyto(self._after_kpa, after_kpa)
        _scan(self._before_kpa, self._after_kpa, frame, self._elements, out)


@compiled
def _scan(
    before_kpa: NDArray[np.float64],
    after_kpa: NDArray[np.float64],
    frame: int,
    elements: _Elements,
    out: NDArray[np.float64],
) -> None:
    noise_kpa, lsb_kpa = elements.noise_kpa, elements.lsb_kpa
    for i in range(out.size):
        value = before_kpa[i] + elements.sample_fraction[i] * (after_kpa[i] - before_kpa[i])
        if noise_kpa > 0.0:
            value += noise_kpa * standard_normal(elements.keys[i], np.uint64(frame))
        steps = np.floor(value / lsb_kpa + 0.5)
        if not steps > 0.0:  # also for a NaN pressure
            steps = 0.0
        out[i] = lsb_kpa * min(steps, elements.max_steps)
