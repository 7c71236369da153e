"""Whole runs in which things break: one log however it is spread, all packets explained, figures right."""

import io
import signal
import sys
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from locations import ROOT
from rich.console import Console
from small_robot import patch
from streaming_skin import FAST, Streaming, cut

from cells.formation.gateway_agent import FormationPhase
from cells.networking.outages import Outage
from skinnet.cli.main import main
from skinnet.deployment.experiment.faults import FaultRule
from skinnet.network.records import Outcome
from skinnet.run.pipeline import run_once
from skinnet.run.prepare import RunOptions, prepare_run
from skinnet.run.progress import ProgressDisplay

ARM = ROOT / "deployments" / "two_link_arm.toml"
KINDS = [rule.__struct_config__.tag for rule in get_args(FaultRule)]
CAUSES = [
    f"network.dropped.{outcome.name.lower()}" for outcome in Outcome if outcome is not Outcome.DELIVERED
]
Figures = dict[str, Any]

STREAM = ('controller.program=["structure"]', "run.max_s=0.6")
EVERYTHING = (
    "run.max_s=1.0",
    'bridges=[{a="base/5:0", b="upper_link/0:3"}]',
    "power={link_ohm=1.0}",
    """faults=[
        {kind="link_cut", target="base/0:0", at_s=0.3, duration_s=0.3},
        {kind="cell_dead", target="upper_link/3", at_s=0.4, duration_s=0.25},
        {kind="stuck_at", target="base/1", channel="all", at_s=0.2},
        {kind="drift", target="base/2", channel="force0", rate_per_s=0.5},
        {kind="babbling_idiot", target="base/4", rate_hz=200},
        {kind="bit_errors", target="upper_link/*", bit_error_rate=1e-3, at_s=0.3},
        {kind="loss", target="fore_link/0:0", probability=0.3},
        {kind="burst_loss", target="base/*:0", mean_good_s=0.05, mean_bad_s=0.02},
        {kind="gateway_lost", target="fore_link:1", at_s=0.5},
        {kind="slow_process", target="*", added_delay_ms=0.2},
    ]""",
)


def played(out: Path, *settings: str, in_process: bool = True) -> dict[str, Any]:
    """Summary of a run of the two-link arm, whose cells stream all the time."""
    order = RunOptions(ARM, (*STREAM, *settings), in_process, plots=False)
    summary = run_once(prepare_run(order), out, ProgressDisplay(Console(file=io.StringIO()), quiet=True))
    assert summary["outcome"] == "completed"
    explain(summary["metrics"])
    return summary


def explain(figures: Figures) -> None:
    """Offered = delivered + dropped + in flight, and what was dropped is the sum over its causes."""
    assert 0 <= figures["network.data_dropped"] <= figures["network.dropped"]
    assert figures["network.conserved"] is True
    dropped = sum(figures.get(cause, 0) for cause in CAUSES)
    assert figures["network.dropped"] == dropped
    assert not {key for key in figures if key.startswith("network.dropped.")} - set(CAUSES)
    assert figures["network.offered"] == figures["network.delivered"] + dropped + figures["network.in_flight"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Nothing breaks."""
    return played(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Everything breaks, on two hosts in one process."""
    return played(tmp_path_factory.mktemp("broken"), *EVERYTHING)


def test_all_kinds_are_among_everything() -> None:
    assert len(KINDS) == 10
    assert all(f'"{kind}"' in EVERYTHING[-1] for kind in KINDS)


def test_of_everything_that_breaks_the_summary_tells(broken: dict[str, Any]) -> None:
    figures = broken["metrics"]
    assert all(figures[f"network.dropped.{cause}"] > 0 for cause in ("corrupted", "link_failed", "loss"))
    assert figures["recovery.count"] == 5
    assert figures["recovery.unfinished"] == 0
    assert figures["formation.unreached_cells"] == 1  # a cell without neighbours that lost its gateway
    assert figures["formation.repeated_packets"] > 0
    assert figures["formation.ignored_packets"] > 0
    assert 0 < figures["recovery.rejoin_ms.max"] <= figures["recovery.complete_ms.max"]


@pytest.mark.processes
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("in_process", "settings"),
    [(True, ("cell_processes=1",)), (False, ()), (False, ("cell_processes=per_patch",))],
    ids=["one process", "processes", "one process per patch"],
)
def test_with_all_faults_a_bridge_and_power_the_log_is_the_same(
    broken: dict[str, Any], tmp_path: Path, in_process: bool, settings: tuple[str, ...]
) -> None:
    other = played(tmp_path, *EVERYTHING, *settings, in_process=in_process)
    assert other["log_sha256"] == broken["log_sha256"]
    assert other["metrics"] == broken["metrics"]


