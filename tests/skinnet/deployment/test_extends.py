"""A deployment says only what differs from its base; what is wrong is told with the chain of files."""

import json
from pathlib import Path
from typing import Any

import pytest
from locations import DATA, ROOT

from skinnet.deployment import load, resolved_json
from skinnet.deployment.checks import check
from skinnet.deployment.extends import merge_layers, origin_of, read_layers
from skinnet.deployment.load import from_document
from skinnet.errors import DeploymentError

SHIPPED = sorted((ROOT / "deployments").glob("*.toml"))
ROBOTS = sorted((ROOT / "deployments" / "robots").glob("*.toml"))
FROZEN = DATA / "resolved"

BASE = """
format = 2
robot = "bot"
[body]
model = "ur5"
reference_body = "base"
joints = ["elbow", "wrist"]
[body.foam]
thickness_m = 0.02
friction = 0.9
[[patches]]
name = "arm"
body = "arm"
lattice = { columns = 3, rows = 2, origin_m = [0, 0, 0], normal = [0, 0, 1], up = [0, 1, 0] }
interfaces = [{ cell = 0, port = 2 }]
[controller]
program = ["home"]
[controller.stages]
home = { kind = "posture" }
"""
OWN = 'extends = "base.toml"\nformat = 2\nname = "own"\n'


def write(folder: Path, **files: str) -> Path:
    """Write files by their stem, and return that of `own`."""
    for stem, text in files.items():
        (folder / f"{stem}.toml").write_text(text, encoding="utf-8")
    return folder / "own.toml"


def merged(file: Path) -> dict[str, Any]:
    return merge_layers(read_layers(file))


def refusal(file: Path, *overrides: str) -> str:
    with pytest.raises(DeploymentError) as refused:
        load(file, overrides)
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    return text


def test_tables_are_merged_and_everything_else_is_replaced(tmp_path: Path) -> None:
    own = (
        OWN
        + 'body.joints = ["elbow"]\nbody.foam.friction = 0.5\n'
        + '[controller.stages]\nrest = { kind = "posture" }\n'
    )
    deployment = load(write(tmp_path, base=BASE, own=own))
    check(deployment)
    assert (deployment.name, deployment.robot) == ("own", "bot")
    assert deployment.body.joints == ("elbow",)
    assert (deployment.body.foam.thickness_m, deployment.body.foam.friction) == (0.02, 0.5)
    assert list(deployment.controller.stages) == ["home", "rest"]


def test_a_list_of_tables_is_replaced_as_a_whole(tmp_path: Path) -> None:
    own = OWN + '[[patches]]\nname = "hand"\nbody = "hand"\n'
    (only,) = load(write(tmp_path, base=BASE, own=own)).patches
    assert (only.name, only.lattice, only.interfaces) == ("hand", None, ())


def test_a_chain_goes_through_several_files_and_the_nearest_wins(tmp_path: Path) -> None:
    middle = (
        'extends = "base.toml"\nformat = 2\nseed = 5\nbody.foam = { friction = 0.7, thickness_m = 0.03 }\n'
    )
    own = 'extends = "middle.toml"\nformat = 2\nname = "own"\nbody.foam.friction = 0.5\n'
    file = write(tmp_path, base=BASE, middle=middle, own=own)
    deployment = load(file)
    assert (deployment.seed, deployment.body.foam.friction, deployment.body.foam.thickness_m) == (
        5,
        0.5,
        0.03,
    )
    origins = {
        key: origin_of(read_layers(file), key)
        for key in ("seed", "robot", "body.foam.friction", "patches[0].name")
    }
    assert {key: path.stem for key, path in origins.items() if path} == {
        "seed": "middle",
        "robot": "base",
        "body.foam.friction": "own",
        "patches[0].name": "base",
    }
    assert origin_of(read_layers(file), "patches[1].name") is None


