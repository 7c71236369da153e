"""The controller's memory: what it learnt is kept as it learns, and known again at the next start."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from memory_robot import same
from numpy.typing import NDArray
from rich.console import Console
from small_robot import small

from controller.grasping.long_term_memory import MEMORY_FILE, LongTermMemory, restore_self_model
from controller.self_model import SelfModel
from controller.selforganisation.kinematic_structure import find_structure
from controller.selforganisation.sensory_motor_map import SensoryMotorMap
from skinnet.errors import MemoryFileError
from skinnet.memory.contents import KeyPose, MemoryContents
from skinnet.memory.sqlite_store import read_memory, write_memory
from skinnet.output_folder import OwnedFolder, RunIdentity
from skinnet.run import in_process
from skinnet.run.context import RunContext
from skinnet.run.in_process import run_in_process
from skinnet.run.progress import ProgressDisplay

ACTIVITY = np.array([[0, 0], [0, 0], [1, 0], [1, 0], [1, 0], [1, 0], [1, 1], [1, 1]], dtype=bool)
OPEN_RAD, CLOSED_RAD = np.array([0.5, -0.5]), np.array([0.1, 0.2])


def weights(value: float) -> NDArray[np.float64]:
    return np.where(ACTIVITY, value, 0.0)


def learn(memory: LongTermMemory, knowledge: SelfModel) -> None:
    """Structure, two poses of which one was explored a little beside where it was taught, an area."""
    knowledge.structure = find_structure(ACTIVITY)
    memory.store_structure()
    knowledge.sensory_motor_map.add(OPEN_RAD + 0.02, weights(0.3))
    for name, position_rad in (("open", OPEN_RAD), ("closed", CLOSED_RAD)):
        knowledge.poses[name] = position_rad
        memory.store_pose(name)
    knowledge.areas["pat"] = np.array([1, 4])
    memory.store_areas()
    memory.store_parameters({"load.omega": 0.05})


def begin(tmp_path: Path, out: str | None, **tables: Any) -> tuple[LongTermMemory, SelfModel]:
    knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005)
    folder = None if out is None else tmp_path / out
    return LongTermMemory.open(small(**tables), tmp_path, folder, knowledge), knowledge


def test_what_was_learnt_is_known_in_the_next_run(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, "teach")
    learn(memory, knowledge)
    memory.close()
    again, recalled = begin(tmp_path, "grasp", memory={"read": f"teach/{MEMORY_FILE}"})
    again.close()
    assert recalled.structure is not None
    assert recalled.structure.parts == find_structure(ACTIVITY).parts
    assert recalled.structure.problems == ()
    assert {name: pose.tolist() for name, pose in recalled.poses.items()} == {
        "open": OPEN_RAD.tolist(),
        "closed": CLOSED_RAD.tolist(),
    }
    assert recalled.areas["pat"].tolist() == [1, 4]
    assert recalled.parameters == {"load.omega": 0.05}
    # the map is that of the pose it was explored in, and of no other
    assert recalled.sensory_motor_map.poses_rad.tolist() == [OPEN_RAD.tolist()]
    assert (recalled.sensory_motor_map.closest(CLOSED_RAD) == weights(0.3)).all()
    # and the second run has it all in its own folder
    first, second = (read_memory(tmp_path / run / MEMORY_FILE) for run in ("teach", "grasp"))
    assert same(first, second)


def test_a_run_may_go_on_in_the_file_that_it_reads(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, "run")
    learn(memory, knowledge)
    memory.close()
    before = read_memory(tmp_path / "run" / MEMORY_FILE)
    again, recalled = begin(tmp_path, "run", memory={"read": f"run/{MEMORY_FILE}"})
    again.close()
    assert same(read_memory(tmp_path / "run" / MEMORY_FILE), before)
    assert len(recalled.sensory_motor_map) == 1


def test_what_an_earlier_run_left_is_not_of_this_one(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, "run")
    learn(memory, knowledge)
    memory.close()
    memory, recalled = begin(tmp_path, "run")
    memory.close()
    assert recalled.structure is None
    assert read_memory(tmp_path / "run" / MEMORY_FILE).poses == {}


def test_without_a_folder_nothing_is_kept(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, None)
    learn(memory, knowledge)
    memory.close()
    assert list(tmp_path.iterdir()) == []
    assert knowledge.parameters == {"load.omega": 0.05}


def test_a_kept_map_is_the_nearest_and_the_newest(tmp_path: Path) -> None:
    maps = SensoryMotorMap()
    assert maps.explored_at(OPEN_RAD, 0.05) is None
    for pose_rad, value in ((OPEN_RAD + 0.04, 0.1), (OPEN_RAD, 0.2), (OPEN_RAD - 0.01, 0.3), (OPEN_RAD, 0.4)):
        maps.add(pose_rad, weights(value))
    found = maps.explored_at(OPEN_RAD, 0.05)
    assert found is not None
    assert (found == weights(0.4)).all()
    assert maps.explored_at(OPEN_RAD + np.array([0.0, 0.1]), 0.05) is None


def test_cells_that_were_not_measured_stay_so(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, "run")
    unknown = np.zeros_like(ACTIVITY)
    unknown[5, 1] = True
    knowledge.structure = find_structure(ACTIVITY, unknown)
    memory.store_structure()
    memory.close()
    recalled = SelfModel(min_row_norm=0.05, min_lever_m=0.005)
    restore_self_model(read_memory(tmp_path / "run" / MEMORY_FILE), recalled)
    assert recalled.structure is not None
    assert recalled.structure.unmeasured == (5,)
    assert recalled.structure.parts == knowledge.structure.parts
    assert (recalled.structure.activity == knowledge.structure.activity).all()


def test_an_area_without_cells_is_refused(tmp_path: Path) -> None:
    memory, knowledge = begin(tmp_path, "run")
    knowledge.areas["pat"] = np.zeros(0, dtype=np.int64)
    with pytest.raises(MemoryFileError, match=r"areas.pat: has no cells"):
        memory.store_areas()
    memory.close()


def test_the_memory_of_another_robot_is_not_recalled(tmp_path: Path) -> None:
    memory, _ = begin(tmp_path, "run")
    memory.close()
    with pytest.raises(MemoryFileError, match=r"joints\[1\] is wrist; hand is due"):
        begin(tmp_path, "other", memory={"read": "run/memory.sqlite"}, body={"joints": ("elbow", "hand")})
    assert not (tmp_path / "other").exists()


async def test_nodes_learn_where_the_run_folder_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, Path | None]] = []

    def build_process(
        module: str, _deployment: Any, _name: str, _base: Path, out: Path | None, **_more: Any
    ) -> Any:
        asked.append((module, out))
        raise MemoryFileError("enough")

    monkeypatch.setattr(in_process, "build_process", build_process)
    folder = OwnedFolder(tmp_path / "run", RunIdentity("run", "0" * 64), -1)
    with pytest.raises(MemoryFileError, match="enough"):
        await run_in_process(RunContext(small(), tmp_path, folder, ProgressDisplay(Console(quiet=True))))
    assert asked == [("skinnet.body", tmp_path / "run")]


def test_positions_are_recalled_to_the_bit(tmp_path: Path) -> None:
    knowledge = SelfModel(min_row_norm=0.05, min_lever_m=0.005)
    memory, other = begin(tmp_path, "run")
    pose_rad = np.array([0.1 + 0.2, 1 / 3])
    other.poses["open"] = pose_rad
    memory.store_pose("open")
    memory.close()
    kept = read_memory(tmp_path / "run" / MEMORY_FILE)
    restore_self_model(kept, knowledge)
    assert knowledge.poses["open"].tobytes() == pose_rad.tobytes()
    write_memory(tmp_path / "copy", MemoryContents(kept.robot, poses={"open": KeyPose(pose_rad)}))
    assert same(read_memory(tmp_path / "copy"), kept)
