"""The desk between users and controller: whoever asks is answered once and in time, and few wait."""

import queue
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from typer.testing import CliRunner

from skinnet.cli.main import app
from skinnet.errors import UnreachableError
from skinnet.protocol.channels import EXTERNAL, Keys, Role
from skinnet.protocol.messages import Answer, ControllerState, Request, decode, encode
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.observers.request_server import MAX_PENDING, TIMEOUT_S, RequestServer, RequestWorker
from skinnet.transport import queries as client
from skinnet.transport.in_memory import InMemoryHub
from skinnet.transport.interface import Delivery, Reply
from skinnet.transport.loop_transport import LoopTransport

KEYS = Keys("bot")
LONG_S = 30.0
"""Nobody ever waits as long, unless something is lost."""


class Asked:
    """A query, and all that was said to whoever asked."""

    def __init__(
        self, what: str = "go", payload: bytes = b"", parameters: Mapping[str, str] | None = None
    ) -> None:
        self.key = KEYS.of("request", what)
        self.payload, self.parameters = payload, parameters or {}
        self.said: list[Answer | str] = []
        self.came: queue.SimpleQueue[Answer | str] = queue.SimpleQueue()

    def reply(self, key: str, payload: bytes) -> None:
        assert key.startswith(KEYS.of("request", ""))
        self._hear(decode(payload, Answer))

    def reply_error(self, reason: str) -> None:
        self._hear(reason)

    def drop(self) -> None:
        self._hear("")

    def _hear(self, word: Answer | str) -> None:
        self.said.append(word)
        self.came.put(word)


class Loop:
    """Where the desk hands requests in."""

    def __init__(self) -> None:
        self.requests: list[tuple[str, Request]] = []

    def __call__(self, key: str, payload: bytes) -> None:
        row, (what,) = KEYS.parse(key)
        assert row.name == "request"
        self.requests.append((what, decode(payload, Request)))


def answer_to(number: int) -> bytes:
    return encode(Answer(id=number, t_ns=5, accepted=True, state="up"))


@pytest.fixture
def loop() -> Loop:
    return Loop()


@pytest.fixture
def desk(loop: Loop) -> RequestServer:
    desk = RequestServer(KEYS, loop)
    desk.enable()
    return desk


@pytest.mark.parametrize(
    ("query", "argument"),
    [
        (Asked(), ""),
        (Asked(payload=b"force"), "force"),
        (Asked(payload="größer".encode()), "größer"),
        (Asked(parameters={"argument": "force"}), "force"),
        (Asked(parameters={"argument": "force", "_time": "now"}), "force"),
        (Asked(payload=bytes(256)), "\0" * 256),
    ],
)
def test_a_query_becomes_a_request_and_its_answer_returns(
    desk: RequestServer, loop: Loop, query: Asked, argument: str
) -> None:
    desk.handle_query(query, 0.0)
    ((what, request),) = loop.requests
    assert (what, request.argument) == ("go", argument)
    assert query.said == []
    desk.handle_answer(answer_to(request.id + 1))  # nobody's
    desk.handle_answer(b"\xc1")
    assert query.said == []
    for _ in range(2):
        desk.handle_answer(answer_to(request.id))
    assert query.said == [Answer(id=request.id, t_ns=5, accepted=True, state="up")]
    assert desk.counters == {"requests": 1}


@pytest.mark.parametrize(
    ("query", "why"),
    [
        (Asked("go!"), "'go!' is no name"),
        (Asked("x" * 65), "is no name"),
        (Asked(payload=b"\xff\xfe"), "go: the argument is no UTF-8 text"),
        (Asked(payload=bytes(257)), "257 bytes; at most 256"),
        (Asked(parameters={"argument": "ü" * 129}), "258 bytes; at most 256"),
        (Asked(parameters={"arg": "force"}), "unknown parameter 'arg'; there is only argument"),
        (Asked(payload=b"force", parameters={"argument": "off"}), "payload or as parameter, not as both"),
    ],
)
def test_a_question_that_makes_no_sense_is_refused_at_once(
    desk: RequestServer, loop: Loop, query: Asked, why: str
) -> None:
    desk.handle_query(query, 0.0)
    assert loop.requests == []
    (said,) = query.said
    assert isinstance(said, str)
    assert why in said
    assert "\n" not in said
    assert desk.counters == {"refused_requests": 1}


