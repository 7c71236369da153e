"""The process shell around a node: arguments, transport, loop, orderly end, result.

Exit codes: 0 finished, 1 failed with a clear line on standard error, 3 told to stop by the launcher.
A worker ends when its standard input closes: so a launcher that is killed leaves no orphans.
"""

import argparse
import asyncio
import gc
import importlib
import logging
import resource
import signal
import sys
import time
from pathlib import Path
from typing import Protocol

import msgspec

from skinnet.channels import Keys
from skinnet.deployment import Deployment
from skinnet.errors import SkinnetError
from skinnet.loop import Node, run_loop
from skinnet.part import Part
from skinnet.transport.zenoh import ZenohTransport

__all__ = ["STOPPED", "NodeModule", "build_node", "main", "part_of"]

STOPPED = 3
_LINGER_S = 5.0
log = logging.getLogger(__name__)


class NodeModule(Protocol):
    """A package that can be a process: `python -m <package>`."""

    def build(self, deployment: Deployment, name: str, base: Path) -> Node:
        """The node `name` of `deployment`, compiled and ready; `base` is the deployment's folder."""


def build_node(module: str, deployment: Deployment, name: str, base: Path) -> Node:
    """Imports `<module>.process` and builds its node."""
    process: NodeModule = importlib.import_module(f"{module}.process")
    return process.build(deployment, name, base)


def _arguments(module: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description="One process of a skinnet run.")
    parser.add_argument("--deployment", type=Path, required=True, help="resolved deployment, JSON")
    parser.add_argument("--base", type=Path, required=True, help="folder that relative paths start from")
    parser.add_argument("--name", required=True, help="name of this process in the deployment")
    parser.add_argument("--parts", type=Path, required=True, help="folder for the result")
    end = parser.add_mutually_exclusive_group(required=True)
    end.add_argument("--listen", help="Zenoh endpoint: be the hub")
    end.add_argument("--connect", help="Zenoh endpoint of the hub")
    return parser.parse_args()


def main(module: str) -> int:
    """Runs one process to its end and returns its exit code."""
    args = _arguments(module)
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format=f"{args.name}: %(levelname)s %(message)s"
    )
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the launcher, who ends us in order
    try:
        return asyncio.run(_run(module, args))
    except SkinnetError as error:
        log.error("%s", error)
        return 1


async def _run(module: str, args: argparse.Namespace) -> int:
    deployment = msgspec.json.decode(args.deployment.read_bytes(), type=Deployment)
    task = asyncio.current_task()
    assert task is not None
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, task.cancel)
    loop.add_reader(sys.stdin.fileno(), task.cancel)  # only its end makes it readable
    transport = ZenohTransport(listen=args.listen, connect=args.connect)
    keys = Keys(deployment.robot)
    try:
        node = build_node(module, deployment, args.name, args.base)
        gc.freeze()
        present = await run_loop(
            node,
            transport,
            keys,
            deadline_s=deployment.run.deadline_s,
            realtime=deployment.run.pace == "realtime",
        )
        part_of(node).save(args.parts)
        if args.listen:
            await _outlast(transport, present & node.peers)
    except asyncio.CancelledError:
        return STOPPED
    finally:
        transport.close()
    return 0


async def _outlast(transport: ZenohTransport, there: set[str]) -> None:
    """The hub relays for the others, so it leaves last; their tokens tell when."""
    deadline_s = time.monotonic() + _LINGER_S
    while there and time.monotonic() < deadline_s:
        for key, payload in await transport.receive(0.1):
            if payload is None:
                there.discard(key.rsplit("/", 1)[-1])


def part_of(node: Node) -> Part:
    """The node's result with what the operating system says of its process."""
    part = node.result()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    part.facts["cpu_s"] = usage.ru_utime + usage.ru_stime
    part.facts["peak_mb"] = usage.ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
    part.facts["counters"] = dict(sorted(node.counters.items()))
    return part
