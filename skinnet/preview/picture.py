"""Picture of a preview: the layers from six sides, with a legend."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.image
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from skinnet.body.mesh_rendering import ColouredMesh, View, render_meshes
from skinnet.preview.layers import Layer

__all__ = ["bounding_sphere_m", "draw_picture", "legend_labels"]

_VIEWS = {
    "from +x": View(180.0, -15.0),
    "from +y": View(-90.0, -15.0),
    "from above": View(135.0, -60.0),
    "from −x": View(0.0, -15.0),
    "from −y": View(90.0, -15.0),
    "from below": View(-45.0, 50.0),
}
_COLUMNS = 3
_VIEW_PX = (640, 560)
_DPI = 100
_LEGEND_PX = 60


def draw_picture(layers: Sequence[Layer], title: str, out: Path) -> str:
    """Draw the layers into the PNG file `out`; return "", or why there is no picture on this computer."""
    meshes = [ColouredMesh(*layer.mesh, layer.rgb) for layer in layers]
    written, reason = render_meshes(
        meshes, out, list(_VIEWS.values()), _COLUMNS, bounding_sphere_m(layers), _VIEW_PX
    )
    if written is None:
        return reason
    pixels = matplotlib.image.imread(out)
    height_px, width_px = pixels.shape[0] + 2 * _LEGEND_PX, pixels.shape[1]
    figure = Figure(figsize=(width_px / _DPI, height_px / _DPI), dpi=_DPI)
    _place_views(figure, pixels, height_px)
    figure.suptitle(title, fontsize=15, y=1.0 - 0.2 * _LEGEND_PX / height_px)
    patches = [
        Patch(facecolor=[part / 255.0 for part in layer.rgb], edgecolor="0.4", label=label)
        for layer, label in zip(layers, legend_labels(layers), strict=True)
    ]
    figure.legend(handles=patches, loc="lower center", ncols=len(patches), fontsize=10, frameon=False)
    figure.savefig(out)
    return ""


def _place_views(figure: Figure, pixels: NDArray[np.float32], height_px: int) -> None:
    axes = figure.add_axes((0.0, _LEGEND_PX / height_px, 1.0, pixels.shape[0] / height_px))
    axes.imshow(pixels, aspect="auto", interpolation="none")
    axes.set_axis_off()
    for number, name in enumerate(_VIEWS):
        row, column = divmod(number, _COLUMNS)
        axes.text(column * _VIEW_PX[0] + 12, row * _VIEW_PX[1] + 24, name, fontsize=10, color="0.3")


def legend_labels(layers: Sequence[Layer]) -> list[str]:
    """Legend labels: name of each layer, with the number of things in it."""
    return [f"{layer.name} ({layer.number})" if layer.number else layer.name for layer in layers]


def bounding_sphere_m(layers: Sequence[Layer]) -> tuple[tuple[float, float, float], float]:
    """Centre and radius [m] of a sphere around the bodies, or around the skin if there are none.

    Skin that lies far off the bodies is out of view; else they would be too small to be seen.
    """
    bodies = [layer for layer in layers if not layer.is_skin] or list(layers)
    points_m = np.concatenate([layer.mesh.vertices_m for layer in bodies])
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    centre_m = 0.5 * (low_m + high_m)
    radius_m = float(np.sqrt(((points_m - centre_m) ** 2).sum(axis=1).max()))
    x, y, z = centre_m.tolist()
    return (x, y, z), max(radius_m, 1e-3)
