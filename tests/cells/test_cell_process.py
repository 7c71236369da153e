"""A cell host says what its cells have to say, whoever else lives with it, and obeys what makes sense."""

import logging
from collections.abc import Sequence
from typing import Any

import pytest
from hosted_cells import MS, Host
from small_robot import SHIPPED, patch, small

from cells.process import warm_up
from cells.sensing.transducers import phases_ns
from skinnet.deployment import load
from skinnet.errors import ProtocolError
from skinnet.protocol.messages import (
    STREAM_ROW,
    Config,
    Events,
    Message,
    PeriodEnd,
    Stimulus,
    Stream,
    Topology,
    decode,
    encode,
    unpack,
)
from skinnet.random_streams import stream_key


def together(deployment_settings: Sequence[str], hosts: str, n_periods: int) -> dict[str, Any]:
    """Logs by patch, summed counters and all messages by patch of the shipped skin, spread over `hosts`."""
    deployment = load(SHIPPED, (*deployment_settings, f"cell_processes={hosts}"))
    logs: dict[str, str] = {}
    said: dict[str, list[tuple[str, bytes]]] = {patch.name: [] for patch in deployment.patches}
    counters: dict[str, int] = {}
    for name in deployment.patches_by_process():
        host = Host(deployment, name).run(n_periods)
        logs |= host.facts["logs"]
        for key, payload in host.sent:
            said[host.keys.parse(key)[1][0]].append((key, payload))
        for kind, entry in host.facts["network"].items():
            for what, count in entry.items():
                counters[f"{kind}.{what}"] = counters.get(f"{kind}.{what}", 0) + count
    return {"logs": logs, "said": said, "counters": counters}


@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("network.aggregate_events=true", 'cells.encoding.kind="send_on_delta"', "network.jitter_us=20.0"),
        ('cells.encoding.kind="periodic"', "network.queue_packets=2", "network.bits_per_s=500000"),
    ],
    ids=["level crossing", "send on delta, aggregated", "periodic, crowded"],
)
def test_patches_say_the_same_whoever_lives_with_them(settings: tuple[str, ...]) -> None:
    """From power on: while one patch still forms its network, another is already talking."""
    alone = together(settings, '"per_patch"', 30)
    assert alone["counters"]["event.delivered"] + alone["counters"]["reading.delivered"] > 300
    assert bool(alone["counters"]["reading.queue_full"]) == ("periodic" in str(settings))
    for hosts in ("1", "3"):
        other = together(settings, hosts, 30)
        for name, messages in alone["said"].items():
            assert other["said"][name] == messages, name
        assert other["logs"] == alone["logs"]
        assert other["counters"] == alone["counters"]
    assert together((*settings, "seed=2"), "1", 30)["logs"] != alone["logs"]


@pytest.mark.parametrize("aggregate", [False, True])
def test_all_that_was_delivered_is_published_in_its_period(aggregate: bool) -> None:
    host = Host(small(cell_processes=1, network={"aggregate_events": aggregate}))
    for cell in range(6):
        host.send_config(Config(patch="arm", cell=cell, t_ns=40 * MS, stream=True))
    host.run(60)
    network = host.facts["network"]
    published = {"event": 0, "reading": 0}
    for name in ("arm", "hand"):
        seqs: list[int] = []
        closed_ns, waiting = 0, 0
        for key, payload in host.sent:
            row, fields = host.keys.parse(key)
            if fields[0] != name:
                continue
            message: Any = decode(payload, row.message)
            if isinstance(message, Events):
                n = len(message.cell)
                waiting += n
                published["event"] += n
                assert len(fields) == (1 if aggregate else 2)
                assert aggregate or set(message.cell) == {int(fields[1])}
                times_ns = message.t_delivered_ns
                seqs += message.seq
                assert all(a < b for a, b in zip(message.t_sampled_ns, times_ns, strict=True))
            elif isinstance(message, Topology):
                waiting += 1
                continue
            else:
                assert message.t_ns == closed_ns
                assert message.n_events == waiting
                waiting = 0
                times_ns = []
                if isinstance(message, Stream):
                    rows = unpack(message.rows, STREAM_ROW)
                    published["reading"] += len(rows)
                    times_ns = rows["t_delivered_ns"].tolist()
                    seqs += rows["seq"].tolist()
                closed_ns = message.watermark_ns
                begin_ns = message.t_ns
            if isinstance(message, Events):
                begin_ns = closed_ns
            assert times_ns == sorted(times_ns)
            assert all(begin_ns <= t_ns < begin_ns + host.period_ns for t_ns in times_ns)
        assert closed_ns == host.t_ns
        assert sorted(seqs) == list(range(len(seqs)))
    for kind, n in published.items():
        assert n == network[kind]["delivered"] > 50


