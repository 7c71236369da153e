"""RIBA with all its sheets, holding 3 kg as experiment B does: for the tests of its body."""

from locations import DEPLOYMENTS

from skinnet.body.simulation import BodySimulation
from skinnet.deployment.load import load

CYLINDER = DEPLOYMENTS / "riba_cylinder.toml"


def riba(*overrides: str) -> BodySimulation:
    """The robot when its arms have closed and the world still holds the cylinder."""
    spec = ("payload.mass_kg=3.0", "payload.grip_force_n=60.0", 'payload.release_stage="hold"', *overrides)
    return BodySimulation(load(CYLINDER, spec), DEPLOYMENTS)
