"""One controller process for both programs: what it publishes, by which clock, and what it refuses."""

from collections.abc import Callable

import numpy as np
import pytest
from small_robot import SHIPPED
from wired_controller import TICK_NS, Wired

from controller.inputs import JointInput
from controller.process import ControllerProcess, build
from controller.telemetry import StatePublisher, simulated_clock_ns
from controller.touch.safety_clamp import SafetyLimits
from skinnet.deployment import load
from skinnet.deployment.controller.controller import SafetySpec
from skinnet.errors import ProtocolError
from skinnet.protocol.channels import Keys
from skinnet.protocol.external_messages import ExternalVelocity
from skinnet.protocol.messages import Command, ControllerState, Joints, PeriodEnd, decode, encode
from skinnet.protocol.sheet_messages import SCAN_FRAME_ROW, Regions

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


def test_a_joint_sensor_that_pauses_stops_a_touch_program() -> None:
    """Its messages still come in time, with the measurement that they had: that one's age counts."""
    robot = Wired("bow")
    paused_ns = 10 * TICK_NS
    speeds = [float(np.abs(robot.step(min(robot.t_ns, paused_ns)).velocity_rad_s).max()) for _ in range(60)]
    assert min(speeds[1:21]) > 0.0, "50 ms are no age"
    assert speeds[20] > speeds[25] > speeds[30] > speeds[39] > 0.0
    assert speeds[41:] == [0.0] * 19
    assert robot.result.facts["safety"]["stale_ticks"] == 60 - 21
    assert np.abs(robot.step().velocity_rad_s).max() > 0.0, "back with the sensor"


def test_a_late_joint_measurement_is_used_when_it_comes() -> None:
    joints = JointInput(1)
    for measured_ns, watermark_ns in ((0, 0), (0, 5), (0, 10), (7, 15), (20, 20), (7, 20)):
        joints.accept(encode(Joints(t_ns=measured_ns, watermark_ns=watermark_ns, position_rad=[measured_ns])))
    assert [(m.t_ns, *m.position_rad) for m in map(joints.latest, (0, 5, 10, 15, 20, 25))] == [
        (0, 0.0), (0, 0.0), (7, 7.0), (7, 7.0), (20, 20.0), (20, 20.0),
    ]  # fmt: skip
    with pytest.raises(ProtocolError, match="measured at 31 ns, after its watermark 30 ns"):
        joints.accept(encode(Joints(t_ns=31, watermark_ns=30, position_rad=[0.0])))


def nursing_speeds(measured: Callable[[int], int], sampled: Callable[[int], int]) -> tuple[list[float], str]:
    """Largest joint speeds of a nursing run by tick, and what stopped it.

    Its joints are measured, and its boards sampled, at the given times of each tick.
    """
    deployment = load(SHIPPED.parent / "riba_trajectory.toml", NURSING_SETTINGS)
    process = build(deployment, "controller", SHIPPED.parent, None)
    position_rad = np.array([deployment.body.home_rad.get(joint, 0.0) for joint in deployment.body.joints])
    history: dict[int, list[float]] = {}
    sent: list[tuple[str, bytes]] = []
    period_ns, speeds = deployment.controller.period_ns, []
    for t_ns in range(0, 200 * period_ns, period_ns):
        history[t_ns] = position_rad.tolist()
        measured_ns = measured(t_ns)
        joints = Joints(t_ns=measured_ns, watermark_ns=t_ns, position_rad=history[measured_ns])
        process.accept("joints", (), encode(joints))
        frames = np.zeros(len(deployment.sheets), dtype=SCAN_FRAME_ROW)
        frames["board"] = np.arange(len(frames))
        frames["t_sampled_ns"], frames["t_delivered_ns"] = sampled(t_ns), t_ns - 1
        regions = Regions(t_ns=t_ns, watermark_ns=t_ns, frames=frames.tobytes(), rows=b"")
        process.accept("regions", ("boards",), encode(regions))
        process.step(lambda key, payload: sent.append((key, payload)))
        velocity = np.array(decode(sent[-1][1], Command).velocity_rad_s)
        position_rad = position_rad + velocity * period_ns * 1e-9
        speeds.append(float(np.abs(velocity).max()))
    return speeds, process.result().facts["stopped_by"]


NURSING_SETTINGS = ("nursing.hold_s=0.1", "nursing.record_s=0.1", "nursing.skin_timeout_ms=5000")
PAUSED_NS = 1_000_000_000


def test_nursing_moves_while_joints_and_skin_are_fresh() -> None:
    speeds, stopped_by = nursing_speeds(lambda t_ns: t_ns, lambda t_ns: t_ns)
    assert stopped_by is None
    assert min(speeds[60:]) > 0.0


def test_a_joint_sensor_that_pauses_stops_a_nursing_program() -> None:
    speeds, stopped_by = nursing_speeds(lambda t_ns: min(t_ns, PAUSED_NS), lambda t_ns: t_ns)
    assert stopped_by == "joints_silent"
    assert speeds[105] > 0.0
    assert speeds[106:] == [0.0] * 94


def test_boards_that_pause_bring_the_nursing_arms_to_rest() -> None:
    """Whatever the program takes for silence: the clamp has a limit of its own."""
    speeds, stopped_by = nursing_speeds(lambda t_ns: t_ns, lambda t_ns: min(t_ns, PAUSED_NS))
    assert stopped_by is None
    assert speeds[105] > speeds[108] > speeds[112] > 0.0
    assert speeds[116:] == [0.0] * 84


def test_limits_come_from_the_deployment() -> None:
    limits = SafetyLimits.from_spec(
        SafetySpec(max_joint_speed_rad_s=0.7, input_timeout_ms=20.0, ramp_ms=30.0)
    )
    assert (limits.speed_rad_s, limits.ramp_ns) == (0.7, 30_000_000)
    assert limits.joints_max_age_ns == limits.skin_max_age_ns == 20_000_000
