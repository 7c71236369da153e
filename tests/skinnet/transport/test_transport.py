"""One contract for every transport: what is put arrives once, in the order of its sender, where it should."""

import asyncio
import queue
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from transports import KEYS, LONG_S, Star, key

from skinnet.errors import PortInUseError, SkinnetError, UnreachableError
from skinnet.transport.in_memory import InMemoryHub
from skinnet.transport.interface import Delivery, PublicSession, Query, Reply
from skinnet.transport.loop_transport import LoopTransport
from skinnet.transport.mailbox import TaskMailbox, ThreadMailbox
from skinnet.transport.queries import query
from skinnet.transport.zenoh_loop import join_loop, listen_for_loop
from skinnet.transport.zenoh_session import ZenohSession


async def hear(transport: LoopTransport, n: int) -> list[Delivery]:
    """Deliveries until there are `n`."""
    heard: list[Delivery] = []
    while len(heard) < n:
        batch = await transport.receive(LONG_S, n - len(heard))
        assert batch, f"only {heard}"
        heard += batch
    return heard


async def test_a_recorder_hears_all_that_is_recorded_in_the_order_of_each_sender(star: Star) -> None:
    """Whoever else receives it; of the others it hears nothing, and of what is left over when it is told."""
    body, other, recorder = await star.gather("body", "other", "recorder")
    recorder.subscribe([KEYS.of("config", "p", "*"), KEYS.of("command"), KEYS.of("state")], ["body"])
    other.subscribe([KEYS.of("command")], ["body"])
    await star.agree("listening")
    body.enable_recording(7)
    sent = []
    for number in range(60):
        put = [KEYS.of("config", "p", number), KEYS.of("state"), KEYS.of("command")][number % 3]
        sent.append((put, str(number).encode()))
        body.put(*sent[-1])
        body.put(KEYS.of("pressures"), b"not for a record")
        if number % 3 == 2:
            body.flush()
    assert [tuple(one) for one in await hear(other, 20)] == sent[2::3], "others need not wait"
    body.flush(last=True)
    assert [tuple(one) for one in await hear(recorder, len(sent))] == sent


