"""Nothing that a name change touches may change a value: value hashes and metrics as they were before."""

import json
import re
from pathlib import Path

import msgpack
import pytest
from frozen_values import FROZEN, compared, measured
from locations import DEPLOYMENTS
from value_hash import _packed, _values

from skinnet.run.arithmetic import arithmetic

QUICK = ("two_link_arm", "riba_trajectory")
"""Those that take seconds; `make values` runs all."""


@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", QUICK)
def test_values_and_metrics_are_as_they_were(name: str, tmp_path: Path) -> None:
    if json.loads(FROZEN.read_text())["arithmetic"] != arithmetic()["all"]:
        pytest.skip("this computer's arithmetic (libm, BLAS, versions) is not the one of the frozen values")
    assert compared(name, measured(name, tmp_path)) == []


def test_every_shipped_deployment_is_frozen() -> None:
    shipped = {path.stem for path in (DEPLOYMENTS).glob("*.toml")}
    frozen = json.loads(FROZEN.read_text())["runs"]
    assert set(frozen) == shipped
    assert all(re.fullmatch("[0-9a-f]{64}", run["value_sha256"]) for run in frozen.values())


def test_the_hash_knows_numbers_and_no_names() -> None:
    before = {"type": "world", "schema": 1, "covered_ns": 5, "stage": "hold", "counts": {"a": 1, "b": 2}}
    after = {"type": "free_bodies", "schema": 2, "watermark_ns": 5, "stage": "x", "counts": {"z": 2, "y": 1}}
    assert _values(before) == _values(after)
    assert _values(before) != _values(before | {"covered_ns": 6})
    assert _values(before) != _values(before | {"counts": {"a": 1, "b": 3}})
    assert _packed(1) != _packed(1.0)
    assert _packed(msgpack.unpackb(msgpack.packb(-0.0))) != _packed(0.0)
