"""Program: run a deployment in one process and print the functions that compiled while the run went on.

python tests/support/late_compilation.py deployments/two_link_arm.toml run.max_s=20
"""

import asyncio
import gc
import sys
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from skinnet.compilation import PACKAGES
from skinnet.protocol.channels import EXTERNAL, Keys
from skinnet.run.prepare import PreparedRun, RunOptions, prepare_run
from skinnet.run.process_list import process_list
from skinnet.runtime.loop import run_loop
from skinnet.runtime.worker import build_process
from skinnet.transport.in_memory import InMemoryHub


def late_functions(prepared: PreparedRun) -> list[str]:
    """Compiled functions of our packages that got a type, or another one, while the run went on."""
    deployment = prepared.deployment
    processes = [
        build_process(spec.module, deployment, spec.name, prepared.base, None)
        for spec in process_list(deployment)
    ]
    before = _numbers_of_types()
    hub = InMemoryHub(Keys(deployment.robot))
    hub.connect(EXTERNAL)

    async def run() -> None:
        async with asyncio.TaskGroup() as group:
            for process in processes:
                transport = hub.connect(process.name)
                group.create_task(run_loop(process, transport, Keys(deployment.robot), deadline_s=60.0))

    asyncio.run(run())
    for process in processes:
        process.result()
    return sorted(name for name, n in _numbers_of_types().items() if n > before.get(name, 0))


def _numbers_of_types() -> dict[str, int]:
    return {
        f"{each.py_func.__module__}.{each.py_func.__qualname__}": len(each.overloads)
        for each in gc.get_objects()
        if isinstance(each, Dispatcher) and each.py_func.__module__.startswith(PACKAGES)
    }


if __name__ == "__main__":
    found = late_functions(prepare_run(RunOptions(Path(sys.argv[1]), tuple(sys.argv[2:]))))
    sys.stdout.write("\n".join(found))
