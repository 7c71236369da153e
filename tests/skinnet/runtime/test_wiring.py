"""Subscriptions, senders, peers, upstreams and losses follow from the channel table and the deployment."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from locations import SHIPPED_DEPLOYMENTS
from small_robot import SHIPPED, patch, small

from skinnet.deployment import Deployment, load
from skinnet.deployment.checks import check
from skinnet.deployment.deployment import BOARD_PROCESS
from skinnet.errors import DeploymentError
from skinnet.protocol.channels import BODY, CHANNELS, CONTROLLER, EXTERNAL, RECORDER, Keys, Role
from skinnet.run.process_list import process_list
from skinnet.runtime.wiring import ProcessWiring, WiredProcess, process_roles, wiring_of
from skinnet.transport.key_expressions import key_matches

RECORDED = (
    *("body/free_bodies", "body/joints", "body/command", "skin/*/*/events", "skin/*/events"),
    *("skin/*/stream", "skin/*/period_end", "skin/*/regions", "skin/*/topology", "skin/*/*/config"),
    *("controller/request/*", "controller/velocity", "controller/answer", "controller/state"),
    *("controller/state_machine", "process/*/counters"),
)
SKIN = ("skin/*/period_end", "skin/*/stream", "skin/*/topology", "skin/*/events", "skin/*/*/events")

Facts = tuple[set[str], set[str], dict[str, tuple[str, int]], set[str]]
"""Subscriptions below the prefix, senders, upstreams (process, initial watermark), tolerated losses."""


def written_by_hand(deployment: Deployment, name: str) -> Facts:
    """What each class of process said of itself before the table did."""
    hosts = deployment.patches_by_process()
    boards = ("boards",) if deployment.sheets else ()
    body = {"body": ("body", -1)}
    skin = {patch: (host, 0) for host, patches in hosts.items() for patch in patches}
    told = set(deployment.run.tolerated_losses)
    match name:
        case "body":
            delay_ns = deployment.controller.command_delay_ns
            return {"body/command"}, {"controller"}, {"controller": ("controller", delay_ns)}, told
        case "boards":
            return {"body/pressures", "skin/boards/*/config"}, {"body"}, body, told
        case "controller" if deployment.nursing is not None:
            # but for the velocity, which nobody heard and which is now refused
            heard = {
                "body/joint_ranges",
                "body/joints",
                "skin/*/regions",
                "controller/request/*",
                "controller/velocity",
            }
            return heard, {"body", "boards"}, body | {"boards": ("boards", 0)}, told
        case "controller":
            heard = {"body/joint_ranges", "body/joints", *SKIN, "controller/request/*", "controller/velocity"}
            return heard, {"body", *hosts}, body | skin, told | (set(hosts) if "cells" in told else set())
        case "recorder":
            sources = body | {"controller": ("controller", 0)} | skin
            sources |= {board: (board, 0) for board in boards}
            others = {"body", "controller", *hosts, *boards}
            return set(RECORDED), others, sources, others
    configs = {f"skin/{patch}/*/config" for patch in hosts[name]}
    return {f"body/stimulus/{name}", *configs}, {"body", "controller"}, body, told


def facts(wiring: ProcessWiring, prefix: str) -> Facts:
    sources = {source.name: (source.process, source.watermark_ns) for source in wiring.sources}
    subscriptions = {key.removeprefix(prefix) for key in wiring.subscriptions}
    assert len(sources) == len(wiring.sources)
    assert len(subscriptions) == len(wiring.subscriptions)
    return subscriptions, set(wiring.senders), sources, set(wiring.tolerated_losses)


def all_wirings(deployment: Deployment, recorded: bool = True) -> Iterable[ProcessWiring]:
    names = process_roles(deployment, recorded=recorded)
    return [wiring_of(deployment, name, recorded=recorded) for name in names]


@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("file", SHIPPED_DEPLOYMENTS, ids=lambda file: file.stem)
def test_the_wiring_is_the_one_that_was_written_by_hand(file: Path, recorded: bool) -> None:
    deployment = load(file)
    names = {"body", "controller", *deployment.skin_processes(), *(("recorder",) if recorded else ())}
    wirings = all_wirings(deployment, recorded)
    assert {wiring.name for wiring in wirings} == names
    for wiring in wirings:
        assert facts(wiring, Keys(deployment.robot).prefix) == written_by_hand(deployment, wiring.name)
        assert wiring.peers == names
        assert wiring.recorded == recorded


@pytest.mark.parametrize("name", [BODY, BOARD_PROCESS, CONTROLLER, EXTERNAL, RECORDER, Role.CELLS.value])
def test_no_cell_process_takes_the_name_of_another_member_of_the_loop(name: str) -> None:
    with pytest.raises(DeploymentError, match=f"cell_processes.{name}: .*choose another"):
        check(small(cell_processes={name: ("arm", "hand")}))


@pytest.mark.parametrize("tolerated", [(), ("cells",), ("boards",), ("cells0", "controller"), ("recorder",)])
def test_launcher_and_processes_tolerate_the_same_losses(tolerated: tuple[str, ...]) -> None:
    deployment = mixed(run={"tolerated_losses": list(tolerated)})
    started = {spec.name: spec for spec in process_list(deployment, record=True)}
    wiring = wiring_of(deployment, "controller", recorded=True)
    assert {name: spec.role for name, spec in started.items()} == process_roles(deployment, recorded=True)
    assert {name for name, spec in started.items() if spec.loss_tolerated} == wiring.tolerated_losses
    assert ("cells1" in wiring.tolerated_losses) == ("cells" in tolerated)
    assert ("boards" in wiring.tolerated_losses) == ("boards" in tolerated)


def mixed(**tables: Any) -> Deployment:
    """Cells and boards on one robot, which no shipped deployment has."""
    riba = load(SHIPPED.parent / "riba_trajectory.toml")
    patches = (patch("arm"), patch("hand", 2, 1), patch("leg"))
    return msgspec.structs.replace(small(*patches, **tables), surfaces=riba.surfaces, sheets=riba.sheets)


def hearers(deployment: Deployment, key: str, sender: str) -> set[str]:
    """Names of the processes that receive a message of `sender`, as the loop subscribes them."""
    key = Keys(deployment.robot).prefix + key
    return {
        wiring.name
        for wiring in all_wirings(deployment)
        if sender in wiring.senders | {EXTERNAL}
        and any(key_matches(expression, key) for expression in wiring.subscriptions)
    }


@pytest.mark.parametrize(
    ("key", "sender", "receivers"),
    [
        ("body/stimulus/cells1", "body", {"cells1"}),
        ("body/pressures", "body", {"boards"}),
        ("body/joint_ranges", "body", {"controller"}),
        ("body/joints", "body", {"controller", "recorder"}),
        ("body/free_bodies", "body", {"recorder"}),
        ("body/command", "controller", {"body", "recorder"}),
        ("skin/leg/3/events", "cells0", {"controller", "recorder"}),
        ("skin/leg/period_end", "cells0", {"controller", "recorder"}),
        ("skin/boards/regions", "boards", {"recorder"}),  # stages decide on cells
        ("skin/hand/0/config", "controller", {"cells1", "recorder"}),
        ("skin/hand/0/config", EXTERNAL, {"cells1", "recorder"}),
        ("skin/boards/0/config", EXTERNAL, {"boards", "recorder"}),
        ("controller/request/go", EXTERNAL, {"controller", "recorder"}),
        ("controller/state", "controller", {"recorder"}),
        ("process/cells0/counters", "cells0", {"recorder"}),
        ("run/fault", "recorder", set()),
    ],
)
def test_a_message_reaches_those_whom_it_concerns(key: str, sender: str, receivers: set[str]) -> None:
    assert hearers(mixed(), key, sender) == receivers


def test_the_nursing_program_decides_on_boards_alone() -> None:
    riba = load(SHIPPED.parent / "riba_trajectory.toml")
    deployment = msgspec.structs.replace(mixed(), nursing=riba.nursing)
    assert hearers(deployment, "skin/boards/regions", "boards") == {"controller", "recorder"}
    assert hearers(deployment, "skin/arm/period_end", "cells0") == {"recorder"}
    assert {source.name for source in wiring_of(deployment, "controller").sources} == {"body", "boards"}


@pytest.mark.parametrize("file", SHIPPED_DEPLOYMENTS, ids=lambda file: file.stem)
def test_every_channel_with_a_sender_reaches_all_its_receivers(file: Path) -> None:
    deployment = load(file)
    wirings = all_wirings(deployment)
    roles = {wiring.role for wiring in wirings}
    for row in CHANNELS:
        wanted = set(row.receivers) | ({Role.RECORDER} if row.recorded else set())
        subscribed = {
            wiring.role
            for wiring in wirings
            if row in {Keys(deployment.robot).parse(key)[0] for key in wiring.subscriptions}
        }
        if row.sender in roles | {None}:
            assert subscribed == (wanted & roles) - (
                {Role.RECORDER} if row.sender is Role.RECORDER else set()
            )
        else:
            assert subscribed <= {Role.RECORDER}


@pytest.mark.parametrize("deployment", [small(), mixed()], ids=["cells", "mixed"])
def test_a_process_waits_for_those_that_it_hears_and_never_for_itself(deployment: Deployment) -> None:
    for wiring in all_wirings(deployment):
        processes = {source.process for source in wiring.sources}
        assert processes
        assert processes <= wiring.senders <= wiring.peers - {wiring.name}


def test_cells_stands_for_every_cell_process_and_for_no_other() -> None:
    deployment = mixed(run={"tolerated_losses": ("cells", "controller")})
    for name in ("body", "cells0", "cells1", "boards", "controller"):
        assert wiring_of(deployment, name).tolerated_losses == {"cells0", "cells1", "controller"}
    assert wiring_of(deployment, "recorder").tolerated_losses == {
        "body",
        "cells0",
        "cells1",
        "boards",
        "controller",
    }


def test_a_process_takes_its_attributes_from_its_wiring() -> None:
    wiring = wiring_of(small(), "controller", recorded=True)
    process = WiredProcess(wiring)
    assert (process.name, process.role, process.recorded) == ("controller", "controller", True)
    assert process.peers == {"body", "cells0", "cells1", "controller", "recorder"}
    assert {name: up.watermark_ns for name, up in process.upstreams.items()} == {
        "body": -1,
        "arm": 0,
        "hand": 0,
    }
    process.upstreams["arm"].end_period(5)
    assert WiredProcess(wiring).upstreams["arm"].watermark_ns == 0  # a wiring has no state


def test_a_process_that_is_not_there_has_no_wiring() -> None:
    with pytest.raises(DeploymentError, match=r"'cells9'.*body, cells0, cells1, controller"):
        wiring_of(small(), "cells9")
