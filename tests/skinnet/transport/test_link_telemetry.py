"""What is told to watchers only: it is right, it is told only if somebody wants it, and it changes no log."""

import asyncio
import os
from typing import Any

import numpy as np
import pytest
from hosted_cells import Host
from rich.console import Console
from small_robot import SHIPPED, lattice, patch, small
from transports import KEYS, LONG_S, Star
from wired_controller import Wired

from cells.networking.link_telemetry import LinkTelemetry
from controller.grasping import state_machine
from controller.grasping.teach_and_grasp import request_arguments
from controller.nursing import state_machine as nursing
from controller.telemetry import describe_nursing, describe_program
from skinnet.deployment import load
from skinnet.protocol.messages import decode, unpack
from skinnet.protocol.states import FORMING
from skinnet.protocol.telemetry_messages import (
    LINK_INTO_CELL,
    LINK_ROW,
    LINK_UP,
    LinkLoad,
    ProcessLoad,
    StateMachineDescription,
)
from skinnet.run.observers.process_monitor import monitor_processes
from skinnet.run.progress import ProgressDisplay

LINKS = "skinnet/bot/skin/*/links"
BRIDGED = small(
    patch("arm", 3, 2, (0, 2)),
    {"name": "hand", "body": "hand", "lattice": lattice(2, 1), "interfaces": []},
    bridges=({"a": "arm/5:0", "b": "hand/0:2"},),
    faults=(
        {"kind": "link_cut", "target": "arm/1:0", "at_s": 0.05},
        {"kind": "cell_dead", "target": "hand/1", "at_s": 0.05},
    ),
)


def reports(host: Host) -> dict[str, Any]:
    """Rows and cells without power by patch."""
    loads = [decode(payload, LinkLoad) for _, payload in host.node.telemetry()]
    return {load.patch: (unpack(load.rows, LINK_ROW), load.unpowered_cells, load.t_ns) for load in loads}


def test_links_are_told_by_patch_cell_and_port() -> None:
    host = Host(BRIDGED).run(10)
    told = reports(host)
    arm, dark, t_ns = told["arm"]
    assert t_ns == host.t_ns
    assert dark == []
    ends = {(int(row["cell"]), int(row["port"]), bool(row["state"] & LINK_INTO_CELL)) for row in arm}
    assert len(ends) == len(arm)
    assert (0, 2, True) in ends, "the link from the computer"
    assert (0, 2, False) in ends, "and the link to it"
    assert (5, 0, False) in ends, "the bridge belongs to who sends over it"
    hand, _, _ = told["hand"]
    assert (0, 2) in {(int(row["cell"]), int(row["port"])) for row in hand}
    assert (arm["state"] & LINK_UP).all()


def test_what_links_carried_is_what_the_network_counted() -> None:
    host = Host(BRIDGED).run(40)
    counters = host.node.network.kernel.link_counters
    told = reports(host)
    rows = np.concatenate([rows for rows, _, _ in told.values()])
    for name, column in counters._asdict().items():
        assert rows[name].sum() == column.sum()
    assert rows["packets"].sum() > 100
    assert told["hand"][1] == [1], "its cell has no power any more"
    down = {(int(row["cell"]), int(row["port"])) for row in told["arm"][0] if not row["state"] & LINK_UP}
    assert (1, 0) in down


def test_reports_change_no_log() -> None:
    quiet, asked = Host(BRIDGED), Host(BRIDGED)
    for _ in range(30):
        quiet.run(1)
        asked.run(1)
        asked.node.telemetry()
    assert quiet.facts["logs"] == asked.facts["logs"]


def test_a_report_needs_no_patch_of_its_own_wiring() -> None:
    host = Host(small(patch("arm", 1, 1)))
    report = LinkTelemetry(host.node.wiring, KEYS)
    (entry,) = report.messages(host.node.network.kernel, np.ones(1, dtype=bool), 0)
    assert entry[0] == KEYS.of("links", "arm")
    assert len(unpack(decode(entry[1], LinkLoad).rows, LINK_ROW)) == 2


