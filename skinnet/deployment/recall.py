"""Memory loading: from the file named by a deployment, with a check of the robot."""

from pathlib import Path

from skinnet.deployment.schema import Deployment
from skinnet.errors import MemoryFileError
from skinnet.memory.exchange import from_json
from skinnet.memory.record import Floats, Memory, Robot, check_limits
from skinnet.memory.store import read_memory

__all__ = ["read_json", "recall", "require_fit", "robot_of"]


def robot_of(deployment: Deployment) -> Robot:
    """Describe the robot of a deployment: name, joints and number of cells per patch."""
    patches = {patch.name: patch.n_cells for patch in deployment.patches}
    return Robot(deployment.robot, deployment.body.joints, patches)


def recall(deployment: Deployment, base: Path, range_rad: Floats | None = None) -> Memory | None:
    """Load the memory for the start of a run; None if the deployment names no file.

    Args:
        deployment: Deployment to be run.
        base: Folder of the deployment.
        range_rad: (D, 2) joint limits [rad], against which key poses are checked; no check without.

    Raises:
        MemoryFileError: the file does not exist, is invalid, or belongs to another robot.
    """
    if deployment.memory.read is None:
        return None
    path = base / deployment.memory.read
    memory = read_json(path) if path.suffix == ".json" else read_memory(path)
    try:
        require_fit(memory, deployment, range_rad)
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None
    return memory


def read_json(path: Path) -> Memory:
    """Read a memory from the JSON of `skinnet memory export`.

    Raises:
        MemoryFileError: the file does not exist or is invalid.
    """
    try:
        return from_json(path.read_bytes())
    except FileNotFoundError:
        raise MemoryFileError(f"{path}: there is no such file") from None
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None


def require_fit(memory: Memory, deployment: Deployment, range_rad: Floats | None = None) -> None:
    """Check that a memory belongs to the robot and that its key poses are within the joint limits.

    Raises:
        MemoryFileError: names the difference, or the pose and the joint.
    """
    memory.robot.require_same(robot_of(deployment))
    if range_rad is not None:
        check_limits(memory, range_rad)
