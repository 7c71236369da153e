"""The promise: the result depends on the deployment and its seed, not on how it is spread over processes."""

from pathlib import Path
from typing import Any

import pytest
from launching import SHORT, TOUCH, run

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return run(TOUCH, tmp_path_factory.mktemp("reference"), "--in-process", settings=SHORT)


@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        (("--in-process",), ()),
        ((), ()),
        ((), ("cell_processes=per_patch",)),
        (("--in-process",), ("cell_processes=1",)),
    ],
    ids=["again", "processes", "one process per patch", "one process"],
)
def test_the_log_is_the_same(
    reference: dict[str, Any], tmp_path: Path, arguments: tuple[str, ...], settings: tuple[str, ...]
) -> None:
    other = run(TOUCH, tmp_path, *arguments, settings=SHORT + settings)
    assert other["log_sha256"] == reference["log_sha256"]
    assert other["metrics"] == reference["metrics"]
    assert other["sim_s"] == reference["sim_s"]


@pytest.mark.parametrize("setting", ["seed=2", "network.hop_delay_us=186.0", "network.bits_per_s=500000"])
def test_the_log_differs_when_anything_else_does(
    reference: dict[str, Any], tmp_path: Path, setting: str
) -> None:
    other = run(TOUCH, tmp_path, "--in-process", settings=(*SHORT, setting))
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
