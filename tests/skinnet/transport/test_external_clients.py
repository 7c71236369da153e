"""Strangers with a plain Zenoh client see events, ask for topology, configure cells, hold up nobody."""

import json
import queue
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import pytest
import reported
from launching import SHORT, TOUCH, launched, run, wait_for
from zenoh_clients import client, endpoint_of

from skinnet.protocol.messages import SCHEMA

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]
_STUCK = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", json.dumps("client"))
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
subscriber = session.declare_subscriber("**", lambda sample: print("got", flush=True))
print("ready", flush=True)
sys.stdin.read()
"""


def test_events_topology_and_configuration(tmp_path: Path) -> None:
    """The whole conversation of a user with a run that goes on, in one run."""
    settings = (*reported.SHORT[:4], "controller.stages.evade.duration_s=600.0", "run.pace=realtime")
    settings += ("run.max_s=600.0", "teacher.touches.0.start_s=3.0", "teacher.touches.0.hold_s=500.0")
    with launched(reported.ARM, tmp_path, settings=settings) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        wait_for(process, "evade")
        events: queue.Queue[tuple[str, dict[str, Any]]] = queue.Queue()
        streams: queue.Queue[dict[str, Any]] = queue.Queue()

        def keep(sample: Any) -> None:
            events.put((str(sample.key_expr), msgpack.unpackb(sample.payload.to_bytes())))

        with client(endpoint) as session:
            session.declare_subscriber("skinnet/arm/skin/**/events", keep)
            key, message = events.get(timeout=60)
            assert key == f"skinnet/arm/skin/{message['patch']}/{message['cell'][0]}/events"
            assert (message["type"], message["schema"]) == ("events", SCHEMA)
            columns = [message[name] for name in ("cell", "t_sampled_ns", "modality", "level", "value")]
            assert len({len(column) for column in columns}) == 1

            replies = [reply.ok for reply in session.get("skinnet/arm/skin/*/topology", timeout=20)]
            topologies = {m["patch"]: m for m in (msgpack.unpackb(r.payload.to_bytes()) for r in replies)}
            assert len(topologies) == 3
            assert sorted(topologies["base"]["network_id"]) == list(range(1, 7))

            session.declare_subscriber(
                "skinnet/arm/skin/base/stream",
                lambda sample: streams.put(msgpack.unpackb(sample.payload.to_bytes())),
            )
            config = {"type": "config", "schema": SCHEMA, "patch": "base", "cell": 4, "stream": True}
            session.put("skinnet/arm/skin/base/4/config", msgpack.packb(config))
            session.put("skinnet/arm/skin/base/99/config", msgpack.packb(config | {"cell": 99}))
            session.put("skinnet/arm/skin/base/4/config", b"garbage")
            assert streams.get(timeout=60)["patch"] == "base"
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    log = (tmp_path / "logs" / "cells0.log").read_text()
    assert "base has cells 0 to 5" in log
    assert "not a Config" in log


def test_a_stuck_watcher_holds_up_nobody(tmp_path: Path) -> None:
    """A client that is stopped in the middle, with everything subscribed, changes nothing."""
    reference = run(TOUCH, tmp_path / "alone", "--in-process", settings=SHORT)
    with launched(TOUCH, tmp_path / "watched", settings=SHORT) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        watcher = subprocess.Popen(
            [sys.executable, "-c", _STUCK, endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert watcher.stdout is not None
        try:
            assert watcher.stdout.readline() == "ready\n"
            assert watcher.stdout.readline() == "got\n"
            watcher.send_signal(signal.SIGSTOP)
            _, errors = process.communicate(timeout=200)
            assert process.returncode == 0, errors
        finally:
            watcher.kill()
            watcher.communicate()
    watched = json.loads((tmp_path / "watched" / "summary.json").read_text())
    assert watched["log_sha256"] == reference["log_sha256"]
