"""Fingerprint of a computer's arithmetic: results of two runs are the same bit for bit only if it is.

Noise, sensors, encoders and network use pinned functions (`skinnet.pinned_math`). MuJoCo calls `sin`, `cos`,
`exp` and `atan2` of the C library, which chooses them by the CPU's instruction set, and small matrix products
and solutions come from a BLAS that chooses its kernel by the CPU as well.
"""

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from skinnet import pinned_math
from skinnet.body.arithmetic import roll_out
from skinnet.random_streams import standard_normal

__all__ = ["arithmetic", "battery_of_functions", "compare_arithmetic"]


def battery_of_functions() -> str:
    """Return the SHA-256 of fixed evaluations of the pinned functions and the noise: the same everywhere."""
    x = np.linspace(-20.0, 20.0, 4001).tolist()
    functions = (pinned_math.sin, pinned_math.cos, pinned_math.exp, pinned_math.expm1)
    values = [function(v) for function in functions for v in x]
    values += [pinned_math.log(abs(v) + 1e-9) for v in x]
    values += [standard_normal(np.uint64(7), np.uint64(i)) for i in range(1000)]
    return hashlib.sha256(np.array(values).tobytes()).hexdigest()


@cache
def arithmetic() -> dict[str, str]:
    """Return the first 16 digits of the SHA-256 of fixed evaluations, by part: `functions`, `blas`, `mujoco`.

    `all` covers them with the machine and the versions of NumPy and Numba: equal ones give equal logs.
    """
    square = np.random.default_rng(1).standard_normal((12, 12))
    products = (
        square @ square,
        square[:3, :3] @ square[3:6, 3:6],
        square @ square[0],
        np.linalg.solve(square, square @ square.T),
    )
    parts = {
        "functions": battery_of_functions(),
        "blas": hashlib.sha256(b"".join(product.tobytes() for product in products)).hexdigest(),
        "mujoco": hashlib.sha256(roll_out()).hexdigest(),
    }
    whole = repr((sorted(parts.items()), platform.machine(), version("numpy"), version("numba")))
    parts["all"] = hashlib.sha256(whole.encode()).hexdigest()
    return {name: digest[:16] for name, digest in parts.items()}


def compare_arithmetic(one: dict[str, Any], other: dict[str, Any]) -> str:
    """Return why the hashes of two summaries cannot be compared; empty if they can, or if one is older.

    Args:
        one: Content of a `summary.json`.
        other: Content of another.
    """
    mine, theirs = one.get("arithmetic"), other.get("arithmetic")
    if not mine or not theirs or mine["all"] == theirs["all"]:
        return ""
    parts = [part for part in ("functions", "blas", "mujoco") if mine[part] != theirs[part]]
    return (
        f"computed with another arithmetic ({', '.join(parts) or 'versions'}): values may differ in their "
        "last bits, and hashes cannot be compared"
    )
