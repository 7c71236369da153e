"""Cache of coverings in the user's cache folder, by content: equal covers of equal models are made once."""

import hashlib
import os
from pathlib import Path
from typing import TypeVar

import msgspec

from skinnet.deployment import Deployment
from skinnet.files import write_bytes

__all__ = ["covering_key", "read_covering", "write_covering"]

T = TypeVar("T")


def covering_key(deployment: Deployment, model: bytes, *more: object) -> str:
    """Key of a covering: a hash of covers, cells, patches, sheets, foam, model, `more`, and of the code."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    asked = (
        deployment.cover,
        deployment.cells.side_m,
        deployment.body.foam.thickness_m,
        deployment.patches,
        deployment.surfaces,
        deployment.sheets,
        more,
    )
    digest.update(msgspec.json.encode(asked, order="deterministic"))
    digest.update(model)
    return digest.hexdigest()


def read_covering(key: str, kind: type[T]) -> T | None:
    """Read a covering; None if there is none, or none that can be read."""
    try:
        return msgspec.json.decode(_file(key).read_bytes(), type=kind)
    except (OSError, msgspec.MsgspecError):
        return None


def write_covering(key: str, covering: object) -> None:
    """Keep a covering; without a folder that can be written, it is made anew next time."""
    try:
        write_bytes(_file(key), msgspec.json.encode(covering))
    except OSError:
        return


def _file(key: str) -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "skinnet" / "coverings" / f"{key}.json"
