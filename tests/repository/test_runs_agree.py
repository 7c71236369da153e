"""The promise: the result depends on the deployment and its seed, not on how it is spread over processes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import reported
from launching import SHORT, TOUCH, run, run_alone

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


Robot = tuple[Path, tuple[str, ...]]
ARM: Robot = (reported.ARM, reported.SHORT)
HRP2: Robot = (TOUCH, SHORT)


@pytest.fixture(scope="module", params=[ARM, pytest.param(HRP2, marks=pytest.mark.long)], ids=["arm", "hrp2"])
def robot(request: pytest.FixtureRequest) -> Robot:
    """Deployment and the settings that make it short."""
    chosen: Robot = request.param
    return chosen


@pytest.fixture(scope="module")
def reference(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    file, short = robot
    return run(file, tmp_path_factory.mktemp("reference"), "--in-process", settings=short)


@pytest.mark.parametrize(
    ("start", "arguments", "settings"),
    [
        (run_alone, ("--in-process",), ()),
        (run, (), ()),
        (run, (), ("cell_processes=per_patch",)),
        (run, ("--in-process",), ("cell_processes=1",)),
    ],
    ids=["again", "processes", "one process per patch", "one process"],
)
def test_the_log_is_the_same(
    robot: Robot,
    reference: dict[str, Any],
    tmp_path: Path,
    start: Callable[..., dict[str, Any]],
    arguments: tuple[str, ...],
    settings: tuple[str, ...],
) -> None:
    file, short = robot
    other = start(file, tmp_path, *arguments, settings=short + settings)
    assert other["log_sha256"] == reference["log_sha256"]
    assert other["metrics"] == reference["metrics"]
    assert other["sim_s"] == reference["sim_s"]


@pytest.mark.parametrize("setting", ["seed=2", "network.hop_delay_us=186.0", "network.bits_per_s=100000"])
def test_the_log_differs_when_anything_else_does(
    robot: Robot, reference: dict[str, Any], tmp_path: Path, setting: str
) -> None:
    file, short = robot
    other = run(file, tmp_path, "--in-process", settings=(*short, setting))
    assert other["log_sha256"] != reference["log_sha256"]
    assert other["metrics"]["network.conserved"]
    assert bool(other["metrics"]["network.dropped"]) == setting.startswith("network.bits")


def test_nothing_is_lost_and_touch_is_answered(reference: dict[str, Any]) -> None:
    figures = reference["metrics"]
    assert reference["outcome"] == "completed"
    assert figures["network.offered"] == figures["network.delivered"] + figures["network.in_flight"]
    assert figures["network.dropped"] == 0
    assert figures["formation.unreached_cells"] == 0
    assert figures["reaction.count"] > 0
    assert not reference["counters"]
