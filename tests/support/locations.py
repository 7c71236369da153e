"""Folders of the repository that tests read."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DEPLOYMENTS = ROOT / "deployments"
DATA = ROOT / "tests" / "data"
SUPPORT = Path(__file__).parent
SHIPPED_DEPLOYMENTS = sorted(DEPLOYMENTS.glob("*.toml"))