@pytest.mark.parametrize("what", ["*", "**", "g*"])
def test_who_asks_for_everything_there_is_has_asked_for_nothing(
    desk: RequestServer, loop: Loop, what: str
) -> None:
    query = Asked(what)
    desk.handle_query(query, 0.0)
    assert query.said == [""]
    assert not loop.requests
    assert not desk.counters


def test_without_a_controller_nobody_waits(loop: Loop) -> None:
    desk = RequestServer(KEYS, loop)
    early, during, late = Asked(), Asked(), Asked()
    desk.handle_query(early, 0.0)
    assert early.said == ["the controller is not running yet; repeat the request after the start of the run"]
    desk.enable()
    desk.handle_query(during, 1.0)
    desk.disable("the controller is gone", 2.0)
    assert during.said == []  # its last words may be on their way
    due_s = desk.next_timeout_s()
    assert due_s is not None
    assert 2.0 < due_s < 3.0
    desk.enable()  # so may be an old state
    desk.handle_query(late, 2.1)
    desk.expire_queries(due_s)
    assert late.said == ["the controller is gone"]
    assert during.said == ["no answer: the controller is gone"]
    assert len(loop.requests) == 1


def test_a_flood_is_refused_and_counted(desk: RequestServer, loop: Loop) -> None:
    flood = [Asked() for _ in range(1000)]
    for query in flood:
        desk.handle_query(query, 0.0)
    assert len(loop.requests) == MAX_PENDING
    refused = [query for query in flood if query.said]
    assert refused == flood[MAX_PENDING:]
    assert {why for query in refused for why in query.said} == {
        f"{MAX_PENDING} requests wait for their answers already; ask again later"
    }
    for _, request in loop.requests:
        desk.handle_answer(answer_to(request.id))
    assert all(len(query.said) == 1 for query in flood)
    desk.handle_query(again := Asked(), 1.0)
    assert again.said == []
    assert desk.counters == {"requests": MAX_PENDING + 1, "refused_requests": 1000 - MAX_PENDING}


