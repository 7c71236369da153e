"""The one way in which this project compiles: Numba, cached on disk, exact IEEE arithmetic.

`fastmath` stays off: it lets the compiler reorder sums, and then one process and many would no
longer give the same log.
"""

from collections.abc import Callable
from typing import TypeVar

import numba

__all__ = ["compiled"]

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compiles `function` on first use and keeps the machine code in the cache beside the module."""
    result: F = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return result
