"""A deployment that holds is read as it stands; one that does not is refused in one clear line."""

import math
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_robot import SHIPPED, patch, small

from skinnet.deployment import load, resolved_json
from skinnet.deployment.checks import check
from skinnet.deployment.load import apply_override, from_document
from skinnet.errors import DeploymentError
from skinnet.skin.placement import place_patches


def refusal(*overrides: str) -> str:
    """What a user reads who changes the shipped deployment so."""

    def read() -> None:
        deployment = load(SHIPPED, overrides)
        check(deployment)
        place_patches(deployment.patches, deployment.cells)

    with pytest.raises(DeploymentError) as refused:
        read()
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    return text


TALK = "controller.stages.talk={kind='teach_and_grasp'}"


def lesson(keys: str = "", stage: str = "talk.hold") -> tuple[str, ...]:
    goals = "goals=[{body='left_hand', position_m=[0.4, 0.2, 1.0]}]"
    return (TALK, f"teacher.lessons=[{{{', '.join(filter(None, (f'stage={stage!r}', goals, keys)))}}}]")


def stroke(cells: str, stage: str = "talk.hold") -> tuple[str, ...]:
    return (TALK, f"teacher.strokes=[{{stage={stage!r}, cells=[{cells}]}}]")


def test_lessons_and_strokes_may_belong_to_a_state_of_a_stage() -> None:
    check(load(SHIPPED, (*lesson("clearance_m=0.002"), *stroke("'torso/0-17', 'left_hand'"))))


def test_the_shipped_deployment_holds() -> None:
    deployment = load(SHIPPED)
    check(deployment)
    assert sum(patch.n_cells for patch in place_patches(deployment.patches, deployment.cells)) == 74
    assert len(deployment.body.joints) == 14


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("run.pase=1", ("run.pase: unknown key", "did you mean pace?", "max_s")),
        ("patches.torso.latice=1", ("patches[0].latice", "did you mean lattice?")),
        ("cells.force.nois=1", ("cells.force.nois", "did you mean noise?")),
        ("controller.stages.home.poze=1", ("controller.stages.home.poze", "did you mean pose?")),
        ("teacher.touches.3.depht_m=1", ("teacher.touches[3].depht_m", "did you mean depth_m?")),
        ("qqq=1", ("qqq: unknown key; allowed: name, robot, seed",)),
    ],
)
def test_an_unknown_key_is_named_with_the_nearest_known_one(override: str, said: tuple[str, ...]) -> None:
    text = refusal(override)
    assert str(SHIPPED) in text
    assert all(word in text for word in said), text


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ('seed="one"', ("seed = 'one'", "expected a whole number")),
        ("seed=-1", ("seed = -1", ">= 0")),
        ("body=3", ("body = 3", "expected a table")),
        ("body.joints=[]", ("body.joints", "a list of at least 1 entry")),
        (
            "body.home_rad.left_elbow_pitch=true",
            ("body.home_rad.left_elbow_pitch = True", "expected a number"),
        ),
        ("cells.period_ms=0", ("cells.period_ms = 0", "> 0")),
        (
            "cells.force.levels=[0.1, 0.2, 0.3, 0.4, 0.5]",
            ("cells.force.levels", "a list of at most 4 entries"),
        ),
        (
            'cells.encoding.kind="morse"',
            ("cells.encoding.kind = 'morse'", "'level_crossing', 'send_on_delta', 'periodic'"),
        ),
        ("network.bits_per_s=2.5", ("network.bits_per_s = 2.5", "expected a whole number")),
        ('run.pace="fast"', ("run.pace = 'fast'", "'lockstep', 'realtime'")),
        ('cell_processes="many"', ("cell_processes = 'many'", "a whole number, 'per_patch', a table")),
        ('cell_processes={"left/arm"=["torso"]}', ("cell_processes", "'left/arm'", "regex")),
        ("patches.torso.lattice.normal=[1, 0]", ("patches[0].lattice.normal", "a list of 3 entries, got 2")),
        ("patches.torso.interfaces.0.port=4", ("patches[0].interfaces[0].port = 4", "<= 3")),
        ('patches.torso.name="a b"', ("patches[0].name = 'a b'", "regex")),
        ('controller.program=["a/b"]', ("controller.program[0] = 'a/b'", "regex")),
        ('controller.stages.map.kind="dream"', ("controller.stages.map.kind = 'dream'", "'structure'")),
        (
            'controller.stages.home.speed_rad_s="x"',
            ("controller.stages.home.speed_rad_s = 'x'", "expected a number"),
        ),
        ("run.max_s=nan", ("run.max_s = nan", "finite")),
        ("run.max_s=inf", ("run.max_s = inf", "finite")),
        ("patches.2.lattice.origin_m=[0, -inf, 0]", ("patches[2].lattice.origin_m[1] = -inf", "finite")),
    ],
)
def test_a_value_that_the_schema_refuses(override: str, said: tuple[str, ...]) -> None:
    text = refusal(override)
    assert str(SHIPPED) in text
    assert all(word in text for word in said), text


