"""Software environment of a run: package versions, platform, cores."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from skinnet import __version__

__all__ = ["environment"]

_PACKAGES = ("numpy", "scipy", "numba", "mujoco", "eclipse-zenoh", "msgspec", "matplotlib")


def environment() -> dict[str, Any]:
    """Return package versions by name, the platform, and the number of usable cores."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "skinnet": __version__,
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        **{name: _version(name) for name in _PACKAGES},
        "platform": platform.platform(),
        "cores": cores,
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
