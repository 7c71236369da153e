"""Process monitor: CPU and memory use of the processes of a run, published to observers."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping

import psutil

from skinnet.protocol.telemetry_messages import ProcessLoad
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.progress import ProgressDisplay

__all__ = ["monitor_processes"]

_PUBLICATION_PERIOD_S = 0.5


class _ProcessMeter:
    """Resource meter of one process: CPU time since the last reading, and memory."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._process: psutil.Process | None = None
        self._cpu_s: float | None = None

    def read(self, elapsed_s: float) -> tuple[float, float]:
        """Read mean cores since the last call, `elapsed_s` ago, and memory [MB]; zeros for a lost process."""
        try:
            if self._process is None:
                self._process = psutil.Process(self.pid)
            with self._process.oneshot():
                times, memory = self._process.cpu_times(), self._process.memory_info().rss
        except psutil.Error:
            return 0.0, 0.0
        cpu_s = times.user + times.system
        before_s, self._cpu_s = self._cpu_s, cpu_s
        cores = (cpu_s - before_s) / elapsed_s if before_s is not None and elapsed_s > 0.0 else 0.0
        return cores, memory / 1024.0**2


class _ProcessMeters:
    """Resource meters of all processes of a run."""

    def __init__(self, pids: Mapping[str, int], now_s: float) -> None:
        self._meters = {name: _ProcessMeter(pid) for name, pid in pids.items()}
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
async def monitor_processes(
    pids: Mapping[str, int], observers: ObserverEndpoint | None, progress: ProgressDisplay
) -> AsyncIterator[None]:
    """Publish the process load twice a second, while the block runs and an observer subscribes."""
    if observers is None:
        yield
        return
    teller = asyncio.create_task(_publish_loads(pids, observers, progress))
    try:
        yield
    finally:
        teller.cancel()


async def _publish_loads(
    pids: Mapping[str, int], observers: ObserverEndpoint, progress: ProgressDisplay
) -> None:
    loop = asyncio.get_running_loop()
    meters = _ProcessMeters(pids, loop.time())
    while True:
        await asyncio.sleep(_PUBLICATION_PERIOD_S)
        observers.publish_process_load(lambda: meters.read(progress.t_ns, loop.time()))
