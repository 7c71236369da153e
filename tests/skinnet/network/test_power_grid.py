"""The power network obeys Ohm and Kirchhoff, equals a dense solve, and browns out as few cells as it can."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from small_robot import small

from skinnet.deployment.network import PowerSpec
from skinnet.errors import DeploymentError
from skinnet.network.power_grid import PowerGrid, PowerState

Floats = NDArray[np.float64]
AMPERE = 0.047
LOW = 1e-6
"""A minimum that no cell falls below: the network is linear then."""


def spec(**fields: Any) -> PowerSpec:
    return PowerSpec(**({"brown_out_v": LOW} | fields))


def line(n: int) -> list[tuple[int, int]]:
    return [(i, i + 1) for i in range(n - 1)]


@st.composite
def skins(draw: st.DrawFn) -> tuple[int, list[tuple[int, int]], list[int]]:
    """Any graph of cells, in any number of pieces, fed anywhere, more than once or not at all."""
    n = draw(st.integers(1, 9))
    cell = st.integers(0, n - 1)
    wires = draw(st.lists(st.tuples(cell, cell).filter(lambda ends: ends[0] != ends[1]), max_size=14))
    return n, wires, draw(st.lists(cell, max_size=4))


ohms = st.sampled_from([0.0, 0.02, 0.4])


def dense(n: int, wires: list[tuple[int, int]], feeds: list[int], table: PowerSpec, on: Any) -> Floats:
    """Voltages by modified nodal analysis, as circuit simulators do it: the unknowns are the voltages and the
    currents out of the feeds; least squares give what is not fed the voltage 0 without its load."""
    fed = set(feeds)
    while any((a in fed) != (b in fed) for a, b in wires):
        fed |= {cell for a, b in wires for cell in (a, b) if a in fed or b in fed}
    rows = np.zeros((n + len(feeds), n + len(feeds)))
    right = np.zeros(n + len(feeds))
    for a, b in wires:
        for x, y in ((a, b), (b, a)):
            rows[x, x] += 1 / table.link_ohm
            rows[x, y] -= 1 / table.link_ohm
    for cell in fed:
        right[cell] = -table.current_ma * 1e-3 * on[cell]
    for k, cell in enumerate(feeds):
        rows[cell, n + k] = -1.0
        rows[n + k, cell] = 1.0
        rows[n + k, n + k] = table.feed_ohm
        right[n + k] = table.supply_v
    return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0][:n], dtype=np.float64)


@given(skin=skins(), feed_ohm=ohms, data=st.data())
def test_voltages_equal_a_dense_solve(skin: Any, feed_ohm: float, data: st.DataObject) -> None:
    n, wires, feeds = skin
    table = spec(feed_ohm=feed_ohm, link_ohm=0.07)
    on = data.draw(st.lists(st.booleans(), min_size=n, max_size=n))
    ok = data.draw(st.lists(st.booleans(), min_size=len(wires), max_size=len(wires)))
    state = PowerGrid(n, np.array(wires).reshape(-1, 2), feeds, table).solve(on, ok)
    whole = [wire for wire, good in zip(wires, ok, strict=True) if good]
    np.testing.assert_allclose(state.voltage_v, dense(n, whole, feeds, table, on), atol=1e-9)


@given(skin=skins(), feed_ohm=ohms, minimum=st.sampled_from([LOW, 3.2, 3.27, 3.29]))
def test_kirchhoff_ohm_and_power(skin: Any, feed_ohm: float, minimum: float) -> None:
    """Currents of a cell add up to what it draws, around every wire Ohm's law, and no power gets lost."""
    n, wires, feeds = skin
    table = spec(feed_ohm=feed_ohm, brown_out_v=minimum)
    state = PowerGrid(n, np.array(wires).reshape(-1, 2), feeds, table).solve()
    drawn = np.where(state.browned_out, 0.0, AMPERE)
    balance = -drawn
    np.add.at(balance, feeds, state.feed_current_a)
    for (a, b), current in zip(wires, state.current_a, strict=True):
        balance[a] -= current
        balance[b] += current
        assert current * table.link_ohm == pytest.approx(state.voltage_v[a] - state.voltage_v[b], abs=1e-12)
    np.testing.assert_allclose(balance, 0.0, atol=1e-9)
    assert state.feed_current_a.sum() == pytest.approx(drawn.sum(), abs=1e-9)
    burnt = table.link_ohm * (state.current_a**2).sum() + feed_ohm * (state.feed_current_a**2).sum()
    delivered = (drawn * state.voltage_v).sum()
    assert table.supply_v * state.feed_current_a.sum() == pytest.approx(burnt + delivered, abs=1e-9)


@given(skin=skins(), feed_ohm=ohms, data=st.data())
def test_drops_superpose(skin: Any, feed_ohm: float, data: st.DataObject) -> None:
    n, wires, feeds = skin
    grid = PowerGrid(n, np.array(wires).reshape(-1, 2), feeds, spec(feed_ohm=feed_ohm))
    some = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)))
    nothing = grid.solve(np.zeros(n, dtype=bool)).voltage_v
    assert set(np.unique(nothing)) <= {0.0, 3.3}
    parts = [nothing - grid.solve(on).voltage_v for on in (some, ~some)]
    np.testing.assert_allclose(sum(parts), nothing - grid.solve().voltage_v, atol=1e-9)


