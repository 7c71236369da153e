"""Resistive power grid of the skin: the voltage at every cell, and brown-out of cells.

Power is routed passively [T11]: a wire is a resistor, and a cell passes power on whether it runs or not.
Supply and ground conductors connect the same cells in parallel, so their drops are equal, and one network
with the resistance of both conductors in series gives the voltage across a cell.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skinnet.deployment.network import PowerSpec
from skinnet.graph_components import connected_components

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

__all__ = ["PowerGrid", "PowerState"]

_RESOLUTION_V = 1e-9
"""Voltage resolution [V]: closer voltages are equal, so that the worst cell does not depend on rounding."""


class PowerState(NamedTuple):
    """Power state: steady-state voltages and currents of the grid.

    Attributes:
        voltage_v: (n,) voltage at every cell; 0 without a path to a feed [V].
        browned_out: (n,) cells that were on and whose voltage is too low to stay on.
        current_a: (m,) current from the first to the second end of every wire; 0 if it is cut [A].
        feed_current_a: (f,) current out of every feed [A].
    """

    voltage_v: NDArray[np.float64]
    browned_out: NDArray[np.bool_]
    current_a: NDArray[np.float64]
    feed_current_a: NDArray[np.float64]


class _Factorisation(NamedTuple):
    """Factorised conductance matrix and connected components, which depend on the wires only."""

    component: NDArray[np.int64]
    powered: NDArray[np.bool_]
    unknowns: NDArray[np.int64]
    factors: "SuperLU | None"


class PowerGrid:
    """Power grid of a skin, with any number of patches and bridges between them.

    Every cell that is on draws the same current, whatever its voltage (a linear regulator). If voltages are
    below the minimum, the cell with the lowest voltage of each connected component switches off first, which
    raises the others; this repeats until all remaining cells have enough. That is the order in which a
    sagging supply switches them off, and it keeps the most cells on: every cell that it switches off would
    also go off if all cells below the minimum were switched off at once, but not conversely. A cell that is
    off stays off until the next `solve`; otherwise it would return, be too low again, and oscillate. Every
    `solve` starts with all of `cell_on`: the result depends only on the present cells and wires, not on
    their history.

    Args:
        n_cells: Number of cells.
        wires: Rows of (cell, port, cell, port), or of (cell, cell).
        feeds: (f,) cells with a feed; a cell may have several feeds.
        spec: Supply voltage, resistances, current of a cell.
    """

    def __init__(self, n_cells: int, wires: ArrayLike, feeds: ArrayLike, spec: PowerSpec) -> None:
        ends = np.asarray(wires, dtype=np.int64)
        ends = ends.reshape(-1, ends.shape[-1] if ends.ndim == 2 else 2)
        self._a, self._b = ends[:, 0], ends[:, ends.shape[1] // 2]
        self._feeds = np.asarray(feeds, dtype=np.int64).reshape(-1)
        for name, cells in (("wires", ends[:, :: ends.shape[1] // 2]), ("feeds", self._feeds)):
            if cells.size and (cells.min() < 0 or cells.max() >= n_cells):
                raise ValueError(f"{name} contain a cell outside 0 to {n_cells - 1}")
        self._n = n_cells
        self._spec = spec
        self._n_feeds = np.bincount(self._feeds, minlength=n_cells)
        self._key = b""
        self._factored: _Factorisation | None = None

    def solve(self, cell_on: ArrayLike | None = None, wire_intact: ArrayLike | None = None) -> PowerState:
        """Solve for the power state in which every running cell has at least the minimum voltage.

        Args:
            cell_on: (n,) cells that are switched on; all by default.
            wire_intact: (m,) wires that are intact; all by default.

        Raises:
            ValueError: A mask has the wrong shape.
        """
        on = self._mask("cell_on", cell_on, self._n)
        ok = self._mask("wire_ok", wire_intact, len(self._a))
        factored = self._cached_factors(ok)
        running = on & factored.powered
        drop_v = self._voltage_drops(running, factored)
        limit_v = self._spec.supply_v - self._spec.brown_out_v
        while (low := running & (drop_v > limit_v + _RESOLUTION_V)).any():
            running[_lowest_voltage_cells(drop_v, low, factored.component)] = False
            drop_v = self._voltage_drops(running, factored)
        voltage_v = np.where(factored.powered, self._spec.supply_v - drop_v, 0.0)
        current_a = np.where(ok, (voltage_v[self._a] - voltage_v[self._b]) / self._spec.link_ohm, 0.0)
        return PowerState(
            voltage_v, on & ~running, current_a, self._feed_currents(running, drop_v, current_a)
        )

    def _mask(self, name: str, values: ArrayLike | None, n: int) -> NDArray[np.bool_]:
        mask = np.ones(n, dtype=np.bool_) if values is None else np.array(values, dtype=np.bool_)
        if mask.shape != (n,):
            raise ValueError(f"{name} has shape {mask.shape}; give ({n},)")
        return mask

    def _cached_factors(self, ok: NDArray[np.bool_]) -> _Factorisation:
        """Return the cached factors unless the wires have changed."""
        key = ok.tobytes()
        if self._factored is None or key != self._key:
            self._key, self._factored = key, self._factorise(ok)
        return self._factored

    def _factorise(self, ok: NDArray[np.bool_]) -> _Factorisation:
        n, a, b = self._n, self._a[ok], self._b[ok]
        siemens = np.full(len(a), 1.0 / self._spec.link_ohm)
        piece = connected_components(n, a, b)
        fed = self._n_feeds > 0
        powered = np.isin(piece, piece[fed])
        ideal = fed & (self._spec.feed_ohm == 0.0)  # such a cell is at the supply voltage
        free = np.flatnonzero(powered & ~ideal)
        if not len(free):
            return _Factorisation(piece, powered, free, None)
        from scipy.sparse import coo_array  # their import takes longer than most commands
        from scipy.sparse.linalg import splu

        cells = np.arange(n)
        to_supply = self._n_feeds / self._spec.feed_ohm if self._spec.feed_ohm else np.zeros(n)
        laplacian = coo_array(
            (
                np.concatenate([siemens, siemens, -siemens, -siemens, to_supply]),
                (np.concatenate([a, b, a, b, cells]), np.concatenate([a, b, b, a, cells])),
            ),
            shape=(n, n),
        ).tocsc()
        # symmetric and diagonally dominant: no pivoting, fill-reducing ordering
        factors = splu(
            laplacian[free][:, free],
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        return _Factorisation(piece, powered, free, factors)

    def _voltage_drops(self, running: NDArray[np.bool_], factored: _Factorisation) -> NDArray[np.float64]:
        """Return the voltage drop (n,) of every cell below the supply [V]; zero without load."""
        drop_v = np.zeros(self._n)
        if factored.factors is not None:
            drop_v[factored.unknowns] = factored.factors.solve(
                self._load_currents(running)[factored.unknowns]
            )
        return drop_v

    def _load_currents(self, running: NDArray[np.bool_]) -> NDArray[np.float64]:
        return np.where(running, self._spec.current_ma * 1e-3, 0.0)

    def _feed_currents(
        self, running: NDArray[np.bool_], drop_v: NDArray[np.float64], current_a: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        if self._spec.feed_ohm:
            through_a: NDArray[np.float64] = drop_v[self._feeds] / self._spec.feed_ohm
            return through_a
        out_a = self._load_currents(running)
        np.add.at(out_a, self._a, current_a)
        np.add.at(out_a, self._b, -current_a)
        shared_a: NDArray[np.float64] = out_a[self._feeds] / self._n_feeds[self._feeds]
        return shared_a


def _lowest_voltage_cells(
    drop_v: NDArray[np.float64], low: NDArray[np.bool_], component: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the cell of lowest voltage in every component with cells in `low`, the first of equals."""
    cells = np.flatnonzero(low)
    order = cells[np.lexsort((cells, -np.round(drop_v[cells] / _RESOLUTION_V), component[cells]))]
    return order[np.unique(component[order], return_index=True)[1]]
