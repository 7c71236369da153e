"""A recording replayed: into the same controller without a difference, to watchers in its time."""

import json
import re
import shutil
import socket
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from launching import launched, skinnet, wait_for
from locations import ROOT
from recorded import ARM, SHORT, plain, recorded_once
from requesting import request
from zenoh_clients import client, endpoint_of

from skinnet.protocol.messages import Answer, Command, Request, decode
from skinnet.recording.playback_publisher import PlaybackOptions, PlaybackSchedule
from skinnet.recording.reader import Recording
from skinnet.recording.replay import CommandDifference, replay_into

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module", params=SHORT)
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_once(request.param, tmp_path_factory)[0] / "run.mcap"


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_once("touch", tmp_path_factory)[0] / "run.mcap"


def replay(*arguments: str) -> tuple[int, str]:
    """Exit code of `skinnet replay` and the one line that it prints."""
    done = skinnet("replay", *arguments)
    (said,) = (done.stdout + done.stderr).splitlines()
    return done.returncode, said


def test_the_same_controller_says_the_same(recording: Path) -> None:
    own = Recording(recording)
    verdict = replay_into(own, own.deployment(), own.base)
    commands = [m for m in own.messages() if m.channel == "command"]
    assert verdict.difference is None
    assert (verdict.ticks, verdict.t_ns, verdict.note) == (len(commands), commands[-1].t_ns, "")
    assert len(commands) > 200


def test_one_gain_changed_is_named(touched: Path, tmp_path: Path) -> None:
    code, said = replay(str(touched), "--into", "controller")
    assert code == 0
    assert re.fullmatch(r"no difference in \d+ commands up to \d+\.\d+ s", said)
    gain = "controller.stages.force_guidance.force_gain=1.001"
    report = tmp_path / "verdict.json"
    code, said = replay(str(touched), "--into", "controller", "--set", gain, "--json", str(report))
    assert code == 1
    named = re.fullmatch(
        r"different at (\d+\.\d+) s, stage force_guidance, after (\d+) equal commands: "
        r"velocity of (\w+) \[rad/s; m/s if it slides\] was (\S+), is (\S+)",
        said,
    )
    assert named is not None, said
    own = Recording(touched)
    first = json.loads(report.read_text())["difference"]
    (command,) = [m for m in own.messages() if m.channel == "command" and m.t_ns == first["t_ns"]]
    joint = own.deployment_dict["body"]["joints"].index(named[3])
    velocity = decode(command.payload, Command).velocity_rad_s[joint]
    assert float(named[4]) == velocity != float(named[5])
    assert float(named[5]) == pytest.approx(velocity * 1.001, rel=1e-3)


def test_a_difference_after_another_arithmetic_is_no_proof(touched: Path, tmp_path: Path) -> None:
    """The summary beside the recording says with which arithmetic it was made."""
    summary = json.loads((touched.parent / "summary.json").read_text())
    summary["arithmetic"]["functions"] = "0"
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    shutil.copy(touched, tmp_path / "run.mcap")
    gain = "controller.stages.force_guidance.force_gain=1.001"
    done = skinnet("replay", str(tmp_path / "run.mcap"), "--into", "controller", "--set", gain)
    first, second = done.stdout.splitlines()
    assert first.startswith("different at")
    assert second == (
        f"{tmp_path / 'run.mcap'}: computed with another arithmetic (functions): values may differ in their "
        "last bits, and hashes cannot be compared"
    )


def test_another_program_is_a_difference_as_well(touched: Path) -> None:
    own = Recording(touched)
    deployment = own.deployment()
    stage = msgspec.structs.replace(deployment.controller.stages["force_guidance"], duration_s=0.5)
    stages = {**deployment.controller.stages, "force_guidance": stage}
    control = msgspec.structs.replace(deployment.controller, stages=stages)
    verdict = replay_into(own, msgspec.structs.replace(deployment, controller=control), own.base)
    assert isinstance(verdict.difference, CommandDifference)
    assert verdict.difference.stage == "force_guidance"


def test_the_controller_of_another_robot_is_refused(touched: Path) -> None:
    code, said = replay(str(touched), "--into", "controller", "--deployment", str(ARM))
    assert code == 2
    assert said == "skinnet: the recording and the deployment differ in robot: recorded hrp2, deployed arm"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ((), "give either --into controller or --publish"),
        (("--into", "body"), "--into body: allowed: controller"),
        (("--publish", "--from", "2", "--until", "1"), "--until 1: must be later than --from 2"),
        (("--publish", "--from", "99"), "--from 99: the recording ends at "),
        (("--publish", "--set", "seed=2"), "--deployment and --set are for --into"),
        (("--into", "controller", "--set", "run.max=2"), "unknown key"),
    ],
)
def test_what_cannot_be_replayed_is_said_in_one_line(
    touched: Path, arguments: tuple[str, ...], why: str
) -> None:
    code, said = replay(str(touched), *arguments)
    assert code == 2
    assert why in said