@given(skin=skins(), feed_ohm=ohms, more=st.integers(0, 8))
def test_one_more_feed_lowers_no_voltage(skin: Any, feed_ohm: float, more: int) -> None:
    n, wires, feeds = skin
    ends, table = np.array(wires).reshape(-1, 2), spec(feed_ohm=feed_ohm)
    before = PowerGrid(n, ends, feeds, table).solve()
    after = PowerGrid(n, ends, [*feeds, more % n], table).solve()
    assert (after.voltage_v >= before.voltage_v - 1e-9).all()


@given(skin=skins().filter(lambda skin: bool(skin[1])), feed_ohm=ohms, cut=st.integers(0, 13))
def test_a_cut_wire_costs_power(skin: Any, feed_ohm: float, cut: int) -> None:
    """Rayleigh's law: what resistors burn can only grow, so the mean voltage of equal loads can only fall.

    Single voltages may rise: those of cells that no longer help out their neighbours.
    """
    n, wires, feeds = skin
    grid = PowerGrid(n, np.array(wires), feeds, spec(feed_ohm=feed_ohm))
    whole, less = grid.solve(), grid.solve(wire_intact=np.arange(len(wires)) != cut % len(wires))
    still_fed = less.voltage_v > 0
    if (still_fed == (whole.voltage_v > 0)).all():
        assert less.voltage_v.sum() <= whole.voltage_v.sum() + 1e-9


def test_a_line_drops_quadratically() -> None:
    """Equal loads along a line: the k-th wire carries what lies behind it, so the drop is a sum of n − k."""
    n, table = 12, spec()
    state = PowerGrid(n, line(n), [0], table).solve()
    k = np.arange(n)
    drop = AMPERE * table.link_ohm * (k * (n - 1) - k * (k - 1) / 2)
    np.testing.assert_allclose(state.voltage_v, 3.3 - drop, atol=1e-12)
    np.testing.assert_allclose(state.current_a, AMPERE * (n - 1 - k[:-1]), atol=1e-12)
    assert state.feed_current_a.tolist() == pytest.approx([n * AMPERE])


def test_a_line_fed_at_both_ends_is_two_lines() -> None:
    state = PowerGrid(11, line(11), [0, 10], spec()).solve()
    np.testing.assert_allclose(state.voltage_v, state.voltage_v[::-1], atol=1e-12)
    assert state.voltage_v.argmin() == 5
    half = PowerGrid(6, line(6), [0], spec()).solve(np.arange(6) < 5).voltage_v
    middle = AMPERE / 2 * 0.05 * np.arange(6)  # each end bears half of the cell in the middle
    np.testing.assert_allclose(state.voltage_v[:6], half - middle, atol=1e-12)


def test_a_ring_is_symmetric() -> None:
    n = 10
    state = PowerGrid(n, [*line(n), (n - 1, 0)], [0], spec()).solve()
    np.testing.assert_allclose(state.voltage_v[1:], state.voltage_v[:0:-1], atol=1e-12)
    opened = PowerGrid(n, [*line(n), (n - 1, 0)], [0], spec()).solve(wire_intact=np.arange(n) != n - 1)
    assert (opened.voltage_v[1:] < state.voltage_v[1:]).all()


def test_a_feed_with_resistance_drops_for_all() -> None:
    single = PowerGrid(1, np.empty((0, 2)), [0], spec(feed_ohm=0.5)).solve()
    assert single.voltage_v.tolist() == pytest.approx([3.3 - 0.5 * AMPERE])
    twice = PowerGrid(1, np.empty((0, 4)), [0, 0], spec(feed_ohm=0.5)).solve()
    assert twice.voltage_v.tolist() == pytest.approx([3.3 - 0.25 * AMPERE])
    assert twice.feed_current_a.tolist() == pytest.approx([AMPERE / 2, AMPERE / 2])


def test_wires_with_ports_are_the_same_wires() -> None:
    with_ports = np.array([[0, 3, 1, 2], [1, 0, 2, 2]])
    a, b = (PowerGrid(3, wires, [0], spec()).solve() for wires in (with_ports, with_ports[:, [0, 2]]))
    assert a.voltage_v.tolist() == b.voltage_v.tolist()


def shed_one_by_one(linear: PowerGrid, brown_out_v: float, n: int) -> list[int]:
    """Who leaves by the rule as the documentation has it: the worst of all, again and again."""
    on = np.ones(n, dtype=bool)
    gone: list[int] = []
    while True:
        voltage_v = linear.solve(on).voltage_v
        low = np.flatnonzero(on & (voltage_v < brown_out_v - 1e-9))
        if not len(low):
            return gone
        worst = low[np.argmin(voltage_v[low].round(8))]
        on[worst] = False
        gone.append(int(worst))


