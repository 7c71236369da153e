"""Every row of the channel table passes every node that may see it: accepted, or refused as a message."""

import contextlib
import json
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from launching import launched, wait_for
from locations import ROOT
from zenoh_clients import client, endpoint_of

from skinnet.deployment import load
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import CHANNELS, RECORDER, Channel, Keys
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import Config, Message, decode, encode
from skinnet.recording.reader import Recording
from skinnet.run.process_list import process_list
from skinnet.runtime.loop import Closeable
from skinnet.runtime.worker import build_process
from skinnet.view.state.run_state import ReceivedMessage, RunState
from skinnet.view.state.skin_layout import build_skin_layout

ARM, RIBA = ROOT / "deployments" / "two_link_arm.toml", ROOT / "deployments" / "riba_trajectory.toml"
UNDECODABLE = (b"", b"\xc1", b"\x80", b"nonsense", encode(Config(patch="base", cell=0)) + b"\0")
NUMBERS = st.sampled_from([0, 1, 3, -1, 255, 5_000_000, 2**31, 2**62 + 1, 2**63 - 1, -(2**63)])
WORDS = st.sampled_from(["base", "fore_link", "cells0", "boards", "", "ghost", "ü"])
FIELDS = {"patch": "base", "process": "cells0", "cell": "0", "network": "boards", "name": "go"}


def values(kind: Any) -> st.SearchStrategy[Any]:
    """Values of a field's type, mostly out of range."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return st.one_of([values(one) for one in inner])
    if origin is list:
        return st.lists(values(inner[0]), max_size=3)
    if origin is dict:
        return st.dictionaries(values(inner[0]), values(inner[1]), max_size=2)
    plain: dict[Any, st.SearchStrategy[Any]] = {
        int: NUMBERS,
        str: WORDS,
        bool: st.booleans(),
        float: st.sampled_from([0.0, 1.5, -1e308, float("inf"), float("nan")]),
        bytes: st.sampled_from([b"", b"\xff" * 60, b"\0" * 44, b"\xff" * 28, b"\0" * 7]),
        type(None): st.none(),
    }
    return plain[kind]


def messages(row: Channel) -> st.SearchStrategy[Message]:
    hints = typing.get_type_hints(row.message)
    return st.builds(row.message, **{k: values(v) for k, v in hints.items() if k != "schema"})


def fields_of(row: Channel) -> tuple[str, ...]:
    return tuple(FIELDS[part[1:-1]] for part in row.pattern.split("/") if part.startswith("<"))


ROWS = pytest.mark.parametrize("row", CHANNELS, ids=[row.name for row in CHANNELS])
FEW = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module", params=[ARM, RIBA], ids=["cells", "sheets"])
def nodes(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, Any]]:
    """Every process of a recorded run, and the state of a page."""
    deployment, out = load(request.param, ("run.max_s=0.1",)), tmp_path_factory.mktemp("out")
    found: dict[str, Any] = {
        spec.name: build_process(spec.module, deployment, spec.name, request.param.parent, out, recorded=True)
        for spec in process_list(deployment, record=True)
    }
    found[RECORDER].start(lambda _key, _payload: None)
    yield found | {"page": RunState(deployment, build_skin_layout(deployment))}
    for node in found.values():
        if isinstance(node, Closeable):
            node.close()
    assert Recording(out / "run.mcap").complete


@ROWS
@FEW
@given(data=st.data())
def test_a_message_is_accepted_or_refused_as_one(nodes: dict[str, Any], row: Channel, data: Any) -> None:
    message = data.draw(messages(row))
    for name, node in nodes.items():
        if name == "page":
            node.apply(ReceivedMessage(row.name, fields_of(row), message, 0), 0.0)
            node.update_statistics()
            continue
        for payload in (encode(message), *UNDECODABLE):
            with contextlib.suppress(ProtocolError):
                node.accept(row.name, fields_of(row), payload)


@ROWS
def test_an_undecodable_message_is_refused_by_every_process(nodes: dict[str, Any], row: Channel) -> None:
    for name, node in nodes.items():
        if name == "page":
            continue
        for payload in UNDECODABLE:
            if row.message is Config and payload == UNDECODABLE[-1]:
                continue
            with pytest.raises(ProtocolError):
                node.accept(row.name, fields_of(row), payload)


def test_what_external_clients_say_is_in_the_recording(tmp_path: Path) -> None:
    """A velocity ended a recorded run, and so did a configuration whose time no recording holds."""
    deployment = load(ARM, ("run.max_s=0.1", "controller.external_velocity=true"))
    recorder: Any = build_process(
        "skinnet.recording", deployment, RECORDER, ARM.parent, tmp_path, recorded=True
    )
    recorder.start(lambda _key, _payload: None)
    said = {
        "velocity": encode(ExternalVelocity(velocity_rad_s=[0.1, 0.2])),
        "config": encode(Config(patch="base", cell=0, stream=True)),
    }
    recorder.accept("velocity", (), said["velocity"])
    recorder.accept("config", ("base", "0"), said["config"])
    with pytest.raises(ProtocolError, match="t_ns is -5"):
        recorder.accept("config", ("base", "0"), encode(Config(patch="base", cell=0, t_ns=-5)))
    recorder.close()
    found = {message.channel: message.payload for message in Recording(tmp_path / "run.mcap").messages()}
    assert {name: found.get(name) for name in said} == said
    assert decode(found["velocity"], ExternalVelocity).velocity_rad_s == [0.1, 0.2]
    assert Keys(deployment.robot).of("velocity").endswith("controller/velocity")


@pytest.mark.processes
@pytest.mark.timeout(200)
def test_a_recorded_run_outlives_what_external_clients_say(tmp_path: Path) -> None:
    """Correct and undecodable messages on every key, over Zenoh, while a recorder takes part."""
    sets = ('controller.program=["structure"]', "run.max_s=6", "controller.external_velocity=true")
    velocity = encode(ExternalVelocity(velocity_rad_s=[0.0] * len(load(ARM).body.joints)))
    with launched(ARM, tmp_path, "--record", settings=sets) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        wait_for(process, "structure")
        with client(endpoint) as session:
            keys = Keys("arm")
            for row in CHANNELS:
                session.put(keys.of(row.name, *fields_of(row)), b"nonsense")
            session.put(keys.of("velocity"), velocity)
            session.put(keys.of("config", "base", 0), encode(Config(patch="base", cell=0, t_ns=-7)))
            _, errors = process.communicate(timeout=150)
        assert process.returncode == 0, errors
    recording = Recording(tmp_path / "run.mcap")
    assert recording.complete
    velocities = [m.payload for m in recording.messages() if m.channel == "velocity"]
    assert velocities == [velocity]
    counters = json.loads((tmp_path / "summary.json").read_text())["counters"]
    assert counters["controller"]["external_velocities"] == 1
    assert counters["controller"]["malformed_messages"] >= 1
    assert counters["recorder"]["malformed_messages"] >= 2
