"""Child processes of a run: start, log, exit and stop of `python -m <module>`."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from skinnet.errors import ProcessFailedError
from skinnet.protocol.channels import Role
from skinnet.run.collect import RESULT_FOLDER, EndedProcess
from skinnet.run.context import RunContext
from skinnet.run.process_list import ProcessSpec

__all__ = ["LOG_FOLDER", "ChildProcess", "assign_cores", "start_process", "stop_processes"]

LOG_FOLDER = "logs"
"""Folder of the logs of separate processes in a run folder."""
_STOP_TIMEOUT_S = 3.0
_N_LAST_LINES = 8
_THREAD_LIMITS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
"""Thread limits of the numerical libraries: one per process, since the processes run in parallel."""


@dataclass(frozen=True)
class ChildProcess:
    """Child process with its specification and its log file."""

    spec: ProcessSpec
    process: asyncio.subprocess.Process
    log: Path

    def last_lines(self) -> tuple[str, ...]:
        """Return the last lines of the log."""
        text = self.log.read_text(errors="replace") if self.log.exists() else ""
        return tuple(text.strip().splitlines()[-_N_LAST_LINES:])

    def exit_description(self) -> str:
        """Describe the exit of the process in words."""
        code = self.process.returncode
        assert code is not None
        return f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"

    def failure_error(self) -> ProcessFailedError:
        """Return the error that names the process, its exit, and its last lines."""
        lines = self.last_lines()
        said = "; its last lines:\n    " + "\n    ".join(lines) if lines else "; its log is empty"
        return ProcessFailedError(f"{self.spec.name} {self.exit_description()}{said}")

    def ended(self) -> EndedProcess:
        """Return specification, process ID and exit code."""
        return EndedProcess(self.spec, self.process.pid, self.process.returncode)


def assign_cores(specs: Sequence[ProcessSpec]) -> list[list[int]]:
    """Assign one core to each process, round robin from an offset by launcher, so that parallel runs spread.

    The recorder may use all cores: no process depends on it.
    """
    if not hasattr(os, "sched_getaffinity"):
        return [[]] * len(specs)
    cores = sorted(os.sched_getaffinity(0))
    return [
        cores if spec.role is Role.RECORDER else [cores[(os.getpid() + i) % len(cores)]]
        for i, spec in enumerate(specs)
    ]


async def start_process(context: RunContext, spec: ProcessSpec, hub: str, cores: list[int]) -> ChildProcess:
    """Start one process of a run; its standard input is a pipe of this process.

    Args:
        context: Context of the run.
        spec: Process to start.
        hub: Zenoh endpoint of the hub to connect to, which the body listens on.
        cores: Cores to pin it to; any if empty.
    """
    log = context.out / LOG_FOLDER / f"{spec.name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    arguments = (
        *("--deployment", context.out / "deployment.json", "--base", context.base),
        *("--name", spec.name, "--parts", context.out / RESULT_FOLDER),
        *("--run", context.folder.identity.run_id),
        *("--listen" if spec.name == "body" else "--connect", hub),
        *(("--recorded",) if context.record else ()),
        *(("--cpus", *cores) if cores else ()),
    )
    with log.open("wb") as output:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", spec.module, *map(str, arguments)),
            stdin=asyncio.subprocess.PIPE,
            stdout=output,
            stderr=output,
            env=os.environ | _THREAD_LIMITS,
            pass_fds=(context.folder.lock,),  # a process that outlives its launcher still owns the folder
        )
    return ChildProcess(spec, process, log)


async def stop_processes(children: Iterable[ChildProcess]) -> None:
    """Terminate the running processes (SIGTERM); kill those still running after a timeout (SIGKILL)."""
    running = [child.process for child in children if child.process.returncode is None]
    for process in running:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
    if running:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_STOP_TIMEOUT_S):
                await asyncio.gather(*(process.wait() for process in running))
    for process in running:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