PER_PATCH = 'cell_processes="per_patch"'


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (
            ("body.stimulus_period_ms=4.5", "cells.period_ms=4.5"),
            ("body.stimulus_period_ms = 4.5", "multiple of", "= 1"),
        ),
        (("body.timestep_ms=1e-9",), ("body.timestep_ms = 1e-09", "magnitude", "1e-06")),
        (("body.timestep_ms=0.0123",), ("body.timestep_ms = 0.0123", "multiple")),
        (("cells.period_ms=8",), ("cells.period_ms = 8", "body.stimulus_period_ms = 4")),
        (("controller.period_ms=10",), ("controller.period_ms = 10", "body.joint_state_period_ms = 5")),
        (("controller.command_delay_ms=2.5",), ("controller.command_delay_ms = 2.5", "multiple")),
        (("controller.command_delay_ms=2",), ("controller.command_delay_ms = 2", "at least 3")),
        (("patches.1.name='torso'", "cell_processes=2"), ("torso", "2 times")),
        (("cell_processes=0",), ("cell_processes = 0", "at least 1", "per_patch")),
        (("cell_processes.left=['torso', 'tail']",), ("cell_processes.left", "'tail'", "right_hand")),
        (("cell_processes.right=['torso']",), ("cell_processes.right", "torso", "already runs on left")),
        (
            ("cell_processes.right=['right_hand']",),
            ("cell_processes", "no process runs right_upper_arm, right_forearm"),
        ),
        (("cell_processes.third=[]",), ("cell_processes.third", "no patches")),
        (("cell_processes={body=['torso']}",), ("cell_processes.body", "choose another")),
        (("cell_processes={external=['torso']}",), ("cell_processes.external", "choose another")),
        (("cell_processes={cells=['torso']}",), ("cell_processes.cells", "choose another")),
        (("run.tolerated_losses=['lefty']",), ("run.tolerated_losses", "'lefty'", "left", "right")),
        (("run.tolerated_losses=['body']",), ("run.tolerated_losses", "body")),
        (("cells.force.levels=[0.3, 0.2]",), ("cells.force.levels = [0.3, 0.2]", "ascend")),
        (("cells.proximity.levels=[0.1, 0.1]",), ("cells.proximity.levels", "ascend")),
        (("cells.force.calibration_n=[0.0, 1.0]",), ("calibration_reading has 4", "has 2")),
        (("cells.temperature.min_c=60",), ("cells.temperature.min_c = 60", "max_c = 55")),
        (("cells.proximity.reading_at_range=1.5",), ("reading_at_range = 1.5", "between 0 and 1")),
        (("controller.program=['map', 'dance']",), ("controller.program", "'dance'", "force_guidance")),
        (
            ("controller.program=['force_guidance']",),
            ("controller.stages.force_guidance", "map stage before"),
        ),
        (("controller.stages.home.pose='yoga'",), ("controller.stages.home.pose = 'yoga'", "home")),
        (("controller.poses_rad.bow=[0.1]",), ("controller.poses_rad.bow", "1 angles for 14")),
        (
            ("controller.stages.force_guidance={kind='guide'}",),
            ("controller.stages.force_guidance.duration_s", "needs"),
        ),
        (
            ("teacher.touches.1={cell='torso/1', stage='map', start_s=0, depth_m=0.001, force_n=1.0}",),
            ("teacher.touches[1]", "either depth_m or force_n"),
        ),
        (("teacher.touches.0.stage='nap'",), ("teacher.touches[0].stage = 'nap'", "force_guidance")),
        (("teacher.touches.0.cell='tail/1'",), ("teacher.touches[0].cell = 'tail/1'", "torso")),
        (("teacher.touches.0.cell='torso/18'",), ("teacher.touches[0].cell", "torso has cells 0 to 17")),
        (lesson(), ("teacher.lessons[0]", "either clearance_m, for proximity guidance, or depth_m")),
        (lesson("clearance_m=0.002, depth_m=0.004"), ("teacher.lessons[0]", "either clearance_m")),
        (
            lesson("clearance_m=0.002", stage="nap.hold"),
            ("teacher.lessons[0].stage = 'nap.hold'", "force_guidance"),
        ),
        (lesson("clearance_m=0.002, cells=['tail']"), ("teacher.lessons[0].cells = 'tail'", "torso")),
        (stroke("'torso', 'left_hand/4-6'"), ("teacher.strokes[0].cells = 'left_hand/4-6'", "0 to 5")),
        (stroke("'torso/5-3'"), ("teacher.strokes[0].cells = 'torso/5-3'", "must ascend")),
        (stroke("'torso'", stage="nap"), ("teacher.strokes[0].stage = 'nap'", "force_guidance")),
        (("patches.torso.interfaces.0.port=0",), ("patches.torso.interfaces[0]", "port 0", "free", "[2, 3]")),
        (("patches.torso.interfaces.0.cell=18",), ("interfaces[0].cell = 18", "0 to 17")),
        (("patches.torso.lattice.up=[2, 0, 0]",), ("patches.torso.lattice.up", "parallel")),
        (("patches.left_forearm.lattice.columns=20",), ("left_forearm.lattice.columns = 20", "radius")),
        (
            tuple(
                f"patches.{side}_hand.{setting}"
                for side in ("left", "right")
                for setting in ("body='torso'", "lattice.normal=[0, 1, 0]", "lattice.origin_m=[0, 0, 0]")
            ),
            ("patches.right_hand", "overlaps", "left_hand"),
        ),
    ],
)
def test_what_does_not_fit_together(overrides: tuple[str, ...], said: tuple[str, ...]) -> None:
    text = refusal(*overrides)
    assert all(word in text for word in said), text


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("run.max_s", "key=value"),
        ("run..max_s=1", "key=value"),
        ("=1", "key=value"),
        ("seed.high=1", "seed is a value"),
        ("run.pace.now.then=1", "cannot be resolved"),
        ("patches.tail.body='x'", "no entry tail; there are torso, left_upper_arm"),
        ("patches.7.body='x'", "no entry 7"),
        ("patches.-1.body='x'", "no entry -1"),
        ("teacher.touches.999.hold_s=1", "no entry 999; there are 0 to "),
    ],
)
def test_a_setting_that_leads_nowhere(override: str, said: str) -> None:
    text = refusal(override)
    assert f"--set {override}" in text
    assert said in text