def test_overrides_come_last_and_change_no_file_of_the_chain(tmp_path: Path) -> None:
    file = write(tmp_path, base=BASE, own=OWN)
    settings = ("body.foam.friction=0.1", "patches.arm.body=hand", "controller.stages.home.pose=bow")
    deployment = load(file, settings, seed=9)
    assert (deployment.body.foam.friction, deployment.patches[0].body, deployment.seed) == (0.1, "hand", 9)
    assert load(file).patches[0].body == "arm"


def test_a_base_of_an_earlier_format_is_translated_by_itself(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    old = BASE.replace("format = 2\n", "").replace("reference_body", "reference")
    file = write(tmp_path, base=old, own=OWN + "body.ambient_c = 20.0\n")
    assert load(file).body.reference_body == "base"
    (remark,) = caplog.messages
    assert "base.toml" in remark
    assert "skinnet migrate" in remark


def test_files_of_a_base_are_relative_to_the_base(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "arm.xml").write_text("<mujoco/>")
    base = BASE.replace('"ur5"', '"arm.xml"') + '[memory]\nread = "known.sqlite"\n'
    write(tmp_path / "robots", base=base)
    file = write(tmp_path, own=OWN.replace("base.toml", "robots/base.toml"))
    deployment = load(file)
    assert deployment.body.model == str(Path("robots", "arm.xml"))
    assert deployment.memory.read == str(Path("robots", "known.sqlite"))  # missing, but named
    write(tmp_path, own=file.read_text() + 'body.model = "own.xml"\n')
    assert load(file).body.model == "own.xml"


def test_the_name_of_a_shipped_model_is_no_file_of_the_base(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    write(tmp_path / "robots", base=BASE)
    assert load(write(tmp_path, own=OWN.replace("base.toml", "robots/base.toml"))).body.model == "ur5"


def test_a_base_in_another_folder_names_its_own_base_from_there(tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    write(tmp_path / "robots", base=BASE, arms='extends = "base.toml"\nformat = 2\nseed = 3\n')
    assert load(write(tmp_path, own=OWN.replace("base.toml", "robots/arms.toml"))).seed == 3


@pytest.mark.parametrize(
    ("base", "own", "said"),
    [
        (None, OWN, "{own} extends {base}: there is no such file"),
        ("x = = 1", OWN, "{own} extends {base}: no valid TOML"),
        ("format = 3", OWN, "{own} extends {base}: format = 3: this program reads up to 2"),
        ("format = 'x'", OWN, "{own} extends {base}: format = 'x': give 2"),
        (BASE, OWN.replace("format = 2", "format = 9"), "{own}: format = 9: this program reads up to 2"),
        (
            'extends = "own.toml"\n' + BASE,
            OWN,
            "{own} extends {base} extends {own}: extends goes round: {own} extends itself",
        ),
        (BASE, OWN.replace("base.toml", "own.toml"), "{own} extends {own}: extends goes round"),
        (BASE, OWN.replace("base.toml", "."), "{own} extends {folder}: cannot be read: Is a directory"),
        (BASE, OWN.replace('"base.toml"', "3"), "{own}: extends = 3: give the name"),
        (BASE, OWN.replace('"base.toml"', '["base.toml"]'), "{own}: extends = ['base.toml']: give the name"),
        (BASE, OWN.replace('"base.toml"', '""'), "{own}: extends = '': give the name"),
        (BASE, OWN.replace("base.toml", "a\\u0000b"), "{own}: extends = 'a\\x00b': give the name"),
        (BASE.replace("body", "boddy", 1), OWN, "{in_base}: boddy: unknown key; did you mean body?"),
        (BASE, OWN + "body.fom.friction = 1.0", "{in_own}: body.fom: unknown key; did you mean foam?"),
        (BASE, OWN + "body.foam.mu = 1.0", "{in_own}: body.foam.mu: unknown key; allowed: thickness_m"),
        (
            BASE,
            OWN + "body.reference = 'a'",
            "{in_own}: body.reference: unknown key; did you mean reference_b",
        ),
        (BASE, OWN + "extend = 1", "{in_own}: extend: unknown key; did you mean extends?"),
        (BASE, OWN + "body.foam.friction = 'x'", "{in_own}: body.foam.friction = 'x': expected a number"),
        (BASE.replace("0.9", "'x'"), OWN, "{in_base}: body.foam.friction = 'x': expected a number"),
        (BASE, OWN + "body = 3", "{in_own}: body = 3: expected a table"),
        (BASE, OWN + "body.foam.friction = nan", "{in_own}: body.foam.friction = nan: must be a finite"),
        (BASE.replace("rows = 2", "rows = 0"), OWN, "{in_base}: patches[0].lattice.rows = 0: "),
        (
            BASE.replace("columns = 3,", ""),
            OWN,
            "{in_base}: patches[0].lattice: the table lacks `columns`",
        ),
        (BASE.replace('robot = "bot"', ""), OWN, "{chain}: the file: the table lacks `robot`"),
        (BASE, OWN + "controller.stages.nap.kind = 'doze'", "{in_own}: controller.stages.nap.kind = 'doze'"),
    ],
)
def test_what_is_wrong_is_told_with_the_chain_and_the_file(
    base: str | None, own: str, said: str, tmp_path: Path
) -> None:
    file = write(tmp_path, own=own) if base is None else write(tmp_path, base=base, own=own)
    other = tmp_path / "base.toml"
    chain = f"{file} extends {other}"
    wheres = {"chain": chain, "in_own": f"{chain}: in {file}", "in_base": f"{chain}: in {other}"}
    text = refusal(file)
    assert text.startswith(said.format(own=file, base=other, folder=tmp_path, **wheres)), text


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("seed=-1", "on the command line: seed = -1: "),
        (
            "body.foam.fricton=1",
            "on the command line: body.foam.fricton: unknown key; did you mean friction?",
        ),
        ("body.foam.friction=x", "on the command line: body.foam.friction = 'x': "),
        ("patches.arm.lattice.rows=0", "on the command line: patches[0].lattice.rows = 0: "),
        ("body.joints=[]", "on the command line: body.joints: "),
    ],
)
def test_what_is_wrong_on_the_command_line_is_laid_on_no_file(
    override: str, said: str, tmp_path: Path
) -> None:
    file = write(tmp_path, base=BASE, own=OWN)
    assert refusal(file, override).startswith(f"{file} extends {tmp_path / 'base.toml'}: {said}")


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_a_shipped_deployment_is_what_it_was_before_robots_had_files(file: Path) -> None:
    """The frozen copies are those of whole files, without `extends`."""
    frozen = json.loads((FROZEN / f"{file.stem}.json").read_text(encoding="utf-8"))
    assert json.loads(resolved_json(load(file))) == frozen


def test_no_robot_is_written_twice() -> None:
    """Experiments name their robot; body and skin stand in robots/ alone, and each file there is used."""
    used = set()
    for file in SHIPPED:
        *bases, own = read_layers(file)
        assert bases, f"{file.name} extends nothing"
        used |= {layer.path.resolve() for layer in bases}
        assert set(own.document) & {"robot", "cells", "patches", "surfaces", "sheets", "bridges"} == set()
        assert set(own.document.get("body", {})) <= {"home_rad"}
    assert used == {file.resolve() for file in ROBOTS}


def test_every_file_is_of_the_present_format() -> None:
    for file in (*SHIPPED, *ROBOTS):
        assert "\nformat = 2\n" in file.read_text(encoding="utf-8")


def test_a_decoded_document_does_not_extend() -> None:
    """Only a file has a folder beside which its base lies."""
    with pytest.raises(DeploymentError, match=r"^arm: extends = 'robots/riba.toml': only a file extends"):
        from_document({"extends": "robots/riba.toml", "name": "arm"}, "arm")
