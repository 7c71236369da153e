"""Import of MuJoCo with the renderer that `MUJOCO_GL` asks for, where this computer has it.

MuJoCo loads its renderer when it is imported, and fails with it; only pictures need one. Without the variable
it would load GLFW, which starts a Python of its own in each process; pictures are drawn in processes that ask
for EGL.
"""

import importlib
import os

__all__ = ["load_mujoco"]

_VARIABLE = "MUJOCO_GL"


def load_mujoco() -> None:
    """Import MuJoCo, without a renderer if that of `MUJOCO_GL` is unset, unknown or cannot be loaded."""
    wanted = os.environ.get(_VARIABLE)
    if wanted is not None:
        try:
            importlib.import_module("mujoco")
        except (RuntimeError, ImportError, OSError, AttributeError):
            pass
        else:
            return
    os.environ[_VARIABLE] = "disable"
    try:
        importlib.import_module("mujoco")
    finally:
        if wanted is None:
            del os.environ[_VARIABLE]
        else:
            os.environ[_VARIABLE] = wanted


load_mujoco()
