"""The JSON Schema with which editors complete and check deployments: current, and as strict as it can be."""

import copy
import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from locations import DEPLOYMENTS
from typer.testing import CliRunner

from skinnet.cli.main import app
from skinnet.deployment.documentation import unit_of
from skinnet.deployment.json_schema import deployment_schema

FILES = sorted(DEPLOYMENTS.rglob("*.toml"))
SHIPPED = DEPLOYMENTS / "skinnet.schema.json"
SCHEMA = deployment_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)

WHOLE: dict[str, Any] = {
    "name": "a",
    "robot": "b",
    "body": {"model": "m", "reference_body": "r", "joints": ["j"]},
    "controller": {"stages": {"home": {"kind": "posture"}}},
    "patches": [{"name": "p", "body": "r", "interfaces": [{"cell": 0, "port": 2}]}],
    "faults": [{"kind": "cell_dead", "target": "p/0"}],
}


def changed(path: str, value: Any = None) -> dict[str, Any]:
    """A whole deployment with one key set, or taken out without a value."""
    document = copy.deepcopy(WHOLE)
    node: Any = document
    *above, last = [int(step) if step.isdecimal() else step for step in path.split(".")]
    for step in above:
        node = node[step] if isinstance(node, list) else node.setdefault(step, {})
    if value is None:
        del node[last]
    else:
        node[last] = value
    return document


def test_the_shipped_schema_is_current() -> None:
    hint = "run: skinnet schema --out deployments/skinnet.schema.json"
    assert json.loads(SHIPPED.read_text(encoding="utf-8")) == json.loads(json.dumps(SCHEMA)), hint


def test_it_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert "null" not in json.dumps(SCHEMA)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_shipped_files_hold_and_name_it_in_their_first_line(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    VALIDATOR.validate(tomllib.loads(text))
    directive, _, name = text.partition("\n")[0].partition(" ")
    assert directive == "#:schema"
    assert (file.parent / name).resolve() == SHIPPED


def test_a_whole_deployment_holds() -> None:
    VALIDATOR.validate(WHOLE)


@pytest.mark.parametrize(
    "document",
    [
        changed("body.modle", "x"),
        changed("seed", -1),
        changed("seed", "one"),
        changed("run.pace", "fast"),
        changed("format", 3),
        changed("extends", ["a"]),
        changed("object", "elephant"),
        changed("patches.0.interfaces.0.port", 4),
        changed("patches.0.name", "a b"),
        changed("faults.0.kind", "broken"),
        changed("faults.0.target"),
        changed("faults.0.rate_hz", 1.0),
        changed("patches.0.body"),
        changed("robot"),
        changed("body"),
        changed("body.model"),
        changed("controller.stages.home.kind", "doze"),
        changed("controller.stages.home.kind"),
        changed("payload.mass_kg", 1.0),  # a payload needs its position
    ],
    ids=str,
)
def test_what_no_file_may_say(document: dict[str, Any]) -> None:
    assert not VALIDATOR.is_valid(document)


def test_a_part_of_a_chain_needs_no_more_than_it_says() -> None:
    """Also in tables, which are merged; entries of lists are whole in each file."""
    assert VALIDATOR.is_valid({"format": 2, "robot": "b", "body": {"locked": ["j"]}})
    assert VALIDATOR.is_valid({"extends": "b.toml", "name": "a", "body": {"foam": {"friction": 0.5}}})
    assert not VALIDATOR.is_valid({"extends": "b.toml", "name": "a", "patches": [{"name": "p"}]})
    assert not VALIDATOR.is_valid({"extends": "b.toml", "nam": "a"})


def test_every_key_is_described() -> None:
    described = [(table, key) for table, spec in SCHEMA["$defs"].items() for key in spec["properties"]]
    assert [
        (table, key)
        for table, key in described
        if key != "kind" and "description" not in SCHEMA["$defs"][table]["properties"][key]
    ] == []
    assert [key for key, value in SCHEMA["properties"].items() if "description" not in value] == []


def test_keys_are_described_with_units_and_defaults() -> None:
    servo = SCHEMA["$defs"]["ServoSpec"]["properties"]
    assert (servo["torque_limit_nm"]["description"], servo["torque_limit_nm"]["default"]) == (
        "Torque limit. [N·m]",
        400.0,
    )
    run = SCHEMA["$defs"]["RunSpec"]["properties"]
    assert run["max_s"]["description"] == "Simulated time after which the run ends at the latest. [s]"
    assert run["pace"]["enum"] == ["lockstep", "realtime"]
    assert "\n" not in run["pin"]["description"]
    assert set(SCHEMA["properties"]) >= {"extends", "format", "name", "body"}


@pytest.mark.parametrize(
    ("key", "unit"), [("max_s", "s"), ("speed_m_s", "m/s"), ("bits_per_s", "bit/s"), ("joints", None)]
)
def test_units_are_those_of_the_names(key: str, unit: str | None) -> None:
    assert unit_of(key) == unit


def test_the_command(tmp_path: Path) -> None:
    printed = CliRunner().invoke(app, ["schema"])
    assert json.loads(printed.output) == json.loads(json.dumps(SCHEMA))
    out = tmp_path / "new" / "schema.json"
    assert CliRunner().invoke(app, ["schema", "--out", str(out)]).exit_code == 0
    assert out.read_bytes() == SHIPPED.read_bytes()
    assert "that is a folder" in str(CliRunner().invoke(app, ["schema", "--out", str(tmp_path)]).exception)