FEW = 5
"""Events, beside the readings that stream, that readings of another value or time may bring or spare."""


def nothing_is_dropped(figures: Figures, whole: Figures) -> None:
    assert figures["network.dropped"] == 0
    assert abs(figures["network.data_packets"] - whole["network.data_packets"]) <= FEW
    assert "recovery.count" not in figures


def a_link_goes_and_comes(figures: Figures, whole: Figures) -> None:
    assert figures["network.dropped"] == figures["network.dropped.link_failed"] > 0
    assert (figures["recovery.count"], figures["recovery.unfinished"]) == (2, 0)
    assert figures["formation.unreached_cells"] == 0
    assert abs(figures["network.data_packets"] - whole["network.data_packets"]) <= FEW
    assert 0 < figures["recovery.lost_packets"] == figures["network.data_dropped"]
    assert 0.5 < figures["recovery.rejoin_ms.max"] <= figures["recovery.complete_ms.max"] < 50


def a_cell_is_missing(figures: Figures, whole: Figures) -> None:
    assert figures["formation.unreached_cells"] == 1
    assert figures["power.cells_off"] == 1
    missing = whole["network.data_packets"] - figures["network.data_packets"]
    assert abs(missing - 75) <= FEW  # 250 Hz for 0.3 s
    assert (figures["recovery.count"], figures["recovery.unfinished"]) == (1, 0)


def a_patch_is_cut_off(figures: Figures, whole: Figures) -> None:
    assert figures["formation.cut_off_patches"] == "base"
    assert figures["formation.unreached_cells"] == 6
    assert "power.cells_off" not in figures
    assert (figures["recovery.count"], figures["recovery.unfinished"]) == (1, 0)
    assert "recovery.rejoin_ms.max" not in figures
    assert figures["network.data_dropped"] >= 6 * 75 - 6
    assert figures["network.dropped"] == figures["network.dropped.link_failed"]


def some_are_corrupted(figures: Figures, whole: Figures) -> None:
    assert figures["network.dropped"] == figures["network.dropped.corrupted"] > 0


def some_are_lost(figures: Figures, whole: Figures) -> None:
    assert figures["network.dropped"] == figures["network.dropped.loss"] > 0


def more_is_said(figures: Figures, whole: Figures) -> None:
    """A Poisson process of 500/s for 0.3 s."""
    more = figures["network.data_packets"] - whole["network.data_packets"]
    assert abs(more - 150) < 5 * 150**0.5
    assert figures["network.dropped"] == 0


