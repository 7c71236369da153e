"""Numbers of any size: a deployment is refused in one line, or everything is built from it."""

import copy
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from locations import DEPLOYMENTS

from skinnet.deployment import load
from skinnet.deployment.checks import check
from skinnet.deployment.load import from_document, resolved_json
from skinnet.errors import DeploymentError, SkinnetError
from skinnet.run.prepare import validate

FILE = DEPLOYMENTS / "two_link_arm.toml"
FILES = sorted(DEPLOYMENTS.glob("*.toml"))
EXTREMES = (1e300, -1e300, 1e20, 1e12, 1e9, 1e7, 1e5, 1e-300, 1e-9, 0, -1, 10**30)


def numbers(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all numbers in a document, of the first two entries of each list."""
    if isinstance(value, dict):
        return [found for key, item in value.items() for found in numbers(item, (*path, key))]
    if isinstance(value, list):
        return [found for i, item in enumerate(value[:2]) for found in numbers(item, (*path, i))]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return [path] if is_number and path != ("format",) else []


def document_of(file: Any) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(resolved_json(load(file, ())))
    return document


DOCUMENT = document_of(FILE)


def changed(document: dict[str, Any], path: tuple[Any, ...], value: float) -> dict[str, Any]:
    other = copy.deepcopy(document)
    node: Any = other
    for step in path[:-1]:
        node = node[step]
    whole = isinstance(node[path[-1]], int) and float(value).is_integer()
    node[path[-1]] = int(value) if whole else value
    return other


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(numbers(DOCUMENT)), st.sampled_from(EXTREMES))
def test_an_extreme_number_is_refused_in_one_line_or_built(path: tuple[Any, ...], value: float) -> None:
    try:
        validate(from_document(changed(DOCUMENT, path, value), "x"), FILE)
    except SkinnetError as error:
        lines = str(error).splitlines()
    else:
        lines = [""]
    assert len(lines) == 1


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_number_of_the_schema_has_a_range(file: Any) -> None:
    document = document_of(file)
    for path in numbers(document):
        for value in (1e300, 10**30, -1e300):
            with pytest.raises(DeploymentError) as refused:
                check(from_document(changed(document, path, value), "x"))
            assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (
            ("run", "max_s"),
            1e300,
            r"run\.max_s = 1e\+300: the magnitude must be zero or from 1e-09 to 1e\+07",
        ),
        (("network", "queue_packets"), 1e20, r"network\.queue_packets = 1e\+20"),
        (("patches", 0, "lattice", "columns"), 10**8, r"columns × rows = 100000000 × "),
        (("robot",), "arm\n", r"robot = 'arm\\n': expected text matching regex"),
        (("patches", 0, "name"), "arm\n", r"patches\[0\]\.name = 'arm\\n'"),
    ],
)
def test_what_passed_once_is_refused_by_name(path: tuple[Any, ...], value: Any, said: str) -> None:
    document = copy.deepcopy(DOCUMENT)
    node: Any = document
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    with pytest.raises(DeploymentError, match=said):
        from_document(document, "x")


def test_a_seed_may_be_any_of_63_bits() -> None:
    for seed in (0, 2**63 - 1):
        assert from_document(DOCUMENT | {"seed": seed}, "x").seed == seed
