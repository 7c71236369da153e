"""What a run ran with: versions of the program and of what it stands on, and the machine's kind."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from skinnet import __version__

__all__ = ["environment"]

_PACKAGES = ("numpy", "scipy", "numba", "mujoco", "eclipse-zenoh", "msgspec", "matplotlib")


def environment() -> dict[str, Any]:
    """Versions by name, the platform, and how many cores there were to run on."""
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