def test_settings_go_through_tables_and_lists_by_name_and_number() -> None:
    deployment = load(
        SHIPPED,
        (
            "run.max_s = 20",
            "cells.force.noise=0",
            'patches.torso.body="chest"',
            "patches.1.lattice.columns=4",
            "patches.torso.interfaces.0.cell=5",
            "teacher.touches.0.cell=left_forearm/6",
            "controller.stages.nod={ kind = 'posture' }",
            'body.joints.0="first"',
        ),
        seed=7,
    )
    assert deployment.seed == 7
    assert deployment.run.max_s == 20
    assert deployment.cells.force.noise == 0
    assert [patch.body for patch in deployment.patches[:2]] == ["chest", "left_upper_arm"]
    assert deployment.patches[1].lattice is not None
    assert deployment.patches[1].lattice.columns == 4
    assert deployment.patches[0].interfaces[0].cell == 5
    assert deployment.teacher.touches[0].cell == "left_forearm/6"
    assert deployment.controller.stages["nod"].kind == "posture"
    assert deployment.body.joints[:2] == ("first", "left_shoulder_roll")


values = st.one_of(
    st.integers(-9, 9), st.booleans(), st.lists(st.integers(0, 3)), st.sampled_from(["a", "é b"])
)


@given(path=st.lists(st.sampled_from("abc"), min_size=1, max_size=3), value=values)
def test_a_setting_sets_what_toml_would(path: list[str], value: Any) -> None:
    text = repr(value).replace("True", "true").replace("False", "false")
    by_setting: dict[str, Any] = {}
    apply_override(by_setting, f"{'.'.join(path)}={text}")
    assert by_setting == tomllib.loads(f"{'.'.join(path)} = {text}")


