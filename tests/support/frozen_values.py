"""Value hashes and metrics of the shipped deployments, frozen before names changed.

`python tests/support/frozen_values.py` runs all of them and compares, which takes minutes; arguments name
some.
`--freeze` writes what the present code gives to `frozen_values.json` instead.
"""

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import launching
from value_hash import channel_hashes, value_hash

from skinnet.migration.summaries import current_metric
from skinnet.run.arithmetic import arithmetic

__all__ = ["FROZEN", "NAMES", "compared", "measured"]

FROZEN = Path(__file__).with_suffix(".json")
NAMES = (
    "two_link_arm",
    "riba_trajectory",
    "riba_cylinder",
    "ur5_260",
    "h1_1260",
    "hrp2_grasp",
    "hrp2_touch",
    "hrp2_teach",
)
_BY_COMPRESSION = "recording.bytes"
"""Metrics whose names begin so depend on the compressor, not on the run."""


def measured(name: str, out: Path) -> dict[str, Any]:
    """Value hash, its channels and the metrics of one run of a shipped deployment."""
    file = launching.ROOT / "deployments" / f"{name}.toml"
    summary = launching.run(file, out, "--in-process", "--record")
    metrics = summary.get("metrics", summary.get("figures"))
    return {
        "value_sha256": value_hash(out / "run.mcap"),
        "channels": {str(number): digest for number, digest in channel_hashes(out / "run.mcap").items()},
        "metrics": {key: value for key, value in metrics.items() if not key.startswith(_BY_COMPRESSION)},
    }


def compared(name: str, now: dict[str, Any]) -> list[str]:
    """Differences between a run and what is frozen, in words; none if nothing changed."""
    frozen = json.loads(FROZEN.read_text())["runs"][name]
    found = [
        f"{name}: channel {number} has other values"
        for number, digest in frozen["channels"].items()
        if now["channels"].get(number) != digest
    ]
    expected = {current_metric(key): value for key, value in frozen["metrics"].items()}
    found += [
        f"{name}: {key} = {now['metrics'].get(key)!r}, was {value!r}"
        for key, value in expected.items()
        if now["metrics"].get(key) != value
    ]
    found += [f"{name}: {key} is new" for key in now["metrics"] if key not in expected]
    return found


def _main(names: list[str], *, freeze: bool) -> int:
    frozen = json.loads(FROZEN.read_text()) if FROZEN.exists() else {"arithmetic": "", "runs": {}}
    if not freeze and frozen["arithmetic"] != arithmetic()["all"]:
        sys.stdout.write("this computer's arithmetic is another one: values differ, nothing to compare\n")
        return 0
    differences: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            now = measured(name, Path(folder) / name)
            frozen["runs"][name] = now if freeze else frozen["runs"][name]
            found = [] if freeze else compared(name, now)
            sys.stdout.write(f"{name}: {now['value_sha256']}, {len(found)} differences\n")
            differences += found
    sys.stdout.writelines(f"  {line}\n" for line in differences)
    if freeze:
        text = json.dumps(
            {"arithmetic": arithmetic()["all"], "runs": frozen["runs"]}, indent=1, sort_keys=True
        )
        FROZEN.write_text(text + os.linesep)
    return bool(differences)


if __name__ == "__main__":
    chosen = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    sys.exit(_main(chosen or list(NAMES), freeze="--freeze" in sys.argv))