class AnyOrder(RuleBasedStateMachine):
    """Queries, answers and time in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = Loop()
        self.desk = RequestServer(KEYS, self.loop)
        self.desk.enable()
        self.now_s = 0.0
        self.asked: dict[int, tuple[Asked, float]] = {}
        self.all: list[Asked] = []

    @rule(sense=st.booleans())
    def ask(self, sense: bool) -> None:
        query = Asked("go" if sense else "go!")
        before = len(self.loop.requests)
        self.desk.handle_query(query, self.now_s)
        self.all.append(query)
        if len(self.loop.requests) > before:
            self.asked[self.loop.requests[-1][1].id] = query, self.now_s
        else:
            assert len(query.said) == 1

    @precondition(lambda self: self.asked)
    @rule(data=st.data())
    def answer(self, data: st.DataObject) -> None:
        number = data.draw(st.sampled_from(sorted(self.asked)))
        open_before = not self.asked[number][0].said
        self.desk.handle_answer(answer_to(number))
        assert isinstance(self.asked[number][0].said[0], Answer) or not open_before

    @rule(later_s=st.floats(0.0, 3.0))
    def wait(self, later_s: float) -> None:
        self.now_s += later_s
        self.desk.expire_queries(self.now_s)

    @invariant()
    def nobody_is_answered_twice_or_waits_too_long(self) -> None:
        assert all(len(query.said) <= 1 for query in self.all)
        waiting = [since_s for query, since_s in self.asked.values() if not query.said]
        assert len(waiting) <= MAX_PENDING
        assert all(since_s + TIMEOUT_S > self.now_s for since_s in waiting)
        due_s = self.desk.next_timeout_s()
        assert due_s == (min(waiting) + TIMEOUT_S if waiting else None)

    def teardown(self) -> None:
        self.desk.disable("the run has ended", self.now_s, grace_s=0.0)
        assert all(len(query.said) == 1 for query in self.all)


TestAnyOrder = AnyOrder.TestCase


@pytest.fixture
def clerk(loop: Loop) -> Iterator[RequestWorker]:
    clerk = RequestWorker(RequestServer(KEYS, loop))
    yield clerk
    clerk.close()


def test_the_clerk_answers_gives_up_and_sends_away(
    clerk: RequestWorker, loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    clerk.enable()
    clerk.handle_query(asked := Asked())
    clerk.handle_answer(answer_to(1))
    assert asked.came.get(timeout=30.0) == Answer(id=1, t_ns=5, accepted=True, state="up")
    monkeypatch.setattr("skinnet.run.observers.request_server.TIMEOUT_S", 0.01)
    clerk.handle_query(in_vain := Asked())
    assert "no answer: nothing came within 0.01 s" in str(in_vain.came.get(timeout=30.0))
    monkeypatch.setattr("skinnet.run.observers.request_server.TIMEOUT_S", 1e6)
    clerk.handle_query(last := Asked())
    clerk.close()
    assert last.said == ["no answer: the run has ended"]
    assert [request.id for _, request in loop.requests] == [1, 2, 3]


@pytest.mark.parametrize("accepted", [True, False])
def test_the_command_line_says_what_was_answered(accepted: bool) -> None:
    hub = InMemoryHub(KEYS)
    controller = hub.connect("controller")

    def obey(key: str, payload: bytes) -> None:
        asked = decode(payload, Request)
        why = "" if accepted else f"no floor {asked.argument}"
        answer = Answer(id=asked.id, t_ns=1_500_000_000, accepted=accepted, state="lift.up", reason=why)
        controller.session.put(KEYS.of("answer"), encode(answer))

    controller.declare_loop_subscriber(KEYS.of("request", "go"), obey)
    with tempfile.TemporaryDirectory(prefix="skin") as folder:
        endpoint = f"unixsock-stream/{folder}/watch"
        watch = ObserverEndpoint(KEYS, endpoint)
        watch.attach(hub.connect(EXTERNAL))
        controller.session.put(
            KEYS.of("state"), encode(ControllerState(t_ns=0, stage="lift.up", progress=0.0))
        )
        done = CliRunner().invoke(app, ["request", endpoint, "go", "2"])
        watch.close()
    said = (
        "accepted; state lift.up at 1.500 s" if accepted else "refused: no floor 2; state lift.up at 1.500 s"
    )
    assert (done.exit_code, done.output) == (int(not accepted), f"{said}\n")


async def hear(transport: LoopTransport, n: int) -> list[Delivery]:
    """Deliveries until there are `n`."""
    heard: list[Delivery] = []
    while len(heard) < n:
        batch = await transport.receive(LONG_S, n - len(heard))
        assert batch, f"only {heard}"
        heard += batch
    return heard


async def test_the_way_of_a_request_through_the_watch_endpoint() -> None:
    """From a Zenoh client to the controller and back: before it runs, when it does, when it is gone."""
    hub = InMemoryHub(KEYS)
    controller = hub.connect("controller")
    controller.subscribe([KEYS.of("request", "*")], [EXTERNAL])
    state = encode(ControllerState(t_ns=0, stage="up", progress=0.0))
    with tempfile.TemporaryDirectory(prefix="skin") as folder, ThreadPoolExecutor(2) as pool:
        endpoint = f"unixsock-stream/{folder}/watch"
        watch = ObserverEndpoint(KEYS, endpoint)

        def query(what: str, argument: str = "") -> Future[list[Reply]]:
            return pool.submit(
                client.query, endpoint, f"skinnet/*/controller/{what}", argument.encode(), LONG_S
            )

        def error(why: str) -> list[Reply]:
            return [Reply("", b"", why)]

        not_yet = "the controller is not running yet; repeat the request after the start of the run"
        assert query("request/go").result() == error(not_yet)
        watch.attach(hub.connect(EXTERNAL))
        controller.session.declare_token(KEYS.liveliness(Role.CONTROLLER, "controller"))
        assert query("request/go").result() == error(not_yet)
        assert query("state").result() == []
        controller.session.put(KEYS.of("state"), state)
        assert query("state").result() == [Reply(KEYS.of("state"), state, "")]

        going, lost = query("request/go", "2"), query("request/stop")
        heard = {key: decode(payload, Request) for key, payload in await hear(controller, 2) if payload}
        go = heard[KEYS.of("request", "go")]
        assert go.argument == "2"
        controller.session.put(KEYS.of("answer"), answer_to(go.id))
        assert going.result() == [Reply(KEYS.of("request", "go"), answer_to(go.id), "")]

        controller.close()
        assert lost.result() == error("no answer: the controller is gone")
        assert query("request/go").result() == error("the controller is gone")
        watch.detach()
        assert query("request/go").result() == error("the run has ended")
        assert await controller.receive(0.0) == []
        watch.close()
        with pytest.raises(UnreachableError):
            client.query(endpoint, KEYS.of("request", "go"), b"", 0.01)
    assert watch.counters == {
        "copied_messages": 2,
        "requests": 2,
        "refused_requests": 4,
        "unanswered_requests": 1,
    }
