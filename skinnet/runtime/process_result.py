"""Result of one process, its contribution to the summary of a run."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.errors import RunFolderError
from skinnet.files import atomic_replacement, write_json
from skinnet.output_folder import RunIdentity

__all__ = ["ProcessResult"]

_IDENTITY = "run_identity"
"""Name under which the identity of the run is among the stored arrays."""


@dataclass
class ProcessResult:
    """Process result: facts (JSON values) and arrays by name.

    `facts["logs"]` holds the SHA-256 of the log of each source, so that the hash of a run does not depend on
    the distribution of its sources over processes.
    """

    name: str
    role: str
    facts: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def save(self, folder: Path, identity: RunIdentity | None = None) -> None:
        """Write `<name>.npz` and, last, `<name>.json`, both with the identity of their run."""
        arrays = self.arrays if identity is None else self.arrays | {_IDENTITY: np.array(_words(identity))}
        with atomic_replacement(folder / f"{self.name}.npz") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        head = {"name": self.name, "role": self.role, "run": _words(identity), "facts": self.facts}
        write_json(folder / f"{self.name}.json", head)

    @classmethod
    def load(cls, folder: Path, name: str, identity: RunIdentity | None = None) -> "ProcessResult":
        """Load the files that `save` wrote.

        Raises:
            FileNotFoundError: the process ended before it saved its result.
            RunFolderError: `identity` is given, and the files are of another run or of another deployment.
        """
        head = msgspec.json.decode((folder / f"{name}.json").read_bytes())
        with np.load(folder / f"{name}.npz") as archive:
            arrays = {key: archive[key] for key in archive.files}
        marks = {".json": head.get("run", []), ".npz": arrays.pop(_IDENTITY, np.array([])).tolist()}
        for suffix, words in marks.items():
            if identity is not None and words != _words(identity):
                raise RunFolderError(
                    f"{folder / name}{suffix}: the result of another run or deployment; something else wrote "
                    f"into the run folder: run it again, in a folder of its own"
                )
        return cls(head["name"], head["role"], head["facts"], arrays)


def _words(identity: RunIdentity | None) -> list[str]:
    return [] if identity is None else [identity.run_id, identity.deployment_sha256]
