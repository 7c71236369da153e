"""Off-screen rendering in a process of its own, since a failing graphics driver may crash its process.

Rendering needs `MUJOCO_GL` before MuJoCo is imported. A renderer is a module that reads a request on
standard input, when it is run, and writes a picture.
"""

import os
import subprocess
import sys
from pathlib import Path

__all__ = ["run_renderer"]

_TIMEOUT_S = 120.0


def run_renderer(module: str, request: bytes, out: Path) -> tuple[Path | None, str]:
    """Run the renderer `module` with `request`, which is to write `out`.

    Returns:
        The file and "", or None and the reason why rendering failed on this computer.
    """
    environment = {"MUJOCO_GL": "egl", **os.environ}
    try:
        done = subprocess.run(
            [sys.executable, "-m", module],
            input=request,
            capture_output=True,
            env=environment,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return None, f"no picture: {error}"
    if done.returncode != 0 or not out.is_file():
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        why = lines[-1] if lines else f"the renderer exited with code {done.returncode}"
        return None, f"no picture (MUJOCO_GL={environment['MUJOCO_GL']}): {why}"
    return out, ""