@given(skin=skins(), feed_ohm=ohms, minimum=st.sampled_from([3.15, 3.2, 3.25, 3.28, 3.29]))
def test_brown_out_is_a_fixed_point(skin: Any, feed_ohm: float, minimum: float) -> None:
    n, wires, feeds = skin
    ends = np.array(wires).reshape(-1, 2)
    grid = PowerGrid(n, ends, feeds, spec(feed_ohm=feed_ohm, brown_out_v=minimum))
    linear = PowerGrid(n, ends, feeds, spec(feed_ohm=feed_ohm))
    state = grid.solve()
    on = ~state.browned_out
    assert (state.voltage_v[on] >= minimum - 1e-9).all()
    np.testing.assert_allclose(state.voltage_v, linear.solve(on).voltage_v, atol=1e-12)
    all_low = linear.solve().voltage_v < minimum - 1e-9
    assert (all_low | on).all(), "whoever left had too little to begin with"
    assert sorted(shed_one_by_one(linear, minimum, n)) == np.flatnonzero(~on).tolist()


def test_the_far_end_of_a_line_browns_out_and_the_rest_recovers() -> None:
    """Some that are too low at first may stay: the line is as long as the law of its last cell allows."""
    n, table = 40, PowerSpec()
    state = PowerGrid(n, line(n), [0], table).solve()
    left = int((~state.browned_out).sum())
    assert state.browned_out.tolist() == [False] * left + [True] * (n - left)

    def end_v(cells: int) -> float:
        return table.supply_v - AMPERE * table.link_ohm * cells * (cells - 1) / 2

    assert end_v(left) >= table.brown_out_v > end_v(left + 1)
    together = PowerGrid(n, line(n), [0], spec()).solve().voltage_v < table.brown_out_v
    assert together.sum() > n - left + 1
    np.testing.assert_allclose(state.voltage_v[left:], state.voltage_v[left - 1], atol=1e-12)


def test_equal_cells_leave_by_number_and_pieces_do_not_wait_for_each_other() -> None:
    """Three arms of one star are equal; two stars lose their cells as each alone."""
    star = [(0, 1), (0, 2), (0, 3)]
    table = PowerSpec(feed_ohm=1.0, brown_out_v=3.13)
    alone = PowerGrid(4, star, [0], table).solve()
    assert alone.browned_out.tolist() == [False, True, False, False]
    both = PowerGrid(8, [*star, *((a + 4, b + 4) for a, b in star)], [0, 4], table).solve()
    assert both.browned_out.tolist() == 2 * alone.browned_out.tolist()
    np.testing.assert_allclose(both.voltage_v, np.tile(alone.voltage_v, 2), atol=1e-12)


def test_what_no_wire_leads_to_has_no_voltage() -> None:
    grid = PowerGrid(4, line(4), [0], PowerSpec())
    state = grid.solve(wire_intact=[True, False, True])
    assert state.voltage_v[2:].tolist() == [0.0, 0.0]
    assert state.browned_out.tolist() == [False, False, True, True]
    assert state.current_a[1:].tolist() == [0.0, 0.0]
    off = grid.solve(cell_on=[True, True, False, True], wire_intact=[True, False, True])
    assert off.browned_out.tolist() == [False, False, False, True]  # a dead cell does not brown out
    nobody = PowerGrid(2, line(2), [], PowerSpec()).solve()
    assert nobody.browned_out.all()
    assert nobody.feed_current_a.shape == (0,)


def test_a_repair_brings_everything_back() -> None:
    """The state depends on what is in order now, not on what was before."""
    grid = PowerGrid(20, line(20), [0, 19], PowerSpec(brown_out_v=3.0))
    whole = grid.solve()
    cut = grid.solve(wire_intact=np.arange(19) != 17)
    assert cut.browned_out.any()
    assert_equal(grid.solve(), whole)
    assert_equal(grid.solve(wire_intact=np.arange(19) != 17), cut)


def assert_equal(one: PowerState, other: PowerState) -> None:
    for mine, theirs in zip(one, other, strict=True):
        assert mine.tolist() == theirs.tolist()


def test_published_power_of_2600_cells() -> None:
    """2600 cells at 47 mA and 3.3 V are about 400 W [T11]."""
    n = 2600
    state = PowerGrid(n, np.empty((0, 2)), np.arange(n), PowerSpec()).solve()
    assert 3.3 * state.feed_current_a.sum() == pytest.approx(400.0, rel=0.01)


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="feeds contain a cell outside 0 to 1"):
        PowerGrid(2, line(2), [2], PowerSpec())
    with pytest.raises(ValueError, match="wires contain a cell outside 0 to 0"):
        PowerGrid(1, line(2), [0], PowerSpec())
    with pytest.raises(ValueError, match=r"cell_on has shape \(3,\)"):
        PowerGrid(2, line(2), [0], PowerSpec()).solve([True] * 3)
    with pytest.raises(DeploymentError, match=r"power.*brown_out_v = 3.5: must be below supply_v = 3.3"):
        small(power={"brown_out_v": 3.5})
