"""`skinnet bench network`: what it says of agreement, absence and the published case; never of speed."""

import json
import shutil
import sys
from typing import Any

import numpy as np
import pytest

from skinnet.cli.main import main
from skinnet.tools.bench import kernel_benchmark as network
from skinnet.tools.bench import reference_network as heapq_network
from skinnet.tools.bench.workload import CELLS_PER_PATCH, PERIOD_NS, make_workload

CELLS = 60  # a full patch and a part of one


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "_CELLS", CELLS)
    monkeypatch.setattr(network, "_SIZES", (CELLS, 120, 10**6))  # the last is not for a quick look
    monkeypatch.setattr(network, "_IDLE_CALLS", 10)
    monkeypatch.setattr(shutil, "which", lambda _: None)  # ns-3 has tests of its own


def test_all_simulators_agree_and_figures_are_flat() -> None:
    said: list[str] = []
    figures = network.run_benchmarks(quick=True, progress=said.append)
    assert figures["agrees.heapq"]
    assert figures["agrees.simpy"]
    assert figures["ratio.ns3"] is None
    assert "apt-get install" in figures["missing.ns3"]
    assert figures["uart8.ms"] == 6.3
    # every cell of a patch is as many hops from its interface as steps along column and row, and one
    depths = [sum(divmod(place % CELLS_PER_PATCH, 10)) + 1 for place in range(CELLS)]
    assert figures["packets"] == 5 * CELLS
    assert figures["packet_hops"] == 5 * sum(depths)
    for name in ("ratio.heapq", "ratio.simpy", "hops_per_s.cells_120", "bytes_per_cell.cells_120"):
        assert figures[name] > 0
    assert "hops_per_s.cells_1000000" not in figures
    assert all(isinstance(value, int | float | str | None) for value in figures.values())
    assert any("simpy" in text for text in said)


def test_a_simulator_that_disagrees_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = heapq_network.simulate

    def late(*arguments: Any) -> list[heapq_network.PacketOutcome]:
        first, *rest = honest(*arguments)
        return [(first[0], first[1] + 1, *first[2:]), *rest]

    monkeypatch.setattr(heapq_network, "simulate", late)
    figures = network.run_benchmarks(quick=True)
    assert not figures["agrees.heapq"]
    assert figures["agrees.simpy"]


def test_without_simpy_the_figure_is_missing_and_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "simpy", None)
    monkeypatch.setattr(sys, "argv", ["skinnet", "bench", "network", "--quick", "--json", "-"])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code in (0, None)
    out, err = capsys.readouterr()
    figures = json.loads(out)["metrics"]
    assert figures["ratio.simpy"] is None
    assert figures["missing.simpy"] == "not installed; pip install simpy"
    assert "ratio.heapq" in err


def test_the_patches_send_once_a_period_and_never_drop() -> None:
    work = make_workload(130, 3)
    assert np.all(np.diff(work.t_ns) >= 0)
    assert work.topology.n_nodes == 130 + 3
    assert np.array_equal(np.bincount(work.node)[work.node], np.full(3 * 130, 3))
    of_one = np.sort(work.t_ns[work.node == work.node[0]])
    assert np.all(np.diff(of_one) == PERIOD_NS)
    ports = np.stack([work.topology.src, work.topology.src_port])
    assert ports[1].max() < 4  # cells have four ports
