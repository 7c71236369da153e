"""Tables of a long-term memory: robot, key poses, touch areas, parameters."""

from collections import Counter

import numpy as np
from rich.console import Console
from rich.table import Table

from skinnet.memory.contents import MemoryContents

__all__ = ["print_memory"]


def print_memory(console: Console, memory: MemoryContents) -> None:
    """Print the robot, structure, key poses, touch areas and parameters of a memory."""
    for table in (_robot_table(memory), _pose_table(memory), _area_table(memory), _parameter_table(memory)):
        if table.row_count:
            console.print(table)


def _robot_table(memory: MemoryContents) -> Table:
    """Build the table of the robot and its explored structure."""
    robot = memory.robot
    table = Table(title=f"memory of {robot.name}", show_header=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row(f"{len(robot.joints)} joints", ", ".join(robot.joints))
    sizes = ", ".join(f"{patch} {cells}" for patch, cells in robot.patches.items())
    table.add_row(f"{robot.n_cells} cells", sizes)
    if memory.activity is None:
        table.add_row("structure", "not explored")
    else:
        moved = np.count_nonzero(memory.activity.any(axis=1))
        entries = np.count_nonzero(memory.activity)
        table.add_row("structure", f"{moved} cells move, {entries} of {memory.activity.size} entries active")
        if len(memory.unmeasured):
            table.add_row("not measured", _counts_by_patch(memory, memory.unmeasured))
    return table


def _pose_table(memory: MemoryContents) -> Table:
    """Build the table of key poses: joint positions [rad], of slide joints [m]."""
    table = Table(title="key poses [rad, slide joints m]")
    table.add_column("joint", style="bold")
    for name in memory.poses:
        table.add_column(name, justify="right")
    if memory.poses:
        poses = memory.poses.values()
        for joint, *positions in zip(memory.robot.joints, *(p.position_rad for p in poses), strict=True):
            table.add_row(joint, *(f"{position:.3f}" for position in positions))
        table.add_section()
        table.add_row("map", *("no" if pose.weights is None else "yes" for pose in poses))
    return table


def _area_table(memory: MemoryContents) -> Table:
    table = Table("area", "cells", "of each patch", title="touch areas")
    for label, cells in memory.areas.items():
        table.add_row(label, str(len(cells)), _counts_by_patch(memory, cells))
    return table


def _parameter_table(memory: MemoryContents) -> Table:
    table = Table("parameter", "value", title="parameters")
    for name, value in memory.parameters.items():
        table.add_row(name, f"{value:g}")
    return table


def _counts_by_patch(memory: MemoryContents, cells: np.typing.NDArray[np.int64]) -> str:
    places = memory.robot.cells()
    counts = Counter(places[cell][0] for cell in cells)
    return ", ".join(f"{patch} {count}" for patch, count in counts.items())
