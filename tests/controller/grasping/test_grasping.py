"""Grasps of unknown objects from the taught memory: five that succeed, four that cannot, and what breaks."""

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from launching import child, launched, run, wait_for
from locations import ROOT
from rich.console import Console

from skinnet.memory.json_export import to_json
from skinnet.memory.sqlite_store import read_memory
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay

pytestmark = pytest.mark.timeout(400)
GRASP = ROOT / "deployments" / "hrp2_grasp.toml"
TEACH = ROOT / "deployments" / "hrp2_teach.toml"
MEMORY = ROOT / "deployments" / "hrp2_memory.json"
FAST = {"approach": 0.3, "contact": 0.2, "load": 0.2, "pull": 3.0, "hold": 4.0, "release": 1.0}
"""How long into a state something happens, in the run below: the middle of each [s]."""
PAIN = 0.45
SPEED_RAD_S = 1.2
GRAVITY_M_S2 = 9.81
LOWERED_M = 0.15
Figures = dict[str, Any]


def long(value: object) -> Any:
    """A parameter of which a test of its kind is in every run of the suite already."""
    return pytest.param(value, marks=pytest.mark.long)


def grasped(out: Path, *settings: str, seed: int = 1) -> Figures:
    """Figures of a run in one process; whatever happened, what must never happen did not."""
    order = RunOptions(GRASP, settings, in_process=True, plots=False)
    summary = run_once(
        prepare_run(order, seed), out, ProgressDisplay(Console(file=io.StringIO()), quiet=True)
    )
    assert summary["outcome"] == "completed"
    figures: Figures = summary["metrics"]
    assert figures["grasp.peak_reading"] < PAIN
    assert figures["grasp.peak_reading_received"] < PAIN
    assert figures["grasp.peak_speed_rad_s"] <= SPEED_RAD_S * (1.0 + 1e-6)  # as a float of 32 bits
    assert figures["network.conserved"]
    return figures


def operator(*steps: tuple[str, str, float]) -> str:
    """Opens the arms, is patted, then sends each request when its state has lasted so long [s]."""
    first = '{state="idle", request="go", argument="open"}'
    more = (f'{{state="{state}", request="{what}", delay_s={delay_s}}}' for state, what, delay_s in steps)
    return f"controller.teach_and_grasp.operator_requests=[{', '.join([first, *more])}]"


def as_it_was(figures: Figures) -> None:
    """The object was not thrown: no faster than a fall of the stand's way, and it stands where it was put."""
    assert figures["object.peak_speed_m_s"] < (2.0 * GRAVITY_M_S2 * LOWERED_M) ** 0.5
    assert abs(figures["object.displacement_m"][2]) < 0.01


@pytest.mark.parametrize(
    "thing", ["trash_bin", *map(long, ("sponge_rock", "moving_box", "lid", "delivery_box"))]
)
def test_unknown_objects_are_grasped(thing: str, tmp_path: Path) -> None:
    figures = grasped(tmp_path, f"object={thing}", seed=7)
    assert figures["grasp.success"]
    assert figures["object.carried_s"] >= 5.0
    assert all(cells > 0 for cells in figures["grasp.pull.contact_cells"])
    as_it_was(figures)


@pytest.mark.parametrize(
    "settings",
    [
        long(("object=none",)),
        ("object=thin_post",),
        long(("object=wide_crate",)),
        long(("object=delivery_box", "stand.fix_object=true")),
    ],
    ids=["none", "small", "big", "stuck"],
)
def test_what_cannot_be_grasped_is_given_up(settings: tuple[str, ...], tmp_path: Path) -> None:
    """By the robot itself, which ends in its safe pose."""
    figures = grasped(tmp_path, *settings)
    assert not figures["grasp.success"]
    assert figures["grasp.final_state"] == "safe"
    assert figures["grasp.cancelled_in"] in ("open", "approach", "contact", "load", "pull")
    assert figures["grasp.cancelled_by"] in ("pose reached", "stalled", "timed out", "an arm lost the object")


@pytest.mark.parametrize("state", [state if state == "pull" else long(state) for state in FAST])
def test_cancelled_in_any_state_the_object_is_set_down(state: str, tmp_path: Path) -> None:
    before = [("hold", "release", 12.0)] if state == "release" else []
    figures = grasped(tmp_path, operator(*before, (state, "cancel", FAST[state])))
    assert figures["grasp.cancelled_in"] == state
    assert figures["grasp.cancelled_by"] == "cancel"
    assert figures["grasp.final_state"] == "safe"
    assert not figures["object.dropped"]
    as_it_was(figures)