@pytest.mark.processes
def test_requests_are_replayed_at_their_ticks(tmp_path: Path) -> None:
    """A session that users lead: what they asked is in the record, and leads the replayed one."""
    settings = (
        'controller.program=["session"]',
        'controller.stages.session={kind="teach_and_grasp"}',
        "run.pace=realtime",
        "run.max_s=600",
    )
    with launched(ARM, tmp_path, "--record", settings=settings) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        wait_for(process, "session")
        asked = [
            ("remember", "home"),
            ("guide", "force"),
            ("remember", "open"),
            ("guide", "off"),
        ]
        codes = [request(endpoint, *filter(None, words))[0] for words in asked]
        ended = 1
        while ended:  # what goes on has to come to its end first
            ended, said = request(endpoint, "end")
            assert ended in (0, 1), said
            asked.append(("end", ""))
            codes.append(ended)
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    own = Recording(tmp_path / "run.mcap")
    messages = list(own.messages())
    requests = [m for m in messages if m.channel == "request"]
    answers = {a.id: a for a in (decode(m.payload, Answer) for m in messages if m.channel == "answer")}
    assert [(m.fields[0], decode(m.payload, Request).argument) for m in requests] == asked
    assert [answers[decode(m.payload, Request).id].t_ns for m in requests] == [m.t_ns for m in requests]
    assert [not answers[decode(m.payload, Request).id].accepted for m in requests] == list(map(bool, codes))
    assert any(code == 0 for code in codes)
    verdict = replay_into(own, own.deployment(), own.base)
    assert (verdict.difference, verdict.note) == (None, "")
    assert verdict.ticks == sum(m.channel == "command" for m in messages)


def test_playing_keeps_to_time_rate_and_stretch(touched: Path) -> None:
    own = Recording(touched)
    everything = list(own.messages())
    at_once = list(PlaybackSchedule(own, PlaybackOptions()).scheduled_messages())
    assert [m for _, m in at_once] == everything
    assert [due_s for due_s, _ in at_once] == pytest.approx([m.t_ns * 1e-9 for m in everything])
    from_ns, until_ns = 1_000_000_000, 1_500_000_000
    playback = PlaybackSchedule(own, PlaybackOptions(from_ns, until_ns, rate=0.5))
    part = list(playback.scheduled_messages())
    inside = [m for m in everything if from_ns <= m.t_ns <= until_ns]
    assert [m for _, m in part][-len(inside) :] == inside
    assert [due_s for due_s, _ in part][-len(inside) :] == pytest.approx(
        [(m.t_ns - from_ns) * 2e-9 for m in inside]
    )
    before = [m for due_s, m in part[: -len(inside)]]
    known = {m.channel for m in before}
    assert known == {"topology", "state", "state_machine"}, "who comes later has to know what holds"
    assert all(m.t_ns < from_ns for m in before)
    assert {key for key in playback.latched if key.endswith("topology")} == {
        m.key for m in everything if m.channel == "topology"
    }
    looped = PlaybackSchedule(
        own, PlaybackOptions(from_ns, until_ns, rate=0.5, loop=True)
    ).scheduled_messages()
    twice = list(islice(looped, 2 * len(part)))
    assert [m for _, m in twice] == 2 * [m for _, m in part]
    assert [due_s for due_s, _ in twice[len(part) :]] == [due_s + 1.0 for due_s, _ in part]


@pytest.mark.processes
def test_watchers_see_what_was_recorded(touched: Path) -> None:
    own = Recording(touched)
    line = [
        sys.executable,
        "-m",
        "skinnet.cli",
        "replay",
        str(touched),
        "--publish",
        "--wait",
        "--rate",
        "20",
    ]
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as player:
        endpoint = endpoint_of(wait_for(player, "connect to"))
        heard: list[tuple[str, bytes]] = []
        with client(endpoint) as session:
            (reply,) = session.get("skinnet/*/deployment", timeout=30)
            deployed = msgpack.unpackb(reply.ok.payload.to_bytes())
            assert json.loads(deployed["deployment"]) == own.deployment_dict
            assert deployed["base_folder"] == str(own.base)

            def keep(sample: Any) -> None:
                heard.append((str(sample.key_expr), sample.payload.to_bytes()))

            session.declare_subscriber("skinnet/**", keep)
            out, errors = player.communicate(timeout=120)
        assert player.returncode == 0, errors
    wanted = [(m.topic, m.payload) for m in plain(touched) if m.topic.startswith("skinnet/")]
    assert out.splitlines()[-1] == f"{len(wanted)} messages"
    assert len(heard) > 0.9 * len(wanted)  # watchers hear by best effort
    left = iter(wanted)
    assert all(message in left for message in heard), "as they were said, and in their order"


def test_an_endpoint_that_is_taken_is_said(touched: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, said = replay(str(touched), "--publish", "--listen", f"tcp/127.0.0.1:{taken.getsockname()[1]}")
    assert code == 2
    assert "already taken" in said
