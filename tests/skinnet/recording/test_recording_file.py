"""What is on disk after a kill, on a full disk, and when somebody brings another file."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from launching import child, command, family, gone, launched, run, skinnet, wait_for
from locations import ROOT
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer as PlainWriter
from memory_robot import ROBOT, known
from recorded import ARM, SHORT_ARM, plain, recorded_once
from small_robot import small

from skinnet.errors import RecordingError
from skinnet.memory.sqlite_store import read_memory, write_memory
from skinnet.recording.mcap_writer import McapWriter
from skinnet.recording.reader import Recording
from skinnet.recording.replay import with_memory
from skinnet.recording.writer import RecordingWriter

pytestmark = pytest.mark.timeout(300)
KILLS = 10
entries = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 2**62), st.binary(max_size=80), st.booleans()), max_size=40
)


def written(rows: list[tuple[int, int, bytes, bool]]) -> tuple[bytes, list[int]]:
    """A file of messages, chunks ended where a row says so, and where each chunk ends."""
    file = io.BytesIO()
    mcap = McapWriter(file, "test", "test")
    schema = mcap.add_schema("s", "jsonschema", b"{}")
    channels = [mcap.add_channel(f"topic{i}", "msgpack", schema) for i in range(4)]
    mcap.add_metadata("about", {"a": "b"})
    ends = []
    for channel, t_ns, payload, ends_chunk in rows:
        mcap.add_message(channels[channel], t_ns, payload)
        if ends_chunk:
            mcap.flush()
            ends.append(mcap.n_bytes)
    mcap.add_attachment("file", "text/plain", b"content")
    mcap.finish()
    return file.getvalue(), ends


@given(rows=entries)
def test_the_plain_reader_reads_what_was_written(rows: list[tuple[int, int, bytes, bool]]) -> None:
    content, _ = written(rows)
    for reader in (
        make_reader(io.BytesIO(content), validate_crcs=True),
        NonSeekingReader(io.BytesIO(content)),
    ):
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages(log_time_order=False)]
        assert found == [(f"topic{channel}", t_ns, payload) for channel, t_ns, payload, _ in rows]
    reader = make_reader(io.BytesIO(content), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(rows)
    assert [a.data for a in reader.iter_attachments()] == [b"content"]
    assert [(m.name, m.metadata) for m in reader.iter_metadata()] == [("about", {"a": "b"})]
    middle = sorted(t_ns for _, t_ns, _, _ in rows)[len(rows) // 2 :][:1]
    for t_ns in middle:  # by the index of chunks and messages
        later = [m.log_time for _, _, m in reader.iter_messages(starting_at=t_ns)]
        assert later == sorted(row[1] for row in rows if row[1] >= t_ns)


def up_to_the_end(content: bytes) -> list[bytes]:
    """What the plain reader of records gets out of a file that may be cut."""
    found: list[bytes] = []
    # the reader has an exception for every way in which bytes can be missing
    with contextlib.suppress(Exception):
        records = StreamReader(io.BytesIO(content), validate_crcs=True).records
        found.extend(record.data for record in records if isinstance(record, Message))
    return found


@given(rows=entries, share=st.floats(0.0, 1.0))
def test_a_file_that_is_cut_opens_up_to_its_last_chunk(
    rows: list[tuple[int, int, bytes, bool]], share: float
) -> None:
    content, ends = written(rows)
    cut = int(share * len(content))
    payloads = [row[2] for row in rows]
    ended = [i for i, row in enumerate(rows) if row[3]]
    whole = max((ended[i] + 1 for i, end in enumerate(ends) if end <= cut), default=0)
    found = up_to_the_end(content[:cut])
    assert found == payloads[: len(found)]
    assert len(found) >= whole


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_once("arm", tmp_path_factory)[0] / "run.mcap"


FEEDER = """
import os, sys
from pathlib import Path
from skinnet.recording import writer
from skinnet.recording.process import build
from skinnet.recording.reader import Recording

writer._CHUNK_S = 0.0
own = Recording(Path(sys.argv[1]))
messages = list(own.messages())

def feed(out, last):
    node = build(own.deployment(), "recorder", own.base, out)
    node.start(None)
    for number, message in enumerate(messages):
        node.accept(message.channel, message.fields, message.payload)
        while (needs := node.needs()) is not None and all(
            node.upstreams[name].watermark_ns >= t_ns for name, t_ns in needs.items()
        ):
            node.step(None)
        if number == last:
            print(os.getpid(), flush=True)
            sys.stdin.read()

