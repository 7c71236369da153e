"""Colour scales, one for each modality, shared by the body view and all panels."""

from dataclasses import dataclass

import matplotlib
import numpy as np
from numpy.typing import NDArray

from skinnet.protocol.messages import Modality

__all__ = [
    "COLOUR_SCALES",
    "N_COLOURS",
    "UNKNOWN_INDEX",
    "UNREACHABLE_INDEX",
    "ColourScale",
    "colour_indices",
    "css_colour",
    "palette",
]

N_COLOURS = 64
"""Number of colours of the scale; the indices of unknown and of unreachable follow."""
UNKNOWN_INDEX, UNREACHABLE_INDEX = N_COLOURS, N_COLOURS + 1
_UNKNOWN_RGB, _UNREACHABLE_RGB = (176, 182, 191), (22, 22, 26)
_COLOUR_MAP, _MAP_MIN, _MAP_MAX = "turbo", 0.06, 0.94
"""Colour map and its range, as in the plots of a run."""


@dataclass(frozen=True)
class ColourScale:
    """Colour scale of values, normalised to 0 to 1.

    Attributes:
        low: Value at the lower end.
        high: Value at the upper end.
        square_root: Use the square root, which spreads the frequent low values.
        unit: Unit of the values.
        ticks: Tick values of the legend.
    """

    low: float
    high: float
    square_root: bool
    unit: str
    ticks: tuple[float, ...]

    def normalise(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normalise `values` (n,) to 0 to 1, clipped."""
        share = np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)
        places: NDArray[np.float64] = np.sqrt(share) if self.square_root else share
        return places


COLOUR_SCALES = {  # force and proximity begin above three standard deviations of their noise
    Modality.FORCE: ColourScale(0.012, 1.0, True, "", (0.04, 0.1, 0.3, 0.45, 1.0)),
    Modality.PROXIMITY: ColourScale(0.004, 1.0, True, "", (0.01, 0.1, 0.3, 0.8)),
    Modality.ACCELERATION: ColourScale(0.5, 1.5, False, "g", (0.5, 1.0, 1.5)),
    Modality.TEMPERATURE: ColourScale(20.0, 36.0, False, "°C", (20.0, 24.0, 28.0, 32.0, 36.0)),
}
PRESSURE_SCALE = ColourScale(0.0, 60.0, True, "kPa", (1.0, 5.0, 20.0, 60.0))
"""Pressure scale of sheet elements, up to 60 kPa, which people find uncomfortable."""


def palette() -> NDArray[np.uint8]:
    """Palette (N_SHADES + 2, 3) of RGB colours."""
    scale = matplotlib.colormaps[_COLOUR_MAP](np.linspace(_MAP_MIN, _MAP_MAX, N_COLOURS))[:, :3]
    scale = np.round(255 * scale).astype(np.uint8)
    return np.vstack([scale, np.array([_UNKNOWN_RGB, _UNREACHABLE_RGB], dtype=np.uint8)])


def colour_indices(
    modality: Modality, values: NDArray[np.float64], n_cells: int, unreachable: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Colour index (spots,) of every taxel.

    Args:
        modality: Modality of `values`.
        values: (spots,) of the cells, then of the elements; NaN where unknown.
        n_cells: Number of cells.
        unreachable: (cells,) whether a cell is unreachable.
    """
    place = np.concatenate(
        [COLOUR_SCALES[modality].normalise(values[:n_cells]), PRESSURE_SCALE.normalise(values[n_cells:])]
    )
    found = np.isfinite(place)
    shade = np.full(len(values), UNKNOWN_INDEX)
    shade[found] = np.minimum((place[found] * N_COLOURS).astype(np.int64), N_COLOURS - 1)
    shade[:n_cells][unreachable] = UNREACHABLE_INDEX
    return shade


def css_colour(rgb: NDArray[np.uint8]) -> str:
    """CSS form of an RGB colour (3,)."""
    red, green, blue = rgb.tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"
