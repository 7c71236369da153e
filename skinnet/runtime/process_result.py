"""Result of one process, its contribution to the summary of a run."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from skinnet.files import atomic_replacement, write_json

__all__ = ["ProcessResult"]


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

    def save(self, folder: Path) -> None:
        """Write `<name>.npz` and, last, `<name>.json`."""
        with atomic_replacement(folder / f"{self.name}.npz") as file:
            np.savez(file, **self.arrays)  # type: ignore[arg-type]
        write_json(folder / f"{self.name}.json", {"name": self.name, "role": self.role, "facts": self.facts})

    @classmethod
    def load(cls, folder: Path, name: str) -> "ProcessResult":
        """Load the files that `save` wrote.

        Raises:
            FileNotFoundError: the process ended before it saved its result.
        """
        head = msgspec.json.decode((folder / f"{name}.json").read_bytes())
        with np.load(folder / f"{name}.npz") as archive:
            arrays = {key: archive[key] for key in archive.files}
        return cls(head["name"], head["role"], head["facts"], arrays)