async def test_an_audience_is_noticed_when_it_comes_and_goes(star: Star) -> None:
    hub, member = star.join("hub"), star.join("a")
    wanted = member.session.matching_listener(LINKS)

    async def until(there: bool) -> None:
        async with asyncio.timeout(LONG_S):
            while wanted() != there:
                await asyncio.to_thread(lambda: None)  # others have their turn

    await until(False)
    undo = hub.session.declare_subscriber(LINKS, lambda _key, _payload: None)
    await until(True)
    undo()
    await until(False)


def test_a_machine_has_every_move_of_the_table_and_leads_through_the_program() -> None:
    deployment = load(SHIPPED.parent / "hrp2_teach.toml")
    machine = describe_program(deployment.controller, ("open", "closed"), 5)
    moves = {tuple(move) for move in machine.transitions}
    stage = next(n for n, s in deployment.controller.stages.items() if s.kind == "teach_and_grasp")
    for state, row in state_machine.TRANSITIONS.items():
        for event, to in row.items():
            assert (f"{stage}.{state.value}", event.value, f"{stage}.{to.value}") in moves
    assert machine.states[0] == FORMING
    assert {state for state, _, _ in moves} | {to for _, _, to in moves} == set(machine.states)
    reached, waiting = {FORMING}, [FORMING]
    while waiting:
        here = waiting.pop()
        following = {to for state, _, to in moves if state == here} - reached
        reached |= following
        waiting += following
    assert reached == set(machine.states), "every state can be reached"
    assert machine.requests == request_arguments(("open", "closed"))


def test_requests_are_those_that_a_session_understands() -> None:
    from controller.grasping.teach_and_grasp import parse_request

    requests = request_arguments(("home",))
    for what, arguments in requests.items():
        for argument in arguments or ["a_name"]:
            event, why = parse_request(what, argument)
            assert event is not None, why
            assert why == ""
    assert set(requests) == {"guide", "attend", "remember", "go", "grasp", "release", "cancel", "end"}


def test_the_nursing_program_has_a_machine_of_its_own() -> None:
    machine = describe_nursing(0)
    assert len(machine.transitions) == len(nursing.TRANSITIONS)
    assert machine.requests == {}


def test_a_controller_tells_its_machine_once_and_when_it_has_learnt() -> None:
    robot = Wired("bow", "home")
    told: list[StateMachineDescription] = []
    for tick in range(6):
        robot.step()
        if tick == 3:
            robot.core.controller.self_model.poses["new"] = robot.position_rad
        news = [
            payload for key, payload in robot.node.best_effort_messages() if key == KEYS.of("state_machine")
        ]
        told += [decode(payload, StateMachineDescription) for payload in news]
    assert len(told) == 2
    assert told[0].states == [FORMING, "bow", "home"]
    assert told[0].transitions == [[FORMING, "network formed", "bow"], ["bow", "done", "home"]]


class Window:
    """What the launcher tells its window."""

    def __init__(self) -> None:
        self.told: list[ProcessLoad] = []
        self.enough = asyncio.Event()

    def publish_process_load(self, load: Any) -> None:
        self.told.append(load())
        if len(self.told) == 3:
            self.enough.set()


async def test_processes_tell_what_they_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("skinnet.run.observers.process_monitor._PUBLICATION_PERIOD_S", 0.001)
    window: Any = Window()
    gone = 2**22 + 1  # beyond what a process can have
    async with monitor_processes(
        {"me": os.getpid(), "gone": gone}, window, ProgressDisplay(Console(), quiet=True)
    ):
        await asyncio.wait_for(window.enough.wait(), LONG_S)
    last = window.told[-1]
    assert last.name == ["me", "gone"]
    assert last.pid == [os.getpid(), gone]
    assert last.memory_mb[0] > 10.0
    assert last.memory_mb[1] == 0.0
    assert last.cores[0] >= 0.0
    async with monitor_processes({"me": os.getpid()}, None, ProgressDisplay(Console(), quiet=True)):
        pass  # nobody can watch
