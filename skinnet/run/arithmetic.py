"""Fingerprint of a computer's arithmetic: results of two runs are the same bit for bit only if it is.

Noise, sensors, encoders, network and controllers use pinned functions (`skinnet.pinned_math`, `pinned_arcs`,
`pinned_linalg`). MuJoCo calls `sin`, `cos`, `exp` and `atan2` of the C library, which chooses them by the
CPU's instruction set. The power grid and the optional quadratic programme of nursing call a BLAS that chooses
its kernel by the CPU as well. The fingerprint of a run covers the parts that it uses.
"""

import hashlib
import platform
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinnet.body.arithmetic import roll_out
from skinnet.compilation import compiled
from skinnet.deployment import Deployment
from skinnet.pinned_arcs import acos, asin, atan2
from skinnet.pinned_math import cos, exp, exp2, expm1, hypot, log, log1p, log2, sin
from skinnet.random_streams import standard_normal

__all__ = ["PARTS", "arithmetic", "battery_of_functions", "compare_arithmetic", "used_parts"]

PARTS = ("functions", "mujoco")
"""Parts that the arithmetic of every simulated body has; see `used_parts`."""
_ALL_PARTS = (*PARTS, "blas", "versions")
_N = 400


@compiled
def _evaluate() -> NDArray[np.float64]:
    """Return values of all pinned functions, and of the noise; one function, so that it is loaded fast."""
    values = np.empty((13, _N))
    for i in range(_N):
        x = -20.0 + 40.0 * i / _N + 0.017
        share = x / 20.1
        values[0, i], values[1, i], values[2, i], values[3, i] = sin(x), cos(x), exp(x), expm1(x)
        values[4, i], values[5, i], values[6, i] = log(abs(x)), log1p(share), log2(abs(x))
        values[7, i], values[8, i], values[9, i] = exp2(x), asin(share), acos(share)
        values[10, i], values[11, i] = atan2(share, 0.3 - x), hypot(x, 1.0 + share)
        values[12, i] = standard_normal(np.uint64(7), np.uint64(i))
    return values


def battery_of_functions() -> str:
    """Return the SHA-256 of fixed evaluations of the pinned functions and the noise: the same everywhere."""
    return hashlib.sha256(_evaluate().tobytes()).hexdigest()


def used_parts(deployment: Deployment) -> tuple[str, ...]:
    """Return the parts on which the log of a run of `deployment` depends, beside the versions.

    A scripted body does not use MuJoCo; the pinned functions are everywhere.
    """
    nursing = deployment.nursing
    with_blas = deployment.power is not None or (nursing is not None and nursing.solver != "closed_form")
    return (
        "functions",
        *(("mujoco",) if deployment.scripted_stimuli is None else ()),
        *(("blas",) if with_blas else ()),
    )


@cache
def arithmetic(parts: Sequence[str] = PARTS) -> dict[str, str]:
    """Return the first 16 digits of the SHA-256 of fixed evaluations, by part.

    `versions` is that of the machine and of NumPy and Numba. `all` covers everything: equal ones give equal
    logs.

    Args:
        parts: Some of `functions`, `mujoco` and `blas`, as a tuple.
    """
    samples: dict[str, Callable[[], bytes]] = {
        "functions": lambda: _evaluate().tobytes(),
        "mujoco": roll_out,
        "blas": _products,
        "versions": lambda: repr((platform.machine(), version("numpy"), version("numba"))).encode(),
    }
    digests = {part: hashlib.sha256(samples[part]()).hexdigest() for part in (*parts, "versions")}
    digests["all"] = hashlib.sha256(repr(sorted(digests.items())).encode()).hexdigest()
    return {name: digest[:16] for name, digest in digests.items()}


def _products() -> bytes:
    square = np.sin(np.arange(144.0)).round(6).reshape(12, 12)
    products = (
        square @ square,
        square[:3, :3] @ square[3:6, 3:6],
        square @ square[0],
        np.linalg.solve(square + 20.0 * np.eye(12), square @ square.T),
    )
    return b"".join(product.tobytes() for product in products)


def compare_arithmetic(one: dict[str, Any], other: dict[str, Any]) -> str:
    """Return why the hashes of two summaries cannot be compared; empty if they can, or if one is older.

    Args:
        one: Content of a `summary.json`.
        other: Content of another.
    """
    mine, theirs = one.get("arithmetic") or {}, other.get("arithmetic") or {}
    parts = [part for part in _ALL_PARTS if part in mine and part in theirs and mine[part] != theirs[part]]
    if not parts:
        return ""
    return (
        f"computed with another arithmetic ({', '.join(parts)}): values may differ in their last bits, and "
        "hashes cannot be compared"
    )
