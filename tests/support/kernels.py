"""Program: compile what most tests need, so that no two of their processes compile it at once.

`make test` runs it beside the check of types, which takes one core: a run of cells, one of sheets, and a
covering.
"""

import sys
import tempfile
from pathlib import Path

from launching import run, skinnet
from link_models import write_two_links
from locations import DEPLOYMENTS

FEW = '[[cover]]\nname = "skin"\nbody = ["upper", "fore"]\nmax_cells = 6\n'


def compile_kernels(folder: Path) -> None:
    """Run two shipped deployments for a moment and cover a robot of two links."""
    for name in ("two_link_arm", "riba_cylinder"):
        run(DEPLOYMENTS / f"{name}.toml", folder / name, "--in-process", settings=("run.max_s=0.02",))
    cache = {"XDG_CACHE_HOME": str(folder / "coverings")}  # that of compiled code is chosen already
    done = skinnet("cover", str(write_two_links(folder, FEW)), **cache)
    assert done.returncode == 0, done.stderr


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        compile_kernels(Path(folder))
    sys.stdout.write("kernels compiled\n")