@pytest.mark.parametrize(
    "overrides", [(), ("cell_processes=3",), (PER_PATCH,), ("controller.command_delay_ms=10",)]
)
def test_what_was_resolved_says_the_same_again(overrides: tuple[str, ...]) -> None:
    deployment = load(SHIPPED, overrides, seed=3)
    text = resolved_json(deployment)
    assert from_document(msgspec.json.decode(text), "resolved") == deployment
    assert msgspec.json.decode(text)["cells"]["accelerometer"]["range_g"] == 8.0


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "broken.toml").write_text("seed = = 1")
    (tmp_path / "latin.toml").write_bytes(b'name = "caf\xe9"')
    for name, said in (
        ("none.toml", "no such file"),
        ("broken.toml", "no valid TOML"),
        ("latin.toml", "no valid TOML"),
        ("", "cannot be read"),
    ):
        with pytest.raises(DeploymentError, match=said) as refused:
            load(tmp_path / name)
        assert str(tmp_path / name) in str(refused.value)


@given(hosts=st.one_of(st.integers(1, 9), st.just("per_patch")), n=st.integers(1, 6))
def test_every_patch_runs_on_one_host(hosts: int | str, n: int) -> None:
    names = [f"patch{i}" for i in range(n)]
    spread = small(*map(patch, names), cell_processes=hosts).patches_by_process()
    assert sorted(name for patches in spread.values() for name in patches) == names
    assert all(spread.values())
    assert len(spread) == (n if hosts == "per_patch" else min(int(hosts), n))


def everybody_goes_on(stimulus: int, control: int, delay: int, until: int) -> bool:
    """Whether body, cells and controller reach `until`, when each waits for the others as it must [ms].

    The body computes a stretch when it has the commands for it, the cells a period when they have the
    stimulus at its end and the commands before it, the controller a tick when joints and skin are there.
    """
    body, cells, tick, commanded = 0, 0, 0, delay
    while tick < until:
        due = min(body + step - (body - offset) % step for step, offset in ((stimulus, 0), (control, delay)))
        due = min(due, body + control - body % control)
        if due <= commanded:
            body = due
        elif cells + stimulus <= min(body - body % stimulus, commanded):
            cells += stimulus
        elif tick <= min(body - body % control, cells):
            tick += control
            commanded = tick + delay
        else:
            return False
    return True


@given(stimulus=st.integers(1, 12), control=st.integers(1, 12), delay=st.integers(1, 14))
def test_periods_are_refused_if_and_only_if_everybody_would_wait(
    stimulus: int, control: int, delay: int
) -> None:
    deployment = small(
        body={"stimulus_period_ms": stimulus, "joint_state_period_ms": control},
        cells={"period_ms": stimulus},
        controller={"period_ms": control, "command_delay_ms": delay},
    )
    if everybody_goes_on(stimulus, control, delay, 3 * math.lcm(stimulus, control)):
        check(deployment)
    else:
        with pytest.raises(DeploymentError, match="would wait for each other"):
            check(deployment)
