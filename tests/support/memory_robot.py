"""Memories to write and read: one of a small robot, any that hypothesis thinks of, and numbered ones."""

import string

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from skinnet.memory.contents import KeyPose, MemoryContents, RobotIdentity

ROBOT = RobotIdentity("bot", ("elbow", "wrist pitch/2"), {"arm": 3, "hand": 2})
LARGE_ROBOT = RobotIdentity("bot", tuple(f"joint{i}" for i in range(7)), {"arm": 12, "hand": 8})

names = st.text(string.ascii_letters + string.digits + "_-", min_size=1, max_size=64)
finite = st.floats(allow_nan=False, allow_infinity=False)


def same(one: MemoryContents, other: MemoryContents) -> bool:
    """Equal to the bit, and in the order of poses; parameters and areas have none."""
    one.robot.require_match(other.robot)
    return one.digest() == other.digest()


def known() -> MemoryContents:
    """What the small robot has learnt."""
    weights = np.array([[0.0, 0.0], [0.6, -0.8], [1.0, 0.0], [0.0, 0.0], [1 / 3, 2 / 3]])
    return MemoryContents(
        ROBOT,
        activity=np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1]], dtype=bool),
        poses={"open": KeyPose(np.array([0.1, -1.5]), weights), "home": KeyPose(np.array([0.0, 1e-300]))},
        areas={"pat": np.array([1]), "contact": np.array([0, 2, 4])},
        parameters={"load.force_gain": 0.1, "load.omega": 0.05},
        unmeasured=np.array([3]),
    )


def numbered(number: int, robot: RobotIdentity = ROBOT) -> MemoryContents:
    """A memory of which every part tells its number."""
    rng = np.random.default_rng(number)
    poses = {
        name: KeyPose(rng.normal(size=len(robot.joints)), rng.normal(size=robot.shape))
        for name in ("home", "open", "closed", "pulled")
    }
    cells = np.flatnonzero(rng.random(robot.n_cells) < 0.5)
    areas = {"pat": cells} if len(cells) else {}
    return MemoryContents(robot, rng.random(robot.shape) < 0.5, poses, areas, {"number": number})


@st.composite
def robots(draw: st.DrawFn) -> RobotIdentity:
    joints = st.text(min_size=1, max_size=5).filter(str.isprintable)
    return RobotIdentity(
        draw(names),
        tuple(draw(st.lists(joints, min_size=1, max_size=3, unique=True))),
        draw(st.dictionaries(names, st.integers(1, 4), min_size=1, max_size=3)),
    )


@st.composite
def memories(draw: st.DrawFn) -> MemoryContents:
    robot = draw(robots())
    cells = st.sets(st.integers(0, robot.n_cells - 1)).map(
        lambda found: np.array(sorted(found), dtype=np.int64)
    )
    weights = arrays.arrays(np.float64, robot.shape, elements=finite)
    positions = arrays.arrays(np.float64, len(robot.joints), elements=finite)
    activity = draw(st.none() | arrays.arrays(np.bool_, robot.shape))
    unmeasured = np.zeros(0, dtype=np.int64)
    if activity is not None:
        unmeasured = draw(cells)
        activity[unmeasured] = False
    return MemoryContents(
        robot,
        activity,
        draw(st.dictionaries(names, st.builds(KeyPose, positions, st.none() | weights), max_size=3)),
        draw(st.dictionaries(names, cells.filter(len), max_size=3)),
        draw(st.dictionaries(names, finite, max_size=3)),
        unmeasured,
    )