def test_the_topology_is_told_once_when_the_network_is_formed() -> None:
    host = Host(small(cell_processes=1), quiet_ms=1000).run(20)
    found = host.published(Topology)
    assert {topology.patch for topology in found} == {"arm", "hand"}
    assert len(found) == 2
    assert host.facts["formed_ns"] == {topology.patch: topology.t_ns for topology in found}
    assert host.facts["unreachable_cells"] == 0
    assert {payload for _, payload in host.node.best_effort_messages()} == {
        encode(topology) for topology in found
    }
    assert not host.node.best_effort_messages()


def streamed(host: Host, patch: str = "arm") -> list[tuple[int, int]]:
    """(cell, time of the sample) of all full readings that were published."""
    rows = [unpack(m.rows, STREAM_ROW) for m in host.published(Stream) if m.patch == patch]
    return [
        (cell, t)
        for part in rows
        for cell, t in zip(part["cell"].tolist(), part["t_sampled_ns"], strict=True)
    ]


def test_a_configuration_holds_from_the_next_sample_on() -> None:
    deployment = small(cell_processes=1)
    host = Host(deployment, quiet_ms=1000).run(10)
    cell, on_ns, off_ns = 4, 60 * MS, 85 * MS
    host.send_config(Config(patch="arm", cell=cell, t_ns=on_ns, stream=True))
    host.send_config(Config(patch="arm", cell=cell, t_ns=off_ns, stream=False))
    host.run(20)
    phase_ns = int(phases_ns(deployment.seed, "arm", 6, host.period_ns)[cell])
    # it arrives in the period in which it leaves; the samples of that period are taken
    first, last = on_ns // host.period_ns + 1, off_ns // host.period_ns
    assert streamed(host) == [(cell, k * host.period_ns + phase_ns) for k in range(first, last + 1)]
    assert host.facts["network"]["config"]["delivered"] == 2
    assert not host.node.counters


def test_thresholds_and_encoding_of_one_cell() -> None:
    host = Host(small(cell_processes=1, cells={"proximity": {"noise": 0.0}}), quiet_ms=40).run(8)
    host.send_config(Config(patch="arm", cell=1, t_ns=32 * MS, levels={"force": [], "proximity": []}))
    host.send_config(Config(patch="arm", cell=2, t_ns=32 * MS, encoding="periodic"))
    host.run(40)
    events = [cell for message in host.published(Events) if message.patch == "arm" for cell in message.cell]
    assert set(events) == {0, 3, 4, 5}
    assert {cell for cell, _ in streamed(host)} == {2}


def test_a_setting_that_does_not_hold_is_refused_by_the_cell(caplog: pytest.LogCaptureFixture) -> None:
    calm, told = (Host(small(cell_processes=1)) for _ in range(2))
    with caplog.at_level(logging.WARNING, "cells.host"):
        for cell in range(3):
            told.send_config(
                Config(patch="arm", cell=cell, t_ns=40 * MS, levels={"force": [0.5, 0.1]}, stream=True)
            )
        told.run(30)
    assert told.node.counters == {"rejected_configs": 3}
    assert len(caplog.records) == 1  # once per source
    assert "arm/0" in caplog.records[0].getMessage()
    assert not streamed(told)
    assert told.facts["logs"] == calm.run(30).facts["logs"]


