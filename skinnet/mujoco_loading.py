"""Import of MuJoCo on computers without the renderer that `MUJOCO_GL` asks for.

MuJoCo loads its renderer when it is imported, and fails with it; only pictures need one.
"""

import importlib
import os

__all__ = ["load_mujoco"]

_VARIABLE = "MUJOCO_GL"


def load_mujoco() -> None:
    """Import MuJoCo, without a renderer if that of `MUJOCO_GL` is unknown or cannot be loaded."""
    try:
        importlib.import_module("mujoco")
    except (RuntimeError, ImportError, OSError, AttributeError):
        wanted = os.environ.get(_VARIABLE)
        if wanted is None:
            raise
        os.environ[_VARIABLE] = "disable"
        try:
            importlib.import_module("mujoco")
        finally:
            os.environ[_VARIABLE] = wanted


load_mujoco()