async def test_a_recorder_gets_fewer_periods_from_a_sender_that_is_slow(
    star: Star, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skinnet.transport.loop_transport._MAX_RECORDER_WAIT_S", 0.0)
    body, recorder = await star.gather("body", "recorder")
    recorder.subscribe([KEYS.of("command")], ["body"])
    await star.agree("listening")
    body.enable_recording(1000)
    body.put(KEYS.of("command"), b"go")
    body.flush()
    assert await hear(recorder, 1) == [Delivery(KEYS.of("command"), b"go")]


async def test_a_sender_knows_whether_it_is_heard(star: Star) -> None:
    body, watcher = await star.gather("body", "watcher")
    world = KEYS.of("free_bodies")
    assert not body.has_subscribers(world)
    heard: queue.Queue[tuple[str, bytes]] = queue.Queue()
    undo = watcher.declare_loop_subscriber(world, lambda *message: heard.put(message))
    await star.agree("overhearing")
    until_it_is(body, world, True)
    body.put(world, b"where")
    body.flush()
    assert heard.get(timeout=LONG_S) == (world, b"where")
    undo()
    until_it_is(body, world, False)


def until_it_is(member: LoopTransport, asked: str, wanted: bool) -> None:
    """Returns when `member` is heard, or is not: the news may take its time, and another thread."""
    deadline_s = time.monotonic() + LONG_S
    while member.has_subscribers(asked) != wanted:
        assert time.monotonic() < deadline_s


async def test_messages_of_a_sender_arrive_once_and_in_order(star: Star) -> None:
    """Among those for the same receivers: what is for the controller may overtake what is for the cells."""
    members = await star.gather("hub", "a", "b")
    n_periods, n_words = 50, 3
    for t in range(n_periods):
        for name, member in star.members.items():
            for i in range(n_words):
                member.put(key(f"{name}{i}"), f"{t}".encode())
                member.put(KEYS.of("stimulus", f"{name}{i}"), f"{t}".encode())
            member.flush()
    for member in members:
        heard = await hear(member, 2 * 3 * n_words * n_periods)
        assert len(heard) == 2 * 3 * n_words * n_periods
        for name in star.members:
            for kind in ("period_end", "stimulus"):
                keys = [KEYS.of(kind, f"{name}{i}") for i in range(n_words)]
                said = [delivery for delivery in heard if delivery.key in keys]
                assert said == [Delivery(k, f"{t}".encode()) for t in range(n_periods) for k in keys]


async def test_any_bytes_travel_unchanged(star: Star) -> None:
    hub, a = await star.gather("hub", "a")
    payloads = [b"x", bytes(range(256)), b"\x00" * 200_000, b"\x00" * 200_000, b"end"]
    for payload in payloads:
        hub.put(key("twice"), payload)  # it matches two expressions
        hub.flush()
    assert [delivery.payload for delivery in await hear(a, len(payloads))] == payloads


async def test_expressions_choose_messages_and_names_choose_senders(star: Star) -> None:
    senders = await star.gather("hub", "a", "b")
    picky = star.join("picky")
    picky.subscribe([KEYS.of("events", "*", "1"), KEYS.of("topology", "*")], ["hub", "b"])
    deaf = star.join("deaf")
    deaf.subscribe([KEYS.of("events", "*", "*"), KEYS.of("topology", "*")], [])
    keys = [
        KEYS.of("events", "p", "1"),
        KEYS.of("events", "p", "2"),
        KEYS.of("bundle", "p"),
        KEYS.of("stream", "1"),
    ]
    wanted = [keys[0], KEYS.of("topology", "p")]
    for member in (picky, deaf):
        member.subscribe([key("*")], [*star.members])
        member.subscribe_liveliness(KEYS.liveliness("*", "*"))
    for member in senders:
        member.subscribe([key("*")], ["picky", "deaf"])
    await star.agree("listen")
    for name, member in zip(star.members, senders, strict=False):
        for one in (*keys, wanted[1]):
            member.put(one, name.encode())
        member.flush()
    heard = await star.agree("heard")
    assert sorted(heard["picky"]) == sorted(Delivery(one, name) for one in wanted for name in (b"hub", b"b"))
    assert heard["deaf"] == []


async def test_what_is_put_is_overheard_and_what_is_told_is_tapped(star: Star) -> None:
    hub, a = await star.gather("hub", "a")
    overheard: list[Delivery] = []
    tapped: list[Delivery] = []
    came = threading.Semaphore(0)

    def note(into: list[Delivery]) -> Callable[[str, bytes], None]:
        def on_message(key: str, payload: bytes) -> None:
            into.append(Delivery(key, payload))
            came.release()

        return on_message

    undo = (
        hub.declare_loop_subscriber(key("p"), note(overheard)),
        hub.session.declare_subscriber(key("p"), note(tapped)),
    )
    for step in ("listen", "go on"):
        await star.agree(step)
        for _ in range(2):
            a.session.put(key("p"), b"told")
            a.put(key("p"), b"put")
        a.flush()
        heard = await star.agree(f"after {step}")
        for name in ("hub", "a"):  # whoever is in the loop hears nothing of what is told beside it
            assert [delivery.payload for delivery in heard[name]] == [b"put", b"put"]
        if step == "listen":
            for _ in range(4):
                assert came.acquire(timeout=LONG_S)
            for stop in undo:
                stop()
    assert overheard == [Delivery(key("p"), b"put")] * 2
    assert tapped == [Delivery(key("p"), b"told")] * 2


async def test_liveliness_tells_who_was_there_who_comes_and_who_goes(star: Star) -> None:
    hub = star.join("hub")
    hub.session.declare_token(KEYS.liveliness("body", "hub"))
    a = star.join("a")
    a.subscribe_liveliness(KEYS.liveliness("*", "*"))
    assert await hear(a, 1) == [Delivery(KEYS.liveliness("body", "hub"), b"")]
    hub.subscribe_liveliness(KEYS.liveliness("cells", "*"))
    a.session.declare_token(KEYS.liveliness("cells", "a"))
    assert await hear(hub, 1) == [Delivery(KEYS.liveliness("cells", "a"), b"")]
    assert await hear(a, 1) == [Delivery(KEYS.liveliness("cells", "a"), b"")]
    star.leave("a")
    assert await hear(hub, 1) == [Delivery(KEYS.liveliness("cells", "a"), None)]


async def test_who_is_there_can_be_asked_and_is_told(star: Star) -> None:
    """By the hub and by its members, of tokens that were there, that come, and that go."""
    hub, a = await star.gather("hub", "a")
    changes: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
    tokens = {name: KEYS.name_claim("one", name) for name in ("hub", "a", "b")}
    hub.session.declare_token(tokens["hub"])
    a.session.declare_token(tokens["a"])
    await star.agree("claimed")
    for member in (hub, a):
        assert member.session.liveliness_tokens(KEYS.name_claim("one", "*")) == {tokens["hub"], tokens["a"]}
        assert member.session.liveliness_tokens(tokens["a"]) == {tokens["a"]}
        assert member.session.liveliness_tokens(KEYS.name_claim("other", "*")) == frozenset()
    hub.session.declare_liveliness_subscriber(
        KEYS.name_claim("one", "*"), lambda key, there: changes.put((key, there))
    )
    assert {changes.get(timeout=LONG_S) for _ in range(2)} == {(tokens["hub"], True), (tokens["a"], True)}
    star.join("b").session.declare_token(tokens["b"])
    assert changes.get(timeout=LONG_S) == (tokens["b"], True)
    star.leave("b")
    assert changes.get(timeout=LONG_S) == (tokens["b"], False)
    assert hub.session.liveliness_tokens(KEYS.name_claim("one", "*")) == {tokens["hub"], tokens["a"]}


async def test_what_is_undeclared_is_gone_and_may_be_undeclared_again(star: Star) -> None:
    hub, a = await star.gather("hub", "a")
    changes: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
    first, second = KEYS.name_claim("one", "a"), KEYS.name_claim("two", "a")
    watched = KEYS.prefix + "claim/**"
    stop = hub.session.declare_liveliness_subscriber(watched, lambda key, there: changes.put((key, there)))
    withdraw = a.session.declare_token(first)
    assert changes.get(timeout=LONG_S) == (first, True)
    for _ in range(2):
        withdraw()
    assert changes.get(timeout=LONG_S) == (first, False)
    assert hub.session.liveliness_tokens(watched) == frozenset()
    for _ in range(2):
        stop()
    a.session.declare_token(second)
    await star.agree("claimed")
    assert changes.empty()
    assert hub.session.liveliness_tokens(watched) == {second}


def test_a_session_in_memory_has_the_interface_and_nothing_else() -> None:
    def public(of: object) -> set[str]:
        return {name for name in dir(of) if not name.startswith("_")}

    assert public(InMemoryHub(KEYS).connect("a").session) == public(PublicSession)
    assert public(ZenohSession) > public(PublicSession)


async def test_more_tokens_than_zenohs_own_handler_takes(star: Star) -> None:
    hub, a = await star.gather("hub", "a")
    for number in range(300):
        hub.session.declare_token(KEYS.name_claim("one", str(number)))
    await star.agree("claimed")
    assert len(a.session.liveliness_tokens(KEYS.name_claim("one", "*"))) == 300


async def test_last_words_arrive(star: Star) -> None:
    hub, a = await star.gather("hub", "a")
    a.put(key("last"), b"words")
    star.leave("a")
    words = {Delivery(key("last"), b"words"), Delivery(KEYS.liveliness("here", "a"), None)}
    assert set(await hear(hub, 2)) == words


async def test_who_waits_in_vain_gets_nothing(star: Star) -> None:
    hub = star.join("hub")
    assert await hub.receive(0.0) == []
    assert await hub.receive(0.01, 3) == []


async def test_too_few_are_handed_out_when_time_is_over(star: Star) -> None:
    (hub,) = await star.gather("hub")
    hub.put(key("one"), b"1")
    hub.flush()
    assert await hear(hub, 1) == [Delivery(key("one"), b"1")]
    hub.put(key("two"), b"2")
    hub.flush()
    heard: list[Delivery] = []
    while not heard:  # by Zenoh it comes through another thread
        heard = await hub.receive(0.001, 5)
    assert heard == [Delivery(key("two"), b"2")]


Mailbox = TaskMailbox | ThreadMailbox
WORD, LOSS = Delivery("k", b"word"), Delivery("k", None)


@pytest.fixture(params=[TaskMailbox, ThreadMailbox])
def mailbox(request: pytest.FixtureRequest) -> Mailbox:
    box: Mailbox = request.param()
    return box


async def test_a_loss_is_always_enough(mailbox: Mailbox) -> None:
    mailbox.post(WORD)
    mailbox.post(LOSS)
    assert await mailbox.receive(None, min_count=5) == [WORD, LOSS]
    for _ in range(2):
        mailbox.post(WORD)
    assert await mailbox.receive(0.0, min_count=5) == [
        WORD,
        WORD,
    ]  # that loss is told, and is no reason any more
    assert await mailbox.receive(0.0) == []


async def test_who_needs_several_is_woken_once() -> None:
    mailbox = TaskMailbox()
    waiting = asyncio.create_task(mailbox.receive(None, min_count=3))
    for n in range(3):
        await asyncio.sleep(0)
        assert not waiting.done(), n
        mailbox.post(WORD)
    assert await waiting == [WORD] * 3
    waiting = asyncio.create_task(mailbox.receive(None, min_count=3))
    await asyncio.sleep(0)
    mailbox.post(LOSS)
    assert await waiting == [LOSS]


@pytest.mark.parametrize("enough", [1, 2, 7])
def test_no_thread_loses_a_message_or_a_wake_up(enough: int) -> None:
    n_threads, n = 4, 700
    mailbox = ThreadMailbox()

    def post(name: str) -> None:
        for i in range(n):
            mailbox.post(Delivery(name, str(i).encode()))

    async def collect() -> list[Delivery]:
        heard: list[Delivery] = []
        while left := n_threads * n - len(heard):
            batch = await mailbox.receive(None, min(enough, left))  # without an alarm: it must be woken
            assert len(batch) >= min(enough, left)
            heard += batch
        return heard

    with ThreadPoolExecutor(n_threads) as pool:
        posts = [pool.submit(post, name) for name in "abcd"]
        heard = asyncio.run(collect())
        for done in posts:
            done.result()
    for name in "abcd":
        assert [d.payload for d in heard if d.key == name] == [str(i).encode() for i in range(n)]


async def test_what_another_thread_posts_wakes_the_reader() -> None:
    """A task that waits without an alarm, in a loop where nothing else happens."""
    mailbox = TaskMailbox()
    n = 200

    def post() -> None:
        for i in range(n):
            mailbox.post(Delivery("k", str(i).encode()))

    heard = []
    assert await mailbox.receive(0.0) == []  # now it knows its loop
    thread = threading.Thread(target=post)
    thread.start()
    while len(heard) < n:
        heard += await mailbox.receive(None)
    thread.join()
    assert heard == [Delivery("k", str(i).encode()) for i in range(n)]


def test_an_endpoint_that_is_none_is_named() -> None:
    with pytest.raises(SkinnetError, match="cannot listen on nonsense"):
        ZenohSession.open_hub("nonsense")
    with pytest.raises(UnreachableError, match="nonsense: no Zenoh endpoint"):
        query("nonsense", "a", b"", LONG_S)


def test_an_endpoint_where_nobody_is(endpoint: str) -> None:
    with pytest.raises(UnreachableError, match=f"{endpoint}: .*nobody answers"):
        query(endpoint, "a", b"", 0.01)


def test_questions_are_answered_when_the_answer_is_known(endpoint: str) -> None:
    """Out of their order, by another thread than asked, with payloads, errors, or by others."""
    hub = ZenohSession.open_hub(endpoint)
    asked: dict[bytes, Query] = {}
    all_there = threading.Semaphore(0)
    go = KEYS.of("request", "go")

    def keep(query: Query) -> None:
        asked[query.payload] = query
        all_there.release()

    questions = {
        b"1": f"{go}?argument=home",
        b"2": "skinnet/*/controller/request/go",
        b"3": go,
        b"": go,
        b"4": "skinnet/**",
    }
    try:
        hub.declare_queryable(KEYS.of("request", "*"), keep)
        with ThreadPoolExecutor(len(questions)) as pool:
            replies = {
                payload: pool.submit(query, endpoint, key, payload, LONG_S)
                for payload, key in questions.items()
            }
            for _ in questions:
                assert all_there.acquire(timeout=LONG_S)
            assert {payload: query.key for payload, query in asked.items()} == {
                payload: key.partition("?")[0] for payload, key in questions.items()
            }
            assert asked[b"1"].parameters == {"argument": "home"}
            assert asked[b"2"].parameters == {}
            for payload in (b"3", b"1", b"2"):
                asked[payload].reply(go, b"answer " + payload)
                assert replies[payload].result(LONG_S) == [Reply(go, b"answer " + payload, "")]
            asked[b""].reply_error("not today")
            assert replies[b""].result(LONG_S) == [Reply("", b"", "not today")]
            asked[b"4"].drop()
            assert replies[b"4"].result(LONG_S) == []
        asked.clear()
        assert query(endpoint, go, b"late", 0.05) == [Reply("", b"", "no reply within 0.05 s")]
        asked[b"late"].reply(go, b"nobody hears it")
        assert query(endpoint, KEYS.of("state"), b"", LONG_S) == []
    finally:
        hub.close()


def test_a_taken_port_is_named() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        taken = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        with pytest.raises(PortInUseError, match=taken):
            ZenohSession.open_hub(taken)


async def test_an_envelope_that_cannot_be_opened_is_counted(endpoint: str) -> None:
    hub = listen_for_loop(KEYS, "hub", endpoint)
    try:
        hub.subscribe([key("*")], ["hub"])
        hub.session.put(f"{KEYS.prefix}loop/hub/controller", b"no envelope")
        hub.put(key("x"), b"1")
        hub.flush()
        assert await hear(hub, 1) == [Delivery(key("x"), b"1")]
        assert hub.statistics.malformed_batches == 1
    finally:
        hub.close()


async def test_every_envelope_is_weighed_and_timed(endpoint: str) -> None:
    hub = listen_for_loop(KEYS, "hub", endpoint)
    a = join_loop(KEYS, "a", endpoint)
    try:
        hub.subscribe([key("*")], ["a"])
        hub.session.declare_token(KEYS.liveliness("here", "hub"))
        a.subscribe_liveliness(KEYS.liveliness("*", "*"))  # its coming follows the hub's subscription
        assert await hear(a, 1) == [Delivery(KEYS.liveliness("here", "hub"), b"")]
        for n in range(1, 6):
            for i in range(n):
                a.put(key(f"x{i}"), bytes(n))
            a.flush()
        await hear(hub, 15)
        assert hub.statistics.transit_histogram.sum() == 5
        assert hub.statistics.received_bytes == a.statistics.sent_bytes > sum(n * n for n in range(1, 6))
        assert hub.statistics.malformed_batches == a.statistics.received_bytes == 0
    finally:
        a.close()
        hub.close()