def cells_have_no_power(figures: Figures, whole: Figures) -> None:
    assert figures["power.cells_off"] == figures["formation.unreached_cells"] == 3
    assert figures["formation.cut_off_patches"] == "fore_link"


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        (
            'faults=[{kind="link_cut", target="upper_link/0:0", at_s=0.3, duration_s=0.1}]',
            a_link_goes_and_comes,
        ),
        ('faults=[{kind="cell_dead", target="base/5", at_s=0.3}]', a_cell_is_missing),
        (
            'faults=[{kind="stuck_at", target="base/1", channel="force0", value=0.5, at_s=0.3}]',
            nothing_is_dropped,
        ),
        ('faults=[{kind="drift", target="base/1", channel="force0", rate_per_s=0.5}]', nothing_is_dropped),
        ('faults=[{kind="babbling_idiot", target="base/1", rate_hz=500, at_s=0.3}]', more_is_said),
        ('faults=[{kind="bit_errors", target="base", bit_error_rate=1e-3, at_s=0.3}]', some_are_corrupted),
        ('faults=[{kind="loss", target="base", probability=0.2, at_s=0.3}]', some_are_lost),
        ('faults=[{kind="burst_loss", target="*", mean_good_s=0.05, mean_bad_s=0.02}]', some_are_lost),
        ('faults=[{kind="gateway_lost", target="base:0", at_s=0.3}]', a_patch_is_cut_off),
        ('power={feeds=["base/0:2", "upper_link/0:2"]}', cells_have_no_power),
    ],
    ids=lambda value: "" if callable(value) else value.split('"')[1] if "kind" in value else "power",
)
def test_of_each_alone_the_summary_tells_what_it_did(
    whole: dict[str, Any], tmp_path: Path, setting: str, told: Callable[[Figures, Figures], None]
) -> None:
    alone = played(tmp_path, setting)
    told(alone["metrics"], whole["metrics"])
    assert alone["log_sha256"] != whole["log_sha256"]


def test_a_slow_host_takes_longer_and_changes_nothing(whole: dict[str, Any], tmp_path: Path) -> None:
    slow = played(tmp_path, 'faults=[{kind="slow_process", target="cells0", added_delay_ms=2.0}]')
    assert slow["log_sha256"] == whole["log_sha256"]
    assert slow["metrics"] == whole["metrics"]
    assert slow["loop_s"] > 0.3  # 150 periods of 2 ms at least


def test_a_run_that_ends_in_the_middle_of_a_recovery_tells_what_was_known_last(
    whole: dict[str, Any], tmp_path: Path
) -> None:
    """A link is cut at 598 ms of 600: half a millisecond to notice, and more than one to re-form."""
    fault = 'faults=[{kind="link_cut", target="upper_link/0:0", at_s=0.598}]'
    figures = played(tmp_path, fault)["metrics"]
    assert (figures["recovery.count"], figures["recovery.unfinished"]) == (1, 1)
    assert "formation.cut_off_patches" not in figures
    assert figures["formation.unreached_cells"] == 0
    assert figures["formation.tree_depth"] == whole["metrics"]["formation.tree_depth"]


