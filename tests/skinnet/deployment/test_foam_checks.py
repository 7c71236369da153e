"""The compression curve in a deployment: read from TOML, or refused by key, row and value in one line."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from locations import DEPLOYMENTS, ROOT

from skinnet.cli.deployment_listing import resolved_toml
from skinnet.deployment import load
from skinnet.deployment.checks import check
from skinnet.diagnosis.felt_geometry import felt_geometry_findings
from skinnet.errors import DeploymentError

FILE = DEPLOYMENTS / "two_link_arm.toml"
GOOD = {
    "strain": [0.0, 0.2, 0.4, 0.7],
    "loading_kpa": [0.0, 2.0, 3.0, 9.0],
    "unloading_kpa": [0.0, 1.0, 2.0, 9.0],
}


def loaded(changes: dict[str, Any], *more: str) -> Any:
    table = GOOD | changes
    settings = tuple(f"body.foam.curve.{key}={value}" for key, value in table.items() if value is not None)
    deployment = load(FILE, (*settings, *more))
    check(deployment)
    return deployment


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"strain": [0.1, 0.2, 0.4, 0.7]}, r"strain\[0\] = 0\.1: must be 0"),
        (
            {"strain": [0.0, 0.2, 0.2, 0.7]},
            r"strain\[2\] = 0\.2: must be at least 0\.0001 above strain\[1\] = 0\.2",
        ),
        ({"strain": [0.0, 0.2, 0.4, 1.2]}, r"strain\[3\] = 1\.2"),
        ({"strain": [0.0]}, r"strain"),
        ({"loading_kpa": [0.0, 2.0, 3.0]}, r"loading_kpa: has 3 rows, strain has 4"),
        ({"unloading_kpa": [0.0, 1.0]}, r"unloading_kpa: has 2 rows, strain has 4"),
        ({"loading_kpa": [0.5, 2.0, 3.0, 9.0]}, r"loading_kpa\[0\] = 0\.5: must be 0"),
        ({"loading_kpa": [0.0, 0.0, 3.0, 9.0]}, r"loading_kpa\[1\] = 0: must be above 0"),
        (
            {"loading_kpa": [0.0, 4.0, 3.0, 9.0]},
            r"loading_kpa\[2\] = 3: must be at least loading_kpa\[1\] = 4",
        ),
        ({"loading_kpa": [0.0, -4.0, 3.0, 9.0]}, r"loading_kpa\[1\] = -4"),
        ({"unloading_kpa": [0.1, 1.0, 2.0, 9.0]}, r"unloading_kpa\[0\] = 0\.1: must be 0"),
        ({"unloading_kpa": [0.0, 1.5, 1.0, 9.0]}, r"unloading_kpa\[2\] = 1: must be at least"),
        (
            {"unloading_kpa": [0.0, 1.0, 3.5, 9.0]},
            r"unloading_kpa\[2\] = 3\.5: must be at most loading_kpa\[2\] = 3; foam gives back no more",
        ),
        ({"reversal_strain": 0.0}, r"reversal_strain = 0\.0"),
        ({"loading_kpa": None}, r"loading_kpa"),
    ],
)
def test_a_curve_that_no_foam_has_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(DeploymentError, match=said) as refused:
        loaded(changes)
    assert "body.foam.curve" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_stiffness_beside_a_curve_must_be_its_own() -> None:
    with pytest.raises(
        DeploymentError, match=r"stiffness_pa_per_m = 2e\+06: body\.foam\.curve has 6\.25e\+05"
    ):
        loaded({}, "body.foam.stiffness_pa_per_m=2e6")
    assert loaded({}, "body.foam.stiffness_pa_per_m=6.25e5").body.foam.secant_stiffness_pa_per_m == 6.25e5
    assert loaded({}).body.foam.secant_stiffness_pa_per_m == 6.25e5
    assert load(FILE).body.foam.curve is None


def test_a_resolved_deployment_keeps_its_curve(tmp_path: Path) -> None:
    deployment = loaded({})
    (tmp_path / "resolved.toml").write_text(resolved_toml(deployment, FILE))
    assert load(tmp_path / "resolved.toml").body.foam == deployment.body.foam


def test_check_says_what_the_table_means() -> None:
    (finding,) = felt_geometry_findings(loaded({}), DEPLOYMENTS)
    line = finding.text
    # areas by hand: loading 0.2 + 0.5 + 1.8, unloading 0.1 + 0.3 + 1.65
    assert "CC40 3 kPa, 6.25e+05 Pa/m to 40 % strain" in line
    assert "between both columns lies 18 % of the work of loading" in line
    assert felt_geometry_findings(load(FILE), DEPLOYMENTS) == []


def test_the_example_of_the_docs_is_a_curve() -> None:
    page = (ROOT / "docs" / "own_robot.md").read_text(encoding="utf-8")
    block = page.split("```text\n[body.foam.curve]")[1].split("```")[0]
    loaded(tomllib.loads(block))
