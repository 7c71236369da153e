"""Checks of covers that need no model: names and pitches."""

from skinnet.deployment import Deployment
from skinnet.errors import DeploymentError
from skinnet.skin.lattice import pitch_m

__all__ = ["check_covers"]

_LARGEST_PITCH_FRACTION = 1.1
"""Greatest pitch as a fraction of the cell's own: beyond, wires do not reach the neighbours."""


def check_covers(deployment: Deployment) -> None:
    """Check names and pitches of covers.

    Raises:
        DeploymentError: a name is given twice, or cells would overlap or lie too far apart for wires.
    """
    names: list[str] = []
    own_m = pitch_m(deployment.cells.side_m)
    for cover in deployment.cover:
        if cover.name in names:
            raise DeploymentError(f"cover: duplicate name {cover.name}; names must be unique")
        names.append(cover.name)
        given_m = cover.pitch_m
        if given_m is None or cover.kind == "sheet":
            continue
        most_m = _LARGEST_PITCH_FRACTION * own_m
        if given_m < own_m * (1.0 - 1e-6):
            raise DeploymentError(
                f"cover.{cover.name}.pitch_m = {given_m:g}: cells would overlap, as their own pitch is "
                f"{own_m:.4f} m (√3 × cells.side_m); give {own_m:.4f} to {most_m:.4f}, or smaller cells"
            )
        if given_m > most_m:
            raise DeploymentError(
                f"cover.{cover.name}.pitch_m = {given_m:g}: wires would not reach; give {own_m:.4f} to "
                f"{most_m:.4f} for cells of side {deployment.cells.side_m:g} m"
            )
