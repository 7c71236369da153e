"""Users ask runs that go on, as real processes: whoever asks gets an answer, and the run does not mind."""

import json
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zenoh
from launching import child, launched, run, wait_for
from locations import ROOT
from requesting import request
from zenoh_clients import client, endpoint_of

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]
ARM = ROOT / "deployments" / "two_link_arm.toml"
REFUSED = "stage 'listen' takes no requests"


def listening(duration_s: float, *settings: str) -> tuple[str, ...]:
    """A program that only listens."""
    stage = f'controller.stages.listen={{kind="passive", duration_s={duration_s}}}'
    return ('controller.program=["listen"]', stage, "run.max_s=3600", *settings)


@contextmanager
def listener(out: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A run that listens for an hour, and where to ask it."""
    with launched(ARM, out, *arguments, settings=listening(3599.0, "run.pace=realtime")) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        wait_for(process, "listen")
        yield process, endpoint


def asked(session: Any, selector: str, payload: bytes = b"") -> dict[str, Any]:
    """The answer to a query, as any MessagePack library reads it."""
    (reply,) = session.get(selector, payload=payload, timeout=20)
    answer: dict[str, Any] = msgpack.unpackb(reply.ok.payload.to_bytes())
    return answer


def test_the_conversation_of_a_user_with_a_run(tmp_path: Path) -> None:
    with listener(tmp_path) as (process, endpoint):
        code, said = request(endpoint, "go", "home")
        assert code == 1
        assert re.fullmatch(rf"refused: {REFUSED}; state listen at \d+\.\d+ s", said)
        assert request(endpoint, "go", "--robot", "leg") == (
            2,
            f"skinnet: {endpoint}: no robot leg serves requests there; "
            "give the observer endpoint that a run prints",
        )
        assert request(endpoint, "go", "x" * 257) == (
            1,
            "skinnet: go: an argument of 257 bytes; at most 256",
        )
        told: queue.SimpleQueue[tuple[str, dict[str, Any]]] = queue.SimpleQueue()

        def keep(sample: Any) -> None:
            key = str(sample.key_expr).removeprefix("skinnet/arm/controller/")
            if key in ("request/go", "answer"):
                told.put((key, msgpack.unpackb(sample.payload.to_bytes())))

        with client(endpoint) as session:
            session.declare_subscriber("skinnet/arm/controller/**", keep)
            assert asked(session, "skinnet/arm/controller/state")["stage"] == "listen"
            answers: dict[int, dict[str, Any]] = {}
            copies: dict[str, list[dict[str, Any]]] = {"request/go": [], "answer": []}
            for selector, payload in cycle((("go?argument=home", b""), ("go", b"home"))):
                answer = asked(session, f"skinnet/arm/controller/request/{selector}", payload)
                assert (answer["type"], answer["accepted"], answer["reason"]) == ("answer", False, REFUSED)
                answers[answer["id"]] = answer
                while not told.empty():
                    key, message = told.get()
                    copies[key].append(message)
                if all(copies.values()):  # they begin when the launcher knows that somebody wants them
                    break
            assert all(copy == answers[copy["id"]] for copy in copies["answer"])
            assert {copy["argument"] for copy in copies["request/go"]} == {"home"}
            assert {copy["id"] for copy in copies["request/go"]} <= set(answers)
        page = (ROOT / "docs" / "requests.md").read_text(encoding="utf-8")
        (code_of_page,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
        assert set(re.findall(r"^import (\w+)$", code_of_page, re.MULTILINE)) == {"msgpack", "zenoh"}
        line = [sys.executable, "-c", code_of_page.replace("tcp/127.0.0.1:7447", endpoint)]
        shown = subprocess.run(line, capture_output=True, text=True, check=True, timeout=120)
        assert shown.stdout == f"refused in state listen because {REFUSED}\n"
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
        code, said = request(endpoint, "cancel", "--timeout", "0.5")
        assert code == 2
        assert said.startswith(f"skinnet: {endpoint}: no Zenoh endpoint, or nobody answers there")


def test_a_run_in_one_process_is_asked_through_its_endpoint(tmp_path: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="skin") as folder:  # a socket's path may have 108 bytes
        wished = f"unixsock-stream/{folder}/watch"
        with listener(tmp_path, "--in-process", "--listen", wished) as (process, endpoint):
            assert endpoint == wished
            code, said = request(endpoint, "go")
            assert (code, said.partition(";")[0]) == (1, f"refused: {REFUSED}")
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)


def test_a_flood_of_queries_changes_nothing(tmp_path: Path) -> None:
    reference = run(ARM, tmp_path / "alone", "--in-process", settings=listening(10.0))
    with launched(ARM, tmp_path / "flooded", settings=listening(10.0)) as process:
        endpoint = endpoint_of(wait_for(process, "connect to"))
        wait_for(process, "listen")
        replies: list[Any] = []
        complete = threading.Semaphore(0)
        with client(endpoint) as session:
            for _ in range(1000):
                handler = zenoh.handlers.Callback(replies.append, complete.release)
                session.get("skinnet/arm/controller/request/go", handler, timeout=60)
            for _ in range(1000):
                assert complete.acquire(timeout=60)
        _, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
    answers = [msgpack.unpackb(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
    refusals = [reply.err.payload.to_string() for reply in replies if reply.ok is None]
    assert len(answers) + len(refusals) == 1000
    assert {answer["reason"] for answer in answers} == {REFUSED}
    assert set(refusals) <= {"32 requests wait for their answers already; ask again later"}
    summary = json.loads((tmp_path / "flooded" / "summary.json").read_text())
    assert summary["log_sha256"] == reference["log_sha256"]
    counters = summary["counters"]
    assert counters["controller"] == {"external_requests": len(answers)}
    assert counters["observers"]["requests"] == len(answers)
    assert counters["observers"].get("refused_requests", 0) == len(refusals)
    facts = json.loads((tmp_path / "flooded" / "parts" / "controller.json").read_text())["facts"]
    assert [tuple(row[1:]) for row in facts["requests"]] == [("go", "", False)] * len(answers)


def test_a_second_controller_refuses_to_start(tmp_path: Path) -> None:
    with listener(tmp_path) as (process, endpoint), client(endpoint) as session:
        line = child(process, "controller").cmdline()
        (tmp_path / "twin").mkdir()  # in the same folder, the memory in use would stop it before
        line[line.index("--parts") + 1] = str(tmp_path / "twin" / "parts")
        pipe = subprocess.PIPE
        with subprocess.Popen(line, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as twin:
            assert twin.wait(timeout=120) == 1  # its standard input stays open: a worker ends when it closes
            assert twin.stdout is not None
            assert twin.stderr is not None
            assert twin.stdout.read() == ""
            (said,) = twin.stderr.read().splitlines()
        assert said.startswith("controller: ERROR controller: a process of this name is already in the loop")
        assert not (tmp_path / "twin" / "parts").exists()
        ticks_ns = [asked(session, "skinnet/arm/controller/request/go")["t_ns"] for _ in range(3)]
        assert ticks_ns == sorted(set(ticks_ns))
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    for log in ("body", "controller"):
        assert "dropped" not in (tmp_path / "logs" / f"{log}.log").read_text()
