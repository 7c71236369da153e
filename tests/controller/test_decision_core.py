"""One controller process for both programs: what it publishes, by which clock, and what it refuses."""

import numpy as np
import pytest
from small_robot import SHIPPED
from wired_controller import TICK_NS, Wired

from controller.process import ControllerProcess, build
from controller.telemetry import StatePublisher, simulated_clock_ns
from controller.touch.safety_clamp import SafetyLimits
from skinnet.deployment import load
from skinnet.deployment.controller.controller import SafetySpec
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import Command, ControllerState, Joints, PeriodEnd, decode, encode
from skinnet.protocol.sheet_messages import Regions

KEYS = Keys("bot")
STATE_PERIOD_NS = 100_000_000


def nursing(*, recorded: bool = False) -> tuple[ControllerProcess, bytes]:
    """The controller of a nursing run, and its joints at home at time zero."""
    deployment = load(SHIPPED.parent / "riba_trajectory.toml")
    process = build(deployment, "controller", SHIPPED.parent, None, recorded=recorded)
    home = [deployment.body.home_rad.get(joint, 0.0) for joint in deployment.body.joints]
    return process, encode(Joints(t_ns=0, watermark_ns=0, position_rad=home))


def channels(process: ControllerProcess, sent: list[tuple[str, bytes]]) -> list[str]:
    keys = Keys(process.subscriptions[0].split("/")[1])
    return [keys.parse(key)[0].name for key, _ in sent]


def test_the_state_follows_the_clock_of_its_publisher() -> None:
    robot = Wired("listen")
    robot.step()
    now_ns = 0
    by_wall = StatePublisher(KEYS, robot.core, lambda _t_ns: now_ns)
    by_simulation = StatePublisher(KEYS, robot.core, simulated_clock_ns)
    for publisher in (by_wall, by_simulation):
        assert [key for key, _ in publisher.messages(0, last=False)] == [
            KEYS.of("state_machine"),
            KEYS.of("state"),
        ]
        assert publisher.messages(STATE_PERIOD_NS - 1, last=False) == []
    assert by_wall.messages(STATE_PERIOD_NS, last=False) == []
    now_ns = STATE_PERIOD_NS
    for publisher in (by_wall, by_simulation):
        ((key, payload),) = publisher.messages(STATE_PERIOD_NS, last=False)
        assert (key, decode(payload, ControllerState).t_ns) == (KEYS.of("state"), STATE_PERIOD_NS)
        assert publisher.messages(STATE_PERIOD_NS + 1, last=False) == []
        assert len(publisher.messages(STATE_PERIOD_NS + 2, last=True)) == 1


def test_a_recorded_process_says_its_state_before_the_command_that_ends_the_tick() -> None:
    sent: list[tuple[str, bytes]] = []
    for recorded, expected in ((True, ["state_machine", "state", "command"]), (False, ["command"])):
        process, joints = nursing(recorded=recorded)
        process.accept("joints", (), joints)
        sent.clear()
        process.step(lambda key, payload: sent.append((key, payload)))
        assert channels(process, sent) == expected
        told = channels(process, process.best_effort_messages())
        assert told == ["state_machine", "state"]


def test_nursing_refuses_velocities_and_the_skin_of_others() -> None:
    process, _ = nursing()
    velocity = encode(ExternalVelocity(velocity_rad_s=[0.1] * 10))
    with pytest.raises(ProtocolError, match="takes no velocities"):
        process.accept("velocity", (), velocity)
    frame = encode(PeriodEnd(patch="arm", t_ns=0, watermark_ns=9, n_events=0))
    with pytest.raises(ProtocolError, match="period_end of arm"):
        process.accept("period_end", ("arm",), frame)
    with pytest.raises(ProtocolError, match="nursing controller does not subscribe to stream"):
        process.accept("stream", ("boards",), frame)
    assert process.upstreams["boards"].watermark_ns == 0


def test_nursing_waits_for_joints_and_boards() -> None:
    process, joints = nursing()
    assert process.needs() == {"body": 0, "boards": 0}
    process.accept("joints", (), joints)
    regions = Regions(t_ns=0, watermark_ns=4_000_000, frames=b"", rows=b"", patterns=b"", seq=0)
    process.accept("regions", ("boards",), encode(regions))
    assert process.upstreams["boards"].watermark_ns == 4_000_000
    sent: list[tuple[str, bytes]] = []
    process.step(lambda key, payload: sent.append((key, payload)))
    command = decode(sent[-1][1], Command)
    assert (command.stage, command.config_counts, command.end_ns) == ("hold", {}, None)
    assert process.result().role == "nursing"


def test_lost_skin_is_not_waited_for_by_the_clamp_or_the_program() -> None:
    robot = Wired("bow", here=("arm",))  # the host of the hand is lost
    for _ in range(30):
        command = robot.step()
    assert np.any(command.velocity_rad_s)
    assert robot.t_ns == 30 * TICK_NS
    assert robot.result.facts["safety"]["stale_ticks"] == 0


def test_limits_come_from_the_deployment() -> None:
    limits = SafetyLimits.from_spec(
        SafetySpec(max_joint_speed_rad_s=0.7, input_timeout_ms=20.0, ramp_ms=30.0)
    )
    assert (limits.speed_rad_s, limits.ramp_ns) == (0.7, 30_000_000)
    assert limits.joints_max_age_ns == limits.skin_max_age_ns == 20_000_000