@pytest.mark.parametrize("state", [long(state) for state in ("contact", "pull", "hold")])
def test_a_lost_gateway_in_any_state_ends_the_grasp_gently(state: str, tmp_path: Path) -> None:
    """The patch of a forearm has one gateway: with it, all its cells are lost."""
    calm = grasped(tmp_path / "calm")
    at_s = calm[f"grasp.start_s.{state}"] + FAST[state]
    fault = f'faults=[{{kind="gateway_lost", target="left_inner_forearm:0", at_s={at_s}}}]'
    figures = grasped(tmp_path / "lost", fault)
    assert figures["grasp.cancelled_in"] == state
    assert figures["grasp.cancelled_by"] == "skin lost"
    assert figures["grasp.final_state"] == "safe"
    assert not figures["object.dropped"]
    as_it_was(figures)


@pytest.mark.processes
@pytest.mark.long
def test_one_process_or_many_the_log_is_the_same(tmp_path: Path) -> None:
    one = run(GRASP, tmp_path / "one", "--in-process", settings=("object=trash_bin",))
    many = run(GRASP, tmp_path / "many", settings=("object=trash_bin",))
    assert one["log_sha256"] == many["log_sha256"]
    assert one["metrics"] == many["metrics"]
    assert one["metrics"]["grasp.success"]


def _lost(out: Path, state: str, who: Callable[[Any], Any], may: str) -> Figures:
    """Figures of a run in processes in which one of them is killed in a state."""
    settings = (f'run.tolerated_losses=["{may}"]', "run.max_s=60", operator(("hold", "release", 12.0)))
    with launched(GRASP, out, settings=settings) as process:
        wait_for(process, f"teach_and_grasp.{state}")
        who(process).kill()
        process.communicate(timeout=300)
        assert process.returncode == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["outcome"] == "completed_with_losses"
    figures: Figures = summary["metrics"]
    return figures


@pytest.mark.processes
@pytest.mark.long
def test_without_its_controller_the_robot_holds_what_it_holds(tmp_path: Path) -> None:
    figures = _lost(tmp_path, "hold", lambda process: child(process, "controller"), "controller")
    assert not figures["object.dropped"]
    assert figures["object.carried_s"] >= 5.0


@pytest.mark.processes
@pytest.mark.long
def test_without_the_skin_of_an_arm_it_sets_the_object_down(tmp_path: Path) -> None:
    figures = _lost(tmp_path, "pull", lambda process: child(process, "right"), "cells")
    assert figures["grasp.cancelled_by"] == "skin lost"
    assert figures["grasp.final_state"] == "safe"
    as_it_was(figures)


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Figures]:
    """A robot that knew nothing: what it was taught, and what it did with it."""
    out = tmp_path_factory.mktemp("teach")
    order = RunOptions(TEACH, (), in_process=True, plots=False)
    summary = run_once(prepare_run(order), out, ProgressDisplay(Console(file=io.StringIO()), quiet=True))
    return out, summary["metrics"]


@pytest.mark.long
def test_from_an_empty_memory_to_a_grasp(taught: tuple[Path, Figures]) -> None:
    _, figures = taught
    assert figures["structure.wrong_entries"] == 0
    assert figures["teach_and_grasp.poses"] == ["closed", "home", "open", "pulled"]
    assert {
        label: figures[f"teach_and_grasp.area_cells.{label}"] for label in ("pat", "contact", "chest")
    } == {
        "pat": 7,
        "contact": 32,
        "chest": 12,
    }
    assert figures["teach_and_grasp.refused_requests"] == 0
    assert figures["lessons.outcomes"] == ["reached"] * 3
    assert figures["lessons.contacts"] == 0
    assert figures["lessons.peak_force_n"] == 0.0
    assert figures["grasp.success"]


@pytest.mark.long
def test_the_shipped_memory_is_what_was_taught(taught: tuple[Path, Figures]) -> None:
    out, _ = taught
    assert to_json(read_memory(out / "memory.sqlite")) == MEMORY.read_bytes()
