"""What the processes of a run use of the machine, told to watchers while it goes on."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping

import psutil

from skinnet.run.progress import Progress
from skinnet.run.watch import Watch
from skinnet.watch_messages import ProcessLoad

__all__ = ["telling_loads"]

_EVERY_S = 0.5


class _Meter:
    """Processor time since it was last read, and memory."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._process: psutil.Process | None = None
        self._cpu_s: float | None = None

    def read(self, passed_s: float) -> tuple[float, float]:
        """Cores since the last call, `passed_s` ago, and memory [MB]; none of both for what is gone."""
        try:
            if self._process is None:
                self._process = psutil.Process(self.pid)
            with self._process.oneshot():
                times, memory = self._process.cpu_times(), self._process.memory_info().rss
        except psutil.Error:
            return 0.0, 0.0
        cpu_s = times.user + times.system
        before_s, self._cpu_s = self._cpu_s, cpu_s
        cores = (cpu_s - before_s) / passed_s if before_s is not None and passed_s > 0.0 else 0.0
        return cores, memory / 1024.0**2


class _Meters:
    """The meters of all processes."""

    def __init__(self, pids: Mapping[str, int], now_s: float) -> None:
        self._meters = {name: _Meter(pid) for name, pid in pids.items()}
        self._read_s = now_s

    def read(self, t_ns: int, now_s: float) -> ProcessLoad:
        passed_s, self._read_s = now_s - self._read_s, now_s
        read = [meter.read(passed_s) for meter in self._meters.values()]
        return ProcessLoad(
            t_ns=t_ns,
            name=list(self._meters),
            pid=[meter.pid for meter in self._meters.values()],
            cores=[cores for cores, _ in read],
            memory_mb=[memory_mb for _, memory_mb in read],
        )


@contextlib.asynccontextmanager
async def telling_loads(
    pids: Mapping[str, int], watch: Watch | None, progress: Progress
) -> AsyncIterator[None]:
    """While the block runs, tells what processes use, by name, twice a second if somebody wants to know."""
    if watch is None:
        yield
        return
    teller = asyncio.create_task(_tell(pids, watch, progress))
    try:
        yield
    finally:
        teller.cancel()


async def _tell(pids: Mapping[str, int], watch: Watch, progress: Progress) -> None:
    loop = asyncio.get_running_loop()
    meters = _Meters(pids, loop.time())
    while True:
        await asyncio.sleep(_EVERY_S)
        watch.tell_processes(lambda: meters.read(progress.t_ns, loop.time()))
