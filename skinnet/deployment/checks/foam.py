"""Checks of the foam: the rows of its compression curve, and its stiffness beside them."""

from collections.abc import Sequence

from skinnet.deployment.deployment import Deployment
from skinnet.deployment.robot import FoamSpec
from skinnet.errors import DeploymentError

__all__ = ["check_foam"]

_KEY = "body.foam.curve"
_MIN_ROW_STRAIN = 1e-4
"""Least difference of strain between two rows: slopes stay finite."""
_AGREEMENT = 0.01
"""Largest relative difference between a stiffness that is given and that of the curve."""


def check_foam(deployment: Deployment) -> None:
    """Check the compression curve of the foam, if there is one.

    Raises:
        DeploymentError: names key, row, value and what is allowed.
    """
    foam = deployment.body.foam
    if foam.curve is None:
        return
    curve = foam.curve
    columns = {"loading_kpa": curve.loading_kpa}
    if curve.unloading_kpa:
        columns["unloading_kpa"] = curve.unloading_kpa
    for name, column in columns.items():
        if len(column) != len(curve.strain):
            raise DeploymentError(
                f"{_KEY}.{name}: has {len(column)} rows, strain has {len(curve.strain)}; give one per strain"
            )
    _check_strain(curve.strain)
    for name, column in columns.items():
        _check_pressures(name, column)
    if curve.loading_kpa[1] == 0.0:
        raise DeploymentError(
            f"{_KEY}.loading_kpa[1] = 0: must be above 0; the foam starts to resist at once"
        )
    for row, (unloading, loading) in enumerate(zip(curve.unloading_kpa, curve.loading_kpa, strict=False)):
        if unloading > loading:
            raise DeploymentError(
                f"{_KEY}.unloading_kpa[{row}] = {unloading:g}: must be at most loading_kpa[{row}] = "
                f"{loading:g}; foam gives back no more than it took"
            )
    _check_stiffness(foam)


def _check_strain(strain: Sequence[float]) -> None:
    """Check that `strain` ascends from 0."""
    if strain[0] != 0.0:
        raise DeploymentError(f"{_KEY}.strain[0] = {strain[0]:g}: must be 0, uncompressed foam")
    for row in range(1, len(strain)):
        if strain[row] < strain[row - 1] + _MIN_ROW_STRAIN:
            raise DeploymentError(
                f"{_KEY}.strain[{row}] = {strain[row]:g}: must be at least {_MIN_ROW_STRAIN:g} above "
                f"strain[{row - 1}] = {strain[row - 1]:g}"
            )


def _check_pressures(name: str, column: Sequence[float]) -> None:
    """Check that a column of pressures starts at 0 and does not fall."""
    if column[0] != 0.0:
        raise DeploymentError(f"{_KEY}.{name}[0] = {column[0]:g}: must be 0, as the strain is")
    for row in range(1, len(column)):
        if column[row] < column[row - 1]:
            raise DeploymentError(
                f"{_KEY}.{name}[{row}] = {column[row]:g}: must be at least {name}[{row - 1}] = "
                f"{column[row - 1]:g}; pressure never falls as strain grows"
            )


def _check_stiffness(foam: FoamSpec) -> None:
    """Check that a stiffness which is given beside a curve is that of the curve."""
    given, own = foam.stiffness_pa_per_m, foam.secant_stiffness_pa_per_m
    if given != FoamSpec().stiffness_pa_per_m and abs(given - own) > _AGREEMENT * own:
        raise DeploymentError(
            f"body.foam.stiffness_pa_per_m = {given:g}: {_KEY} has {own:.4g} up to 40 % strain; leave one of "
            "them out, or give that value"
        )
