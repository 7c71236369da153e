"""What the robot of a deployment remembers: from the file that the deployment names."""

from pathlib import Path

from skinnet.deployment.schema import Deployment
from skinnet.errors import MemoryFileError
from skinnet.memory.exchange import from_json
from skinnet.memory.record import Floats, Memory, Robot, check_limits
from skinnet.memory.store import read_memory

__all__ = ["read_json", "recall", "require_fit", "robot_of"]


def robot_of(deployment: Deployment) -> Robot:
    """The robot that a memory must be of: its cells are those of the patches."""
    patches = {patch.name: patch.n_cells for patch in deployment.patches}
    return Robot(deployment.robot, deployment.body.joints, patches)


def recall(deployment: Deployment, base: Path, range_rad: Floats | None = None) -> Memory | None:
    """What the robot knows at the start of a run; None if the deployment names no file.

    Args:
        deployment: What is run.
        base: Its folder.
        range_rad: (D, 2) limits of the joints, to compare key poses with; not compared without.

    Raises:
        MemoryFileError: there is no such file, it does not hold, or it does not fit the robot.
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
    """What `skinnet memory export` wrote.

    Raises:
        MemoryFileError: there is no such file, or it does not hold.
    """
    try:
        return from_json(path.read_bytes())
    except FileNotFoundError:
        raise MemoryFileError(f"{path}: there is no such file") from None
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None


def require_fit(memory: Memory, deployment: Deployment, range_rad: Floats | None = None) -> None:
    """Refuses the memory of another robot, and key poses that the joints cannot take.

    Raises:
        MemoryFileError: says what differs, or which pose and joint.
    """
    memory.robot.require_same(robot_of(deployment))
    if range_rad is not None:
        check_limits(memory, range_rad)
