"""Memory loading: from the file named by a deployment, with a check of the robot."""

from pathlib import Path

from skinnet.deployment.deployment import Deployment
from skinnet.errors import MemoryFileError
from skinnet.memory.contents import Floats, MemoryContents, RobotIdentity, check_joint_limits
from skinnet.memory.json_export import stored_from_json
from skinnet.memory.sqlite_store import read_memory
from skinnet.migration.renaming import remark_old_format

__all__ = ["check_compatible", "load_memory", "read_memory_json", "robot_description"]


def robot_description(deployment: Deployment) -> RobotIdentity:
    """Describe the robot of a deployment: name, joints and number of cells per patch."""
    patches = {patch.name: patch.n_cells for patch in deployment.patches}
    return RobotIdentity(deployment.robot, deployment.body.joints, patches)


def load_memory(
    deployment: Deployment, folder: Path, joint_limits_rad: Floats | None = None
) -> MemoryContents | None:
    """Load the memory for the start of a run; None if the deployment names no file.

    Args:
        deployment: Deployment to be run.
        folder: Folder of the deployment.
        joint_limits_rad: (D, 2) joint limits [rad], against which key poses are checked; no check without.

    Raises:
        MemoryFileError: the file does not exist, is invalid, or belongs to another robot.
    """
    if deployment.memory.read is None:
        return None
    path = folder / deployment.memory.read
    memory = read_memory_json(path) if path.suffix == ".json" else read_memory(path)
    try:
        check_compatible(memory, deployment, joint_limits_rad)
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None
    return memory


def read_memory_json(path: Path) -> MemoryContents:
    """Read a memory from the JSON of `skinnet memory export`; an earlier version is remarked upon once.

    Raises:
        MemoryFileError: the file does not exist or is invalid.
    """
    try:
        stored = stored_from_json(path.read_bytes())
    except FileNotFoundError:
        raise MemoryFileError(f"{path}: file not found") from None
    except MemoryFileError as error:
        raise MemoryFileError(f"{path}: {error}") from None
    if stored.is_old:
        remark_old_format(path, "memory")
    return stored.contents


def check_compatible(
    memory: MemoryContents, deployment: Deployment, joint_limits_rad: Floats | None = None
) -> None:
    """Check that a memory belongs to the robot and that its key poses are within the joint limits.

    Raises:
        MemoryFileError: names the difference, or the pose and the joint.
    """
    memory.robot.require_match(robot_description(deployment))
    if joint_limits_rad is not None:
        check_joint_limits(memory, joint_limits_rad)