def test_strangers_configure_without_confusing_the_account() -> None:
    """Nobody announces their messages, so they count for nothing but themselves."""
    host = Host(small(cell_processes=1), quiet_ms=1000).run(10)
    host.send_config(Config(patch="hand", cell=1, stream=True))
    host.send_config(Config(patch="hand", cell=1, encoding="morse"))
    host.run(5)
    assert host.node.counters == {"external_configs": 2, "rejected_configs": 1}
    sampled = [t_ns for _, t_ns in streamed(host, "hand")]
    assert [t_ns // host.period_ns for t_ns in sampled] == [11, 12, 13, 14]
    assert host.node.upstreams["body"].n_missing == 0


def test_the_host_waits_for_configurations_that_were_announced() -> None:
    host = Host(small(cell_processes=1))
    host.n_announced = 1
    host.feel(host.period_ns)
    assert not host.ready
    host.node.accept("config", ("arm", "0"), encode(Config(patch="arm", cell=0, stream=True)))
    assert not host.ready  # a stranger's is not the one
    host.node.accept("config", ("arm", "0"), encode(Config(patch="arm", cell=0, t_ns=1, stream=True)))
    assert host.ready


@pytest.mark.parametrize(
    ("channel", "fields", "message", "said"),
    [
        ("config", ("arm", "6"), Config(patch="arm", cell=6), "cells 0 to 5"),
        ("config", ("arm", "-1"), Config(patch="arm", cell=-1), "cells 0 to 5"),
        ("config", ("leg", "0"), Config(patch="leg", cell=0), "leg/0"),
        ("config", ("arm", "1"), Config(patch="arm", cell=2), "published on the key of arm/1"),
        ("config", ("hand", "0"), Config(patch="arm", cell=0), "published on the key of hand/0"),
        ("config", ("arm", "0"), PeriodEnd(patch="arm", t_ns=0, watermark_ns=0, n_events=0), "Config"),
        (
            "stimulus",
            ("cells0",),
            Stimulus(process="cells0", t_ns=0, watermark_ns=9, values=bytes(32)),
            "1 cells",
        ),
        (
            "stimulus",
            ("cells0",),
            Stimulus(process="cells0", t_ns=0, watermark_ns=9, values=bytes(33)),
            "33 bytes",
        ),
        ("joints", (), PeriodEnd(patch="arm", t_ns=0, watermark_ns=0, n_events=0), "joints"),
    ],
)
def test_what_makes_no_sense_changes_nothing(
    channel: str, fields: tuple[str, ...], message: Message, said: str
) -> None:
    calm, told = (Host(small(cell_processes=1)) for _ in range(2))
    with pytest.raises(ProtocolError, match=said):
        told.node.accept(channel, fields, encode(message))
    assert told.run(15).facts == calm.run(15).facts
    assert told.sent == calm.sent


def test_a_host_ends_where_the_body_says() -> None:
    deployment = small(cell_processes=1, run={"max_s": 1.0})
    host = Host(deployment).run(3)
    host.feel(16 * MS, end_ns=20 * MS)
    host.node.step(host.put)
    assert host.node.needs() == {"body": 20 * MS}
    host.feel(20 * MS, end_ns=20 * MS)
    host.node.step(host.put)
    assert host.node.needs() is None
    whole = Host(deployment).run(250)
    assert whole.node.needs() is None


def test_noise_belongs_to_the_cell() -> None:
    """One more patch, or other cells on the host, do not shift what a cell draws."""
    assert stream_key(1, "arm", 0, "noise") != stream_key(1, "hand", 0, "noise")
    one = Host(small(patch("hand", 2, 1), cell_processes=1)).run(20)
    more = Host(small(patch("arm"), patch("hand", 2, 1), patch("leg"), cell_processes=1)).run(20)
    assert one.facts["logs"]["hand"] == more.facts["logs"]["hand"]
    assert len(one.published(Events)) > 10


def test_cells_are_fed_where_the_deployment_says_and_nowhere_else() -> None:
    """A host none of whose cells is named is dark, though its gateways are wired."""
    deployment = small(cell_processes="per_patch", power={"feeds": ("arm/0:0",)})
    dark = {
        name: Host(deployment, name).run(5).facts["unpowered_cells"]
        for name in deployment.patches_by_process()
    }
    sizes = {patch.name: patch.n_cells for patch in deployment.patches}
    assert list(dark.values()) == [0, sizes["hand"]]


def test_a_rehearsal_reaches_the_last_step() -> None:
    """Cells form, sample, stream and are heard: whatever is compiled on the way is."""
    assert warm_up(small()) > 0
