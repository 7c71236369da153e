"""Rules of faults: what is refused, what they mean, and when."""

import math
import re
import signal
import sys
import tomllib
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any, get_args

import numpy as np
import pytest
import scipy
from locations import ROOT
from small_robot import SHIPPED, patch, small

from skinnet.cli.main import main
from skinnet.deployment import Deployment
from skinnet.deployment.checks import check
from skinnet.deployment.experiment.faults import FaultRule, SensorChannel
from skinnet.deployment.extends import merge_layers, read_layers
from skinnet.deployment.load import from_document
from skinnet.network.faults.fault_schedule import (
    FaultLocation,
    FaultSpan,
    check_targets,
    fault_schedule,
    gilbert_elliott_phases,
)
from skinnet.protocol.messages import FOREVER_NS, READING_NAMES
from skinnet.skin.placement import PlacedPatch, place_patches

PAGE = ROOT / "docs" / "faults.md"
EXAMPLES = re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
QUOTED = re.findall(r"^```text\n(.*?)\n```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)[0]
KINDS = [rule.__struct_config__.tag for rule in get_args(FaultRule)]


def rule(kind: str = "link_cut", target: str = "arm/0:0", **more: Any) -> dict[str, Any]:
    return {"kind": kind, "target": target, **more}


def placed(deployment: Deployment) -> tuple[PlacedPatch, ...]:
    return place_patches(deployment.patches, deployment.cells)


def spans(*rules: dict[str, Any], **more: Any) -> tuple[FaultSpan, ...]:
    deployment = small(faults=rules, **more)
    check(deployment)
    return fault_schedule(deployment, placed(deployment))


def where(*rules: dict[str, Any]) -> list[str]:
    return [span.target for span in spans(*rules)]


@pytest.fixture
def interrupts() -> Iterator[None]:
    """The program takes signals over; here they are given back."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.usefixtures("interrupts")
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("kind='link_cut', target='tors/4:1'", ("target = 'tors/4:1'", "unknown patch", "torso, left")),
        ("kind='link_cut', target='torso/18:1'", ("'torso/18:1'", "cells 0 to 17")),
        ("kind='link_cut', target='torso/4:3'", (QUOTED,)),
        ("kind='loss', target='torso:1', probability=0.1", ("'torso:1'", "gateways 0 to 0")),
        ("kind='cell_dead', target='torso/18'", ("'torso/18'", "cells 0 to 17")),
        ("kind='cell_dead', target='torso/4:1'", ("cell_dead is about cells; write patch/cell",)),
        ("kind='gateway_lost', target='torso/0'", ("gateway_lost is about gateways; write patch:gateway",)),
        ("kind='gateway_lost', target='torso:1'", ("gateways 0 to 0",)),
        ("kind='slow_process', target='middle', added_delay_ms=1", ("unknown cell process", "left, right")),
        ("kind='link_cut', target='belly*'", ("matches none of the links", "patch/cell:port")),
        ("kind='stuck_at', target='*:0', channel='all'", ("matches none of the cells", "patch/cell")),
        ("kind='cell_dead', target='torso/*', pick=19", ("pick = 19: only 18 cells match",)),
        ("kind='cell_dead', target='torso/4', pick=0", ("faults[0].pick = 0", ">= 1")),
        ("kind='link_cut', target='torso/0:0', at_s=1, mean_interval_s=2", ("at_s and mean_interval_s",)),
        ("kind='link_cut', target='torso/0:0', at_s=1, between_s=[1, 2]", ("at_s and between_s exclude",)),
        ("kind='link_cut', target='torso/0:0', at_s=300", ("at_s = 300", "run.max_s = 300", "never")),
        ("kind='link_cut', target='torso/0:0', between_s=[1, 301]", ("[1, 301]", "run.max_s = 300")),
        ("kind='link_cut', target='torso/0:0', between_s=[2, 1]", ("between_s = [2, 1]", "ascend")),
        ("kind='link_cut', target='torso/0:0', mean_interval_s=0", ("mean_interval_s = 0", ">= 0.001")),
        (
            "kind='stuck_at', target='torso/0', channel='force0', value=2",
            ("value = 2", "force0 reads 0 to 1"),
        ),
        ("kind='stuck_at', target='torso/0', channel='ax_g', value=-9", ("ax_g reads -8 to 8",)),
        ("kind='stuck_at', target='torso/0', channel='all', value=2", ("all reads 0 to 1; use one rule",)),
        ("kind='drift', target='torso/0', channel='all', rate_per_s=1", ("channel = 'all'", "'force0'")),
        (
            "kind='drift', target='torso/0', channel='ax_g', rate_per_s=0",
            ("rate_per_s = 0", "must not be zero"),
        ),
        ("kind='babbling_idiot', target='torso/0', rate_hz=1e9", ("rate_hz", "<= 100000")),
        ("kind='burst_loss', target='*', mean_good_s=1, mean_bad_s=0", ("mean_bad_s = 0", ">= 0.0001")),
        ("kind='loss', target='*', probability=1.1", ("probability = 1.1", "<= 1.0")),
        ("kind='loss', target='*'", ("faults[0]", "the table lacks `probability`")),
        (
            "kind='lnk_cut', target='*'",
            ("faults[0].kind = 'lnk_cut': did you mean 'link_cut'? allowed: 'link_cut', 'cell_dead'",),
        ),
        ("target='*'", ("faults[0]", "the table lacks `kind`; allowed: 'link_cut'")),
        ("kind=3", ("faults[0].kind = 3", "expected text")),
        (
            "kind='stuck_at', target='*', chanel='all'",
            ("chanel: unknown key; did you mean channel?", "value"),
        ),
        ("kind='link_cut', target='*', valeu=1", ("valeu: unknown key; allowed: kind, target, pick, at_s")),
        ("kind='link_cut', target='*', direction='up'", ("direction = 'up': allowed: 'out', 'in', 'both'",)),
        ("kind='link_cut', target='torso/00:1'", ("target = 'torso/00:1'", "regex")),
    ],
)
def test_what_cannot_break_is_refused_by_check(
    fault: str, said: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["skinnet", "check", str(SHIPPED), "--set", f"faults=[{{{fault}}}]"]
    monkeypatch.setattr(sys, "argv", line)
    with pytest.raises(SystemExit) as ended:
        main()
    printed, refused = capsys.readouterr()
    assert (ended.value.code, printed) == (2, "")
    assert len(refused.splitlines()) == 1
    assert str(SHIPPED) in refused
    assert all(word in refused for word in said), refused


def test_every_kind_has_an_example_that_holds() -> None:
    shown = set()
    for example in EXAMPLES:
        raw = merge_layers(read_layers(SHIPPED)) | {"format": 2} | tomllib.loads(example)
        deployment = from_document(raw, "docs/faults.md")
        check(deployment)
        found = fault_schedule(deployment, placed(deployment))
        assert {span.index for span in found} == set(range(len(deployment.faults))), example
        shown |= {span.kind for span in found}
    assert shown == set(KINDS)


def test_channels_are_those_of_a_reading() -> None:
    assert get_args(SensorChannel) == READING_NAMES


def test_either_end_of_a_wire_names_it_and_both_of_its_directions_break() -> None:
    there, back = ["arm/0:0", "arm/1:2"], ["arm/1:2", "arm/0:0"]
    assert where(rule(target="arm/0:0")) == where(rule(target="arm/1:2")) == there
    assert where(rule(target="arm/0:0", direction="out")) == there[:1]
    assert where(rule(target="arm/0:0", direction="in")) == back[:1]
    assert where(rule(target="arm/1:2", direction="out")) == back[:1]


def test_the_wire_of_an_interface_has_two_names() -> None:
    assert where(rule(target="arm:0")) == where(rule(target="arm/0:2")) == ["arm/0:2", "arm:0"]
    assert where(rule(target="arm:0", direction="out")) == ["arm:0"]
    assert where(rule(target="arm:0", direction="in")) == ["arm/0:2"]
    (first, second) = spans(rule(target="arm:0"))
    assert (first.location, second.location) == (FaultLocation("arm", 0, 2), FaultLocation("arm", gateway=0))


def test_cells_and_patches_stand_for_their_links() -> None:
    # three columns, two rows: cell 4 is in the middle of the upper row
    own = {"arm/4:0", "arm/4:2", "arm/4:3"}
    assert set(where(rule(target="arm/4", direction="out"))) == own
    assert set(where(rule(target="arm/4", direction="in"))) == {"arm/5:2", "arm/3:0", "arm/1:1"}
    assert len(where(rule(target="arm/4"))) == 6
    deployment = small()
    wires = {p.name: len(p.wires) + len(p.interfaces) for p in placed(deployment)}
    for target in ("arm", "a*", "arm/*"):
        assert len(where(rule(target=target))) == 2 * wires["arm"] == 16
    assert len(where(rule(target="*"))) == 2 * sum(wires.values())
    assert set(where(rule(target="*/0:2", direction="out"))) == {"arm/0:2", "hand/0:2"}


def test_cells_gateways_and_hosts_by_name_and_pattern() -> None:
    cells = [f"arm/{cell}" for cell in range(6)]
    assert where(rule("cell_dead", "arm")) == where(rule("cell_dead", "arm/*")) == cells
    assert where(rule("cell_dead", "*/1")) == ["arm/1", "hand/1"]
    assert where(rule("gateway_lost", "*")) == ["arm:0", "hand:0"]
    assert where(rule("gateway_lost", "hand")) == ["hand:0"]
    hosts = {
        "faults": [rule("slow_process", "le*", added_delay_ms=1.0)],
        "cell_processes": {"left": ["arm"], "right": ["hand"]},
    }
    deployment = small(**hosts)
    assert [span.location for span in fault_schedule(deployment, placed(deployment))] == [
        FaultLocation(process="left")
    ]


def test_a_bridge_is_a_wire() -> None:
    bridge = {"a": "arm/5:0", "b": "hand/1:0"}
    deployment = small(bridges=[bridge], faults=[rule(target="hand/1:0", direction="out")])
    patches = tuple(placed(small()))
    assert [span.target for span in fault_schedule(deployment, patches)] == ["hand/1:0"]
    with_bridge = small(bridges=[bridge], faults=[rule(target="arm/5")])
    assert len(fault_schedule(with_bridge, patches)) == 6
    without = small(faults=[rule(target="arm/5")])
    assert len(fault_schedule(without, patches)) == 4


def test_times_as_given() -> None:
    start, stays, goes = spans(
        rule("cell_dead", "arm/1"),
        rule("cell_dead", "arm/2", at_s=1.5),
        rule("cell_dead", "arm/3", at_s=2.25, duration_s=1e-3),
    )
    assert (start.t_ns, start.until_ns) == (0, FOREVER_NS)
    assert (stays.t_ns, stays.until_ns) == (1_500_000_000, FOREVER_NS)
    assert (goes.t_ns, goes.until_ns) == (2_250_000_000, 2_251_000_000)
    assert [span.index for span in (start, stays, goes)] == [0, 1, 2]


def test_the_order_is_time_then_rule_then_deployment() -> None:
    found = spans(
        rule("cell_dead", "arm/*", at_s=2.0),
        rule("cell_dead", "hand/0", at_s=1.0),
        rule("stuck_at", "arm/0", channel="all", at_s=2.0),
    )
    assert [span.target for span in found] == ["hand/0", *(f"arm/{c}" for c in range(6)), "arm/0"]
    assert [span.index for span in found] == [1, *[0] * 6, 2]


BIG = patch("arm", 40, 10)
BIG_PLACED = placed(small(BIG))


def big(*rules: dict[str, Any], seed: int = 1) -> tuple[FaultSpan, ...]:
    return fault_schedule(small(BIG, seed=seed, faults=rules), BIG_PLACED)


def test_random_times_are_uniform_and_each_target_has_its_own() -> None:
    found = big(rule("cell_dead", "arm", between_s=[3.0, 8.0]))
    t_s = np.array([span.t_ns for span in found]) * 1e-9
    assert len(t_s) == len(np.unique(t_s)) == 400
    assert scipy.stats.kstest((t_s - 3.0) / 5.0, "uniform").pvalue > 1e-3
    both = {(span.t_ns, span.until_ns) for span in spans(rule(between_s=[1.0, 9.0]))}
    assert len(both) == 1


def test_repeated_faults_are_a_poisson_process_while_whole() -> None:
    mean_s, duration_s, end_s = 3.0, 2.0, 300.0
    found = big(rule("cell_dead", "arm", mean_interval_s=mean_s, duration_s=duration_s))
    by_cell: dict[str, list[FaultSpan]] = {}
    for span in found:
        assert span.until_ns - span.t_ns == 2_000_000_000
        assert span.t_ns < end_s * 1e9
        by_cell.setdefault(span.target, []).append(span)
    gaps = [later.t_ns - earlier.until_ns for own in by_cell.values() for earlier, later in pairwise(own)]
    assert min(gaps) > 0
    # a run ends before its longest gaps do: first gaps from the start are free of that
    firsts = np.array([own[0].t_ns for own in by_cell.values()]) * 1e-9
    assert scipy.stats.kstest(firsts / mean_s, "expon").pvalue > 1e-3
    # renewal theory: an alternating process is broken for duration / (mean + duration) of the time
    expected = 400 * end_s / (mean_s + duration_s)
    assert len(found) == pytest.approx(expected, rel=0.02)
    once = big(rule("cell_dead", "arm", mean_interval_s=mean_s))
    assert len(once) == len({span.target for span in once})


def test_a_pick_is_a_fair_choice_by_the_seed() -> None:
    picked = [tuple(s.target for s in big(rule("cell_dead", "arm", pick=20), seed=k)) for k in range(60)]
    assert all(len(set(cells)) == 20 for cells in picked)
    assert len(set(picked)) == 60
    counts = np.bincount([int(cell.split("/")[1]) for cells in picked for cell in cells], minlength=400)
    # each cell is in with p = 1/20; sum of squares over variance is chi-squared, less the one constraint
    chi2 = float(((counts - 3.0) ** 2).sum() / (60 * 0.05 * 0.95))
    assert scipy.stats.chi2.sf(chi2, 399) > 1e-3
    assert scipy.stats.chi2.cdf(chi2, 399) > 1e-3
    order = [int(cell.split("/")[1]) for cell in picked[0]]
    assert order == sorted(order)


def test_a_pick_is_not_shuffled_by_those_who_join() -> None:
    few = {span.target for span in spans(rule("cell_dead", "arm", pick=3))}
    many = {span.target for span in spans(rule("cell_dead", "*", pick=3))}
    assert {target for target in many if target.startswith("arm")} <= few
    hundreds = {s.target for s in big(rule("cell_dead", "arm/1*", pick=30))}
    assert len(hundreds & {s.target for s in big(rule("cell_dead", "arm/*", pick=90))}) >= 15
    assert {s.target for s in big(rule("cell_dead", "arm", pick=30))} < {
        s.target for s in big(rule("cell_dead", "arm", pick=31))
    }


def test_a_wire_is_picked_as_a_whole() -> None:
    found = spans(rule(target="arm", pick=2, between_s=[1.0, 9.0]))
    assert len(found) == 4
    assert found[0].t_ns == found[1].t_ns != found[2].t_ns == found[3].t_ns


def test_draws_belong_to_the_seed_the_rule_and_the_name() -> None:
    flicker = rule("cell_dead", "arm/*", pick=3, mean_interval_s=5.0, duration_s=0.5)
    cut = rule(target="arm", between_s=[1.0, 9.0])
    alone = spans(flicker, cut)
    assert alone == spans(flicker, cut)
    assert alone != spans(flicker, cut, seed=2)
    for hosts in (1, 2, "per_patch", {"a": ["hand"], "b": ["arm"]}):
        assert spans(flicker, cut, cell_processes=hosts) == alone
    more = spans(flicker, cut, rule("loss", "*", mean_interval_s=1.0, duration_s=0.1, probability=0.5))
    assert tuple(span for span in more if span.index < 2) == alone
    # another patch beside it changes nothing either
    deployment = small(patch("arm"), patch("hand", 2, 1), patch("head", 4, 4), faults=(flicker, cut))
    assert fault_schedule(deployment, placed(deployment)) == alone


def test_without_rules_nothing_happens() -> None:
    assert spans() == ()
    check_targets(small(), placed(small()))


def bursty(**more: Any) -> FaultSpan:
    (span,) = spans(
        rule("burst_loss", "arm/0:0", direction="out", **{"mean_good_s": 0.3, "mean_bad_s": 0.1, **more})
    )
    return span


def test_phases_of_a_bursty_link_alternate_for_exponential_times() -> None:
    span = bursty(loss_good=0.02, loss_bad=0.7, at_s=1.0)
    phases = list(islice(gilbert_elliott_phases(span, 1), 20_001))
    assert phases == list(islice(gilbert_elliott_phases(span, 1), 20_001))
    assert phases[0][0] == 1_000_000_000
    t_ns = np.array([t for t, _ in phases])
    loss = np.array([p for _, p in phases])
    dwell_s = np.diff(t_ns) * 1e-9
    assert set(loss) == {0.02, 0.7}
    assert np.all(loss[1:] != loss[:-1])
    for probability, mean_s in ((0.02, 0.3), (0.7, 0.1)):
        own = dwell_s[loss[:-1] == probability]
        assert scipy.stats.kstest(own / mean_s, "expon").pvalue > 1e-3
    mean = float((dwell_s * loss[:-1]).sum() / dwell_s.sum())
    # the share of bad time of an alternating renewal process has variance ~ 2 (g b)² / ((g + b)³ T)
    sigma = 0.68 * math.sqrt(2 * (0.3 * 0.1) ** 2 / (0.4**3 * dwell_s.sum()))
    assert mean == pytest.approx((0.02 * 0.3 + 0.7 * 0.1) / 0.4, abs=4 * sigma)


def test_a_burst_loses_as_many_packets_in_a_row_as_the_channel_of_gilbert_does() -> None:
    # a packet every 4 ms: a run of losses ends with probability q = P(next sample good | bad)
    good_s, bad_s, step_s = 0.3, 0.05, 0.004
    span = bursty(mean_good_s=good_s, mean_bad_s=bad_s)
    phases = list(islice(gilbert_elliott_phases(span, 5), 20_000))
    t_ns = np.array([t for t, _ in phases])
    sample_ns = np.arange(0, t_ns[-1], round(step_s * 1e9))
    lost = np.array([p for _, p in phases])[np.searchsorted(t_ns, sample_ns, side="right") - 1] == 1.0
    edges = np.flatnonzero(np.diff(np.concatenate(([0], lost.astype(np.int8), [0]))))
    runs = edges[1::2] - edges[::2]
    rate = 1.0 / good_s + 1.0 / bad_s
    leave = bad_s**-1 / rate * -math.expm1(-rate * step_s)  # of the two-state Markov chain in continuous time
    assert runs.mean() == pytest.approx(1.0 / leave, rel=4 * math.sqrt((1 - leave) / len(runs)))
    longest = 40
    observed = np.bincount(np.minimum(runs, longest), minlength=longest + 1)[1:]
    chance = leave * (1.0 - leave) ** np.arange(longest)
    chance[-1] = 1.0 - chance[:-1].sum()
    assert scipy.stats.chisquare(observed, chance * len(runs)).pvalue > 1e-3


def test_a_bursty_link_begins_as_it_goes_on_and_ends_with_its_span() -> None:
    always = bursty()
    begun = [next(gilbert_elliott_phases(always, seed))[1] for seed in range(2000)]
    assert np.mean(begun) == pytest.approx(0.25, abs=4 * math.sqrt(0.25 * 0.75 / 2000))
    span = bursty(at_s=2.0, duration_s=5.0)
    times = [t for t, _ in gilbert_elliott_phases(span, 1)]
    assert times[0] == 2_000_000_000
    assert times == sorted(set(times))
    assert times[-1] < 7_000_000_000
    assert len(times) > 3


def test_the_directions_of_a_bursty_link_are_good_and_bad_by_themselves() -> None:
    there, back = spans(rule("burst_loss", mean_good_s=0.1, mean_bad_s=0.1))
    assert [t for t, _ in islice(gilbert_elliott_phases(there, 1), 9)] != [
        t for t, _ in islice(gilbert_elliott_phases(back, 1), 9)
    ]
