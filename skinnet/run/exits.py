"""Exits of the processes of a run: waits for them, and finds the first cause of a failure.

A process that lost an upstream is not the cause: it names the upstream, which may name another one. At the
end of that chain is a process that failed, was killed, or is silent. Start and end have the run's deadline,
too: a process that neither joins the run nor works, or does not end with the others, is named.
"""

import asyncio
import time
from pathlib import Path

import msgspec

from skinnet.errors import ProcessFailedError
from skinnet.run.activity import ActivityMeter
from skinnet.run.child_process import ChildProcess
from skinnet.run.progress import ProgressDisplay
from skinnet.runtime.outcome import ProcessFailure
from skinnet.runtime.worker import LostUpstream, lost_file

__all__ = ["ExitWatch"]

_N_SLICES = 8
_MAX_SLICE_S = 0.5
_MIN_IDLE_S = 10.0
"""Shortest time [s] without processor time that counts as a hang: a start also waits for files."""
_CAUSE_TIMEOUT_S = 3.0
"""Time [s] for which a process that another one has lost may take to end, or to name its own loss."""


class ExitWatch:
    """Watch of the processes of a run until all have ended.

    Args:
        children: Processes, the hub first.
        results: Folder of their results.
        deadline_s: Deadline of the run [s].
        hub: Socket of the hub, which exists once it listens.
        progress: Display that tells of tolerated failures.

    Attributes:
        joined: Names of the processes that have joined the run; the caller adds to it.
    """

    def __init__(
        self,
        children: list[ChildProcess],
        results: Path,
        deadline_s: float,
        hub: Path,
        progress: ProgressDisplay,
    ) -> None:
        self._children, self._results, self._deadline_s = children, results, deadline_s
        self._hub, self._progress = hub, progress
        self.joined: set[str] = set()
        self._slice_s = min(deadline_s / _N_SLICES, _MAX_SLICE_S)
        self._idle_limit_s = max(deadline_s, _MIN_IDLE_S)
        self._meter = ActivityMeter({child.spec.name: child.process.pid for child in children}, self._slice_s)
        self._listening = self._started = False
        self._failures: list[ProcessFailure] = []

    def kill_silent(self, name: str) -> None:
        """Kill a silent process whose loss is tolerated: a stuck receiver would block all its senders."""
        child = next((child for child in self._children if child.spec.name == name), None)
        if child is None or not child.spec.loss_tolerated or child.process.returncode is not None:
            return
        cause = f"is silent: it runs, but sent no period end in time (run.deadline_s is {self._deadline_s:g})"
        self._note_failure(child, cause + self._meter.state(name))
        child.process.kill()

    async def wait(self) -> list[ProcessFailure]:
        """Wait for all processes; return the failures that the deployment tolerates.

        Raises:
            ProcessFailedError: a required process failed, does not start, or does not end.
        """
        waiting = {asyncio.create_task(child.process.wait()): child for child in self._children}
        try:
            while waiting:
                watched = not self._started or self._hub_has_ended()
                ended, _ = await asyncio.wait(
                    waiting,
                    timeout=self._slice_s if watched else None,
                    return_when=asyncio.FIRST_COMPLETED,
                )
                await self._handle_exits([waiting.pop(task) for task in ended])
                if not self._started:
                    self._check_start()
                elif self._hub_has_ended():
                    self._check_end()
        finally:
            for task in waiting:
                task.cancel()
        return self._failures

    def _hub_has_ended(self) -> bool:
        return self._children[0].process.returncode is not None

    async def _handle_exits(self, ended: list[ChildProcess]) -> None:
        if not ended:
            return
        failed = [child for child in ended if child.process.returncode != 0]
        required = [child for child in failed if not child.spec.loss_tolerated]
        if required:
            raise await self._find_cause(self._first_failed(required))
        for child in failed:
            self._note_failure(child, child.exit_description())
            if not self._started and child.spec.name not in self.joined:
                raise child.failure_error()  # the others would wait for it before the first period
        self._meter.restart()

    def _note_failure(self, child: ChildProcess, cause: str) -> None:
        """Note a tolerated failure, once."""
        if any(failure.process == child.spec.name for failure in self._failures):
            return
        self._failures.append(ProcessFailure(child.spec.name, cause, child.last_lines()))
        self._progress.print_line(f"{child.spec.name} {cause}; the run goes on without it")

    def _first_failed(self, failed: list[ChildProcess]) -> ChildProcess:
        """Select of simultaneous failures a process killed by a signal, else the first."""
        codes = ((child, child.process.returncode) for child in self._children)
        return next((child for child, code in codes if code is not None and code < 0), failed[0])

    async def _find_cause(self, failed: ChildProcess) -> ProcessFailedError:
        """Follow the chain of lost upstreams from a failed process to the first cause."""
        by_name = {child.spec.name: child for child in self._children}
        cause, seen = failed, {failed.spec.name}
        while (loss := self._loss_of(cause)) is not None and loss.process not in seen:
            blamed = by_name.get(loss.process)
            if blamed is None:
                break
            if not await _ends_within(blamed, _CAUSE_TIMEOUT_S):
                blamed = self._stopped_process() or blamed
                what = (
                    f"it runs, but sent no period end in time (run.deadline_s is {self._deadline_s:g})"
                    if loss.silent
                    else "it runs, but has left the run"
                )
                return self._silent_error(blamed, f"is silent: {what}; {cause.spec.name} waited for it")
            if blamed.process.returncode == 0:
                break
            cause = blamed
            seen.add(cause.spec.name)
        return cause.failure_error()

    def _stopped_process(self) -> ChildProcess | None:
        """Return the process that a signal has stopped: who sends to it is blocked, and silent for that."""
        running = (child for child in self._children if child.process.returncode is None)
        return next((child for child in running if self._meter.state(child.spec.name)), None)

    def _loss_of(self, child: ChildProcess) -> LostUpstream | None:
        """Return what `child` said it had lost; None if it failed for a reason of its own."""
        try:
            content = lost_file(self._results, child.spec.name).read_bytes()
            return msgspec.json.decode(content, type=LostUpstream)
        except (OSError, msgspec.DecodeError):
            return None

    def _check_start(self) -> None:
        """Require that every process has joined the run or works; before the hub listens, only the hub.

        Raises:
            ProcessFailedError: names the process that does not start.
        """
        self._meter.check(time.monotonic())
        if not self._listening and self._hub.exists():
            self._listening = True
            self._meter.restart()  # the others have waited for the hub
        missing = [child for child in self._children if child.spec.name not in self.joined]
        self._started = not missing
        for child in missing if self._listening else self._children[:1]:
            if child.process.returncode is None and self._is_idle(child):
                raise self._silent_error(
                    child,
                    f"did not start: it has not joined the run, and has done nothing for "
                    f"{self._idle_limit_s:g} s",
                )

    def _check_end(self) -> None:
        """Require that the processes which run on after the end of the hub, and of the run, still work.

        Raises:
            ProcessFailedError: names a required process that does not end.
        """
        self._meter.check(time.monotonic())
        for child in self._children:
            if child.process.returncode is not None or not self._is_idle(child):
                continue
            cause = (
                f"is silent: it did not end with the run, and has done nothing for {self._idle_limit_s:g} s"
            )
            if not child.spec.loss_tolerated:
                raise self._silent_error(child, cause)
            self._note_failure(child, cause + self._meter.state(child.spec.name))
            child.process.kill()

    def _is_idle(self, child: ChildProcess) -> bool:
        return self._meter.idle_s(child.spec.name) >= self._idle_limit_s * (1.0 - 1e-9)

    def _silent_error(self, child: ChildProcess, cause: str) -> ProcessFailedError:
        return ProcessFailedError(f"{child.spec.name} {cause}{self._meter.state(child.spec.name)}")


async def _ends_within(child: ChildProcess, timeout_s: float) -> bool:
    try:
        async with asyncio.timeout(timeout_s):
            await child.process.wait()
    except TimeoutError:
        return False
    return True
