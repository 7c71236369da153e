"""How tests start whole runs and other commands.

`skinnet` is the command line in the process of the test: the start of an interpreter, which imports the
program and loads what Numba has compiled, takes longer than most commands. `started` is a process of its own,
for what only a process has: its environment, its entry point. `launched` is a run in a process of its own,
read line by line while it goes on.
"""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import psutil
from locations import ROOT

TOUCH = ROOT / "deployments" / "hrp2_touch.toml"

SHORT = (
    'controller.program=["map", "force_guidance"]',
    "controller.map.periods=1",
    "controller.map.frequency_hz=8",
    "controller.map.settle_s=0.05",
    "controller.stages.force_guidance.duration_s=2.0",
)
"""A map in a few seconds, then a touch: every channel has something to carry."""


def skinnet(*arguments: str, cwd: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    """Exit code and output of a command, run by the entry point of the program in this process.

    What is logged goes to pytest, not to standard error.
    """
    from skinnet.cli.main import main

    output, errors = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    code: object = 0
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(sys, "argv", ["skinnet", *arguments]))
        stack.enter_context(mock.patch.dict(os.environ, environment))
        stack.enter_context(contextlib.chdir(cwd))
        stack.enter_context(contextlib.redirect_stdout(output))
        stack.enter_context(contextlib.redirect_stderr(errors))
        stack.callback(signal.signal, signal.SIGTERM, signal.getsignal(signal.SIGTERM))
        try:
            main()
        except SystemExit as end:
            code = end.code
    output.seek(0)
    errors.seek(0)
    return subprocess.CompletedProcess(["skinnet", *arguments], int(code or 0), output.read(), errors.read())


def started(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Exit code and output of a command in a process of its own."""
    line = [sys.executable, "-m", "skinnet.cli", *arguments]
    everything = os.environ | environment
    return subprocess.run(
        line, capture_output=True, text=True, check=False, timeout=300, cwd=ROOT, env=everything
    )


def _run(file: Path, *arguments: str, settings: tuple[str, ...] = ()) -> list[str]:
    """Words of `skinnet run`."""
    sets = [word for setting in settings for word in ("--set", setting)]
    return ["run", str(file), *sets, *arguments]


def command(file: Path, *arguments: str, settings: tuple[str, ...] = ()) -> list[str]:
    """Command line of a run in a process of its own."""
    return [sys.executable, "-m", "skinnet.cli", *_run(file, *arguments, settings=settings)]


def run(file: Path, out: Path, *arguments: str, settings: tuple[str, ...] = ()) -> dict[str, Any]:
    """Summary of a run that must succeed; this process is its launcher, or the whole run."""
    return _summary(skinnet(*_run(file, "--no-plots", "--out", str(out), *arguments, settings=settings)), out)


def run_alone(
    file: Path, out: Path, *arguments: str, settings: tuple[str, ...] = (), **environment: str
) -> dict[str, Any]:
    """Summary of a run that must succeed, in a process of its own."""
    words = _run(file, "--no-plots", "--out", str(out), *arguments, settings=settings)
    return _summary(started(*words, **environment), out)


def _summary(done: subprocess.CompletedProcess[str], out: Path) -> dict[str, Any]:
    assert done.returncode == 0, done.stderr + done.stdout
    summary: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return summary


@contextmanager
def launched(
    file: Path, out: Path, *arguments: str, settings: tuple[str, ...] = ()
) -> Iterator[subprocess.Popen[str]]:
    """A run under way; whatever it started is gone when the block ends, or the test fails."""
    line = command(file, "--no-plots", "--out", str(out), *arguments, settings=settings)
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        for child in family(process):
            child.kill()
        process.communicate(timeout=60)


def wait_for(process: subprocess.Popen[str], text: str) -> str:
    """The first line of output that contains `text`; fails if the process ends before."""
    assert process.stdout is not None
    for line in process.stdout:
        if text in line:
            return line
    raise AssertionError(f"no line with {text!r}: {process.stderr.read() if process.stderr else ''}")


def family(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """The launcher, if it lives, and the processes that it started."""
    try:
        launcher = psutil.Process(process.pid)
        return [*launcher.children(recursive=True), launcher]
    except psutil.NoSuchProcess:
        return []


def called(processes: list[psutil.Process], word: str) -> psutil.Process:
    """The one of `processes` with `word` in its command line; what lives for a moment may be gone."""
    for one in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            if word in one.cmdline():
                return one
    raise AssertionError(f"no {word} among {processes}")


def child(process: subprocess.Popen[str], name: str) -> psutil.Process:
    """The process of the run that is called `name`."""
    for one in psutil.Process(process.pid).children():
        with contextlib.suppress(psutil.NoSuchProcess):
            words = one.cmdline()
            if "--name" in words and words[words.index("--name") + 1] == name:
                return one
    raise AssertionError(f"no process {name}")


def gone(processes: list[psutil.Process]) -> bool:
    """Whether all have ended, waiting for them."""
    _, alive = psutil.wait_procs(processes, timeout=30)
    return not alive