@pytest.fixture
def interrupts() -> Iterator[None]:
    """The program takes signals over; here they are given back."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize("word", ["check", "run"])
def test_a_fault_at_an_unknown_link_is_refused_before_anything_runs(
    word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    fault = 'faults=[{kind="link_cut", target="fore_link/2:1"}]'
    monkeypatch.setattr(sys, "argv", ["skinnet", word, str(ARM), "--set", fault])
    with pytest.raises(SystemExit) as ended:
        main()
    printed, refused = capsys.readouterr()
    assert (ended.value.code, printed, len(refused.splitlines())) == (2, "", 1)
    assert "no wire at port 1 of fore_link/2" in refused
    assert not list(tmp_path.iterdir())


MS = 1_000_000


def test_what_is_lost_is_counted_once_however_many_things_break_meanwhile() -> None:
    life = Streaming(
        patch("p", 4, 3),
        network=FAST,
        found=lambda w: [cut(w, c, 0, t * MS) for c, t in ((0, 300), (5, 301), (1, 302))],
    ).run(500 * MS)
    recoveries = life.network.recovery_log.recoveries
    assert [recovery.topology_complete_ns is None for recovery in recoveries] == [False] * 3
    assert sum(recovery.lost_packets for recovery in recoveries) == life.dropped > 0


def test_what_is_lost_in_the_period_in_which_the_computer_knows_is_counted() -> None:
    everyone = [Outage(300 * MS, 400 * MS, cell=cell) for cell in range(12)]
    life = Streaming(patch("p", 4, 3), network=FAST, found=everyone).run(500 * MS)
    assert sum(recovery.lost_packets for recovery in life.network.recovery_log.recoveries) == life.dropped > 0


def test_what_a_patch_loses_does_not_count_for_another() -> None:
    life = Streaming(
        patch("arm", 3, 2),
        patch("hand", 3, 2),
        network=FAST,
        found=lambda w: [cut(w, 1, 2, 300 * MS), cut(w, 6, 2, 300 * MS, 350 * MS)],
    ).run(500 * MS)
    lost = np.zeros(2, dtype=np.int64)
    for recovery in life.network.recovery_log.recoveries:
        lost[recovery.group] += recovery.lost_packets
    assert (lost <= life.network.demultiplexer.undeliverable).all()
    assert lost[0] < 20


def test_while_an_epoch_is_under_way_the_computer_knows_what_it_knew_before() -> None:
    """It would else tell the controller of cells that are not lost."""
    life = Streaming(
        patch("p", 6, 6), network={"bits_per_s": 8_000_000}, found=lambda w: [cut(w, 3, 0, 300 * MS)]
    )
    members, seen = life.network.membership, []
    while life.network.kernel.now_ns < 500 * MS:
        life.run(life.network.kernel.now_ns + 4 * MS)
        news = (members.topology_version(0), members.n_unreachable(0))
        busy = life.network.formation_driver.gateways[0].phase in (
            FormationPhase.EXPLORATION,
            FormationPhase.REPORTS,
        )
        seen.append((news, busy))
    assert [news for news, _ in groupby(seen, key=lambda one: one[0])] == [(0, 36), (1, 0), (2, 0)]
    assert ((1, 0), True) in seen


def test_what_is_lost_for_good_between_two_changes_belongs_to_neither() -> None:
    """A patch without its only gateway goes on in vain, and the computer knows."""
    life = Streaming(patch("p", 3, 2), network=FAST, found=lambda w: [cut(w, 0, 2, 300 * MS, 500 * MS)]).run(
        600 * MS
    )
    gone, back = life.network.recovery_log.recoveries
    assert gone.topology_complete_ns is not None
    assert back.topology_complete_ns is not None
    known_ns = (gone.topology_complete_ns - gone.t_ns) + (back.topology_complete_ns - back.t_ns)
    assert gone.lost_packets > 0
    assert gone.lost_packets + back.lost_packets <= 6 * (known_ns // (4 * MS) + 2)
    assert life.dropped >= 6 * 45


def test_cells_have_nothing_to_say_until_the_network_has_formed() -> None:
    """Also those that have their numbers long before the last reports are in."""
    life = Streaming(patch("p", 6, 6), network={"bits_per_s": 8_000_000}).run(100 * MS)
    (formed_ns,) = life.network.membership.formed_ns
    assert formed_ns is not None
    assert formed_ns > 8 * MS
    assert life.rows()[:, 1].min() >= formed_ns


def test_a_cell_samples_until_the_instant_at_which_its_power_goes() -> None:
    """Two cells that lose it in the middle of a period: one has sampled before, one has not."""
    dying = [Outage(302 * MS, 310 * MS, cell=cell) for cell in (1, 11)]
    life = Streaming(patch("p", 4, 3), network=FAST, found=dying).run(300 * MS)
    times_ns = 300 * MS + np.arange(12) * 4 * MS // 12
    assert np.flatnonzero(~life.network.powered_at(times_ns)).tolist() == [11]
    life.run(304 * MS)
    assert np.flatnonzero(~life.network.powered_at(times_ns + 4 * MS)).tolist() == [1, 11]
    life.run(308 * MS)
    assert np.flatnonzero(~life.network.powered_at(times_ns + 8 * MS)).tolist() == [1]