for number, last in enumerate(map(int, sys.argv[3:])):
    pid = os.fork()
    if not pid:
        feed(Path(sys.argv[2], str(number)), last)
        os._exit(1)
    print(os.waitpid(pid, 0)[1], flush=True)
"""
"""Recorders, one after the other, that get the messages of a recording again and write a chunk at every step.
At a number each says which process it is and waits for its end, so that a slow reader does not let it come to
its own. Then this process says how it ended."""


@pytest.mark.processes
def test_a_kill_at_any_moment_leaves_a_readable_file(recording: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    wanted = plain(recording)
    lengths = []
    folders = [tmp_path / str(number) for number in range(KILLS)]
    for out in folders:
        out.mkdir()
    last = [str(rng.integers(200, 0.9 * len(wanted) * 0.9)) for _ in folders]
    line = [sys.executable, "-c", FEEDER, str(recording), str(tmp_path), *last]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(line, text=True, cwd=ROOT, **pipes) as feeder:
        assert feeder.stdout is not None
        for _ in folders:
            os.kill(int(feeder.stdout.readline()), signal.SIGKILL)
            assert int(feeder.stdout.readline()) == signal.SIGKILL
    for out in folders:
        own = Recording(out / "run.mcap")
        assert not own.complete
        found = list(own.all_messages())
        assert found == [(m.t_ns, m.topic, m.payload) for m in wanted[: len(found)]]
        assert up_to_the_end((out / "run.mcap").read_bytes())[: len(found)] == [m[2] for m in found]
        lengths.append(len(found))
    assert min(lengths) > 0
    assert len(set(lengths)) > KILLS // 2


@pytest.mark.processes
def test_a_run_that_is_killed_leaves_its_record(tmp_path: Path) -> None:
    settings = ("run.pace=realtime", "run.max_s=600")
    with launched(ARM, tmp_path, "--record", settings=settings) as process:
        wait_for(process, "map")
        everybody = family(process)
        for one in everybody:
            one.kill()
        assert gone(everybody)
    own = Recording(tmp_path / "run.mcap")
    assert not own.complete
    assert {m.channel for m in own.messages()} >= {
        "joints",
        "command",
        "stream",
        "state",
        "topology",
        "free_bodies",
    }
    done = skinnet("replay", str(own.path), "--into", "controller")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("no difference in ")
    assert done.stdout.endswith("s; the recording is truncated there\n")


@pytest.mark.processes
def test_a_run_that_is_interrupted_ends_its_record(tmp_path: Path) -> None:
    with launched(ARM, tmp_path, "--record", settings=("run.pace=realtime", "run.max_s=600")) as process:
        wait_for(process, "structure")
        process.send_signal(signal.SIGINT)
        process.wait(timeout=60)
    assert Recording(tmp_path / "run.mcap").complete
    assert plain(tmp_path / "run.mcap")


@pytest.mark.processes
@pytest.mark.parametrize("tolerated_losses", [False, True])
def test_a_recorder_that_is_killed(tmp_path: Path, tolerated_losses: bool) -> None:
    allowed = ('run.tolerated_losses=["recorder"]',) if tolerated_losses else ()
    settings = ("run.pace=realtime", "run.max_s=4.0", *allowed)
    with launched(ARM, tmp_path, "--record", settings=settings) as process:
        wait_for(process, "structure")
        child(process, "recorder").kill()
        out, errors = process.communicate(timeout=120)
    assert process.returncode == (0 if tolerated_losses else 1)
    if tolerated_losses:
        assert "recorder was killed by signal 9; the run goes on without it" in out
    else:
        assert errors.startswith("skinnet: recorder was killed by signal 9")


FULL = "cannot write the recording: File too large"
LIMIT_BYTES = 65_536
"""Size of a file at which writing fails, as on a disk that is full."""


def full_in_process(out: Path, settings: tuple[str, ...]) -> tuple[int, str]:
    """Exit code and errors of a run in one process, no file of which can grow beyond the limit."""
    line = command(ARM, "--no-plots", "--record", "--out", str(out), "--in-process", settings=settings)
    shell = ["bash", "-c", f'ulimit -f {LIMIT_BYTES // 1024}; exec "$@"', "limited", *line]
    done = subprocess.run(shell, capture_output=True, text=True, check=False, timeout=120)
    return done.returncode, done.stderr


def full_in_processes(out: Path, settings: tuple[str, ...]) -> tuple[int, str]:
    """Exit code and errors of a run in processes, whose recorder cannot write any more from a moment on."""
    with launched(ARM, out, "--record", settings=settings) as process:
        wait_for(process, "structure")
        child(process, "recorder").rlimit(psutil.RLIMIT_FSIZE, (LIMIT_BYTES, LIMIT_BYTES))
        _, errors = process.communicate(timeout=120)
    return process.returncode, errors


@pytest.mark.processes
@pytest.mark.parametrize(
    ("full", "settings"),
    [(full_in_processes, ("run.max_s=12.0",)), (full_in_process, SHORT_ARM)],
    ids=["processes", "in process"],
)
def test_a_full_disk_ends_the_run_or_only_the_record(
    tmp_path: Path, full: Callable[[Path, tuple[str, ...]], tuple[int, str]], settings: tuple[str, ...]
) -> None:
    code, errors = full(tmp_path, settings)
    assert code == 1, errors
    assert FULL in errors
    assert "Traceback" not in errors
    spared = (*settings, 'run.tolerated_losses=["recorder"]')
    code, errors = full(tmp_path, spared)
    assert code == 0, errors
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["outcome"] == "completed_with_losses"
    assert [fault["process"] for fault in summary["process_failures"]] == ["recorder"]
    alone = run(ARM, tmp_path / "alone", "--in-process", settings=spared)
    assert summary["log_sha256"] == alone["log_sha256"]


def foreign(path: Path, about: dict[str, str] | None) -> Path:
    with path.open("wb") as file:
        writer = PlainWriter(file)
        writer.start("other")
        if about is not None:
            writer.add_metadata("skinnet", about)
        writer.finish()
    return path


def test_what_is_no_recording_is_refused_in_one_line(recording: Path, tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("nothing of the kind")
    damaged = tmp_path / "damaged.mcap"
    content = bytearray(recording.read_bytes())
    begin = Recording(recording).chunk_offsets[0]
    content[begin + 200] ^= 0xFF
    damaged.write_bytes(content)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:120])
    cases = [
        (tmp_path / "none.mcap", "no such file or directory"),
        (tmp_path, "is a directory"),
        (text, "not a recording: not an MCAP file"),
        (
            foreign(tmp_path / "other.mcap", None),
            "not a skinnet recording: an MCAP file without the metadata record of skinnet",
        ),
        (
            foreign(tmp_path / "new.mcap", {"format": "3", "skinnet": "9.1"}),
            "a recording of format 3, by skinnet 9.1",
        ),
        (foreign(tmp_path / "bare.mcap", {"format": "1"}), "truncated before its deployment"),
        (
            cut,
            "not a skinnet recording: an MCAP file without the metadata record of skinnet, or",
        ),
        (damaged, "damaged at byte"),
    ]
    for path, why in cases:
        with pytest.raises(RecordingError) as caught:
            list(Recording(path).messages())
        said = str(caught.value)
        assert said.startswith(f"{path}: {why}"), said
        assert "\n" not in said
    for arguments in ((str(text), "--into", "controller"), (str(damaged), "--into", "controller")):
        done = skinnet("replay", *arguments)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1


def test_the_memory_that_a_run_starts_with_is_in_its_record(tmp_path: Path) -> None:
    patches = [
        {
            "name": name,
            "body": name,
            "cells": [
                {"position_m": (0.03 * i, 0, 0), "normal": (0, 0, 1), "x_axis": (1, 0, 0)} for i in range(n)
            ],
            "interfaces": [{"cell": 0, "port": 2}],
        }
        for name, n in ROBOT.patches.items()
    ]
    settings: dict[str, Any] = {"memory": {"read": "taught.sqlite"}, "robot": ROBOT.name}
    settings["body"] = {"joints": ROBOT.joints}
    deployment = small(*patches, **settings)
    (tmp_path / "here").mkdir()
    write_memory(tmp_path / "here" / "taught.sqlite", known())
    writer = RecordingWriter(tmp_path / "run.mcap", deployment, tmp_path / "here")
    writer.open()
    writer.close()
    own = Recording(tmp_path / "run.mcap")
    (tmp_path / "here" / "taught.sqlite").unlink()
    with with_memory(own, own.deployment()) as remembering:
        assert remembering.memory.read is not None
        assert read_memory(Path(remembering.memory.read)).digest() == known().digest()
    assert not Path(remembering.memory.read).exists()
