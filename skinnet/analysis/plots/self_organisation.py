"""Plots of self-organisation: activity matrix, kinematic tree [M14, Fig. 4], sensory-motor map."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from skinnet.deployment import Deployment
from skinnet.runtime.process_result import ProcessResult

__all__ = ["patch_ticks", "plot_activity", "plot_map", "plot_tree"]

_LEVEL_GAP = 1.0
_INK = "#1f3b57"


def plot_activity(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the activity matrix: DoFs against the cells that they move."""
    controller = results.get("controller")
    if controller is None or "activity" not in controller.arrays:
        return None
    figure = Figure(figsize=(6.4, 8.0), layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(
        controller.arrays["activity"],
        aspect="auto",
        interpolation="none",
        cmap=ListedColormap(["#eef1f4", _INK]),
    )
    axes.set_title("Activity matrix: DoFs against the cells that they move")
    _label_dofs(axes, deployment)
    patch_ticks(axes, deployment)
    return figure


def plot_map(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the sensory-motor map of every explored pose, side by side."""
    controller = results.get("controller")
    if controller is None or "map" not in controller.arrays:
        return None
    maps = controller.arrays["map"]
    figure = Figure(figsize=(1.6 + 5.2 * len(maps), 8.0), layout="constrained")
    grid = figure.subplots(1, len(maps), squeeze=False)[0]
    for index, (axes, weights) in enumerate(zip(grid, maps, strict=True)):
        image = axes.imshow(weights, aspect="auto", interpolation="none", cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        axes.set_title(f"Sensory-motor map, pose {index + 1}" if len(maps) > 1 else "Sensory-motor map")
        _label_dofs(axes, deployment)
        patch_ticks(axes, deployment)
    figure.colorbar(image, ax=grid, label="weight; positive: a positive velocity takes the cell inwards")
    return figure


def plot_tree(deployment: Deployment, results: dict[str, ProcessResult]) -> Figure | None:
    """Plot the explored kinematic tree of body parts and joints, from the reference part outwards."""
    controller = results.get("controller")
    if controller is None or "structure" not in controller.facts:
        return None
    found = controller.facts["structure"]
    owners = [patch for patch, _ in controller.facts["cells"]]
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set_title("Kinematic tree found by the skin: body parts (boxes) and joints (DoFs on the lines)")
    spots = _tree_layout(found["parent_part"])
    for part, (x, y) in spots.items():
        parent = found["parent_part"][part]
        if parent in spots:
            _draw_joint(axes, deployment, found, part, spots[parent], (x, y))
    for part, (x, y) in spots.items():
        cells = found["parts"][part]
        patches = sorted({owners[cell] for cell in cells})
        axes.text(
            x,
            y,
            f"part {part}: {len(cells)} cells\n{', '.join(patches)}",
            ha="center",
            va="center",
            bbox={"boxstyle": "round,pad=0.5", "facecolor": "#dbe7f3", "edgecolor": _INK},
        )
    for line, problem in enumerate(found["problems"]):
        axes.text(0.01, 0.02 + 0.05 * line, f"no tree: {problem}", transform=axes.transAxes, color="#b3261e")
    x_values, y_values = zip(*spots.values(), strict=True) if spots else ((0.0,), (0.0,))
    axes.set_xlim(min(x_values) - 0.8, max(x_values) + 0.8)
    axes.set_ylim(min(y_values) - 0.5, max(y_values) + 0.5)
    return figure


def _draw_joint(
    axes: Axes,
    deployment: Deployment,
    found: dict[str, list[list[int]]],
    part: int,
    start: tuple[float, float],
    end: tuple[float, float],
) -> None:
    axes.plot([start[0], end[0]], [start[1], end[1]], color=_INK, linewidth=1.5, zorder=0)
    dofs = found["joints"][found["parent_joint"][part]]  # type: ignore[call-overload]
    names = "\n".join(deployment.body.joints[dof] for dof in dofs)
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    axes.text(
        *middle, names, ha="center", va="center", fontsize=7, bbox={"facecolor": "white", "edgecolor": "none"}
    )


def _tree_layout(parent_part: list[int]) -> dict[int, tuple[float, float]]:
    """Layout of the tree: depth downwards, leaves side by side, parents centred above their children."""
    children: dict[int, list[int]] = {}
    roots = []
    for part, parent in enumerate(parent_part):
        if parent < 0 or parent == part:
            roots.append(part)
        else:
            children.setdefault(parent, []).append(part)
    spots: dict[int, tuple[float, float]] = {}
    next_x = 0.0

    def place(part: int, depth: int) -> float:
        nonlocal next_x
        below = [place(child, depth + 1) for child in children.get(part, []) if child not in spots]
        if below:
            x = sum(below) / len(below)
        else:
            x, next_x = next_x, next_x + 1.6
        spots[part] = (x, -depth * _LEVEL_GAP)
        return x

    for root in roots:
        place(root, 0)
    return spots


def patch_ticks(axes: Axes, deployment: Deployment) -> None:
    """Label the patches along a vertical axis of cells, with lines between them."""
    sizes = [patch.n_cells for patch in deployment.patches]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    axes.set_yticks((starts[:-1] + starts[1:] - 1) / 2, [patch.name for patch in deployment.patches])
    axes.tick_params(axis="y", length=0)
    for start in starts[1:-1]:
        axes.axhline(start - 0.5, color="#8a97a3", linewidth=0.6)


def _label_dofs(axes: Axes, deployment: Deployment) -> None:
    joints = deployment.body.joints
    axes.set_xticks(range(len(joints)), joints, rotation=90, fontsize=7)
