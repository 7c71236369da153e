"""Transports under one contract: in memory, and Zenoh in a star."""

from skinnet.protocol.channels import Keys
from skinnet.transport.in_memory import InMemoryHub
from skinnet.transport.interface import Delivery
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.zenoh_loop import join_loop, listen_for_loop

KEYS = Keys("bot")


LONG_S = 30.0
"""Nobody ever waits as long, unless something is lost."""


class Star:
    """A hub and whoever joins it, all of one kind."""

    def __init__(self, kind: str, endpoint: str) -> None:
        self._kind, self._endpoint = kind, endpoint
        self._memory = InMemoryHub(KEYS)
        self.members: dict[str, LoopTransport] = {}

    def join(self, name: str) -> LoopTransport:
        member: LoopTransport
        if self._kind == "memory":
            member = self._memory.connect(name)
        elif not self.members:
            member = listen_for_loop(KEYS, name, self._endpoint)
        else:
            member = join_loop(KEYS, name, self._endpoint)
        member.enable_recording(1)
        self.members[name] = member
        return member

    async def gather(self, *names: str) -> list[LoopTransport]:
        """Members that hear all that each of them puts; as in a run, subscriptions come before the token."""
        for name in names:
            member = self.join(name)
            member.subscribe([key("*"), key("twice"), KEYS.of("stimulus", "*")], names)
            member.subscribe_liveliness(KEYS.liveliness("*", "*"))
        await self.agree("here")
        return [self.members[name] for name in names]

    async def agree(self, step: str) -> dict[str, list[Delivery]]:
        """Everybody knows what each has declared and has heard what each has put before; returns that."""
        for name, member in self.members.items():
            member.session.declare_token(KEYS.liveliness(step, name))
        tokens = {KEYS.liveliness(step, name) for name in self.members}
        heard = {name: await self._until(name, tokens) for name in self.members}
        for name, member in self.members.items():
            member.put(key(f"{step}-{name}"), b"word")
            member.flush()
        words = {key(f"{step}-{name}") for name in self.members}
        return {name: heard[name] + await self._until(name, words) for name in self.members}

    async def _until(self, name: str, wanted: set[str]) -> list[Delivery]:
        left = set(wanted)
        others: list[Delivery] = []
        while left:
            batch = await self.members[name].receive(LONG_S, len(left))
            assert batch, f"{name} misses {left}"
            others += [delivery for delivery in batch if delivery.key not in left]
            left -= {delivery.key for delivery in batch}
        return others

    def leave(self, name: str) -> None:
        self.members.pop(name).close()


def key(word: str) -> str:
    """A key that every member of `Star.gather` hears."""
    return KEYS.of("period_end", word)
