"""Published capabilities of the controller: its state machine and the requests it accepts."""

from collections.abc import Iterable

from controller.grasping import state_machine
from controller.grasping.teach_and_grasp import request_arguments
from controller.nursing import state_machine as nursing
from skinnet.deployment.controller.controller import ControllerSpec
from skinnet.protocol.channels import Keys
from skinnet.protocol.messages import encode
from skinnet.protocol.states import FORMING
from skinnet.protocol.telemetry_messages import StateMachineDescription

__all__ = ["Capabilities", "describe_nursing", "describe_program"]


def describe_program(control: ControllerSpec, poses: Iterable[str], t_ns: int) -> StateMachineDescription:
    """Describe the states and requests of a program of stages, given the known `poses`.

    States of a teach-and-grasp stage are named `<stage>.<state>`, as in commands.
    """
    states: list[str] = [FORMING]
    moves: list[list[str]] = []
    requests: dict[str, list[str]] = {}
    ends = [(FORMING, "network formed")]
    for stage in control.program:
        if control.stages[stage].kind == "teach_and_grasp":
            own, inside, following = _teach_and_grasp_transitions(stage)
            requests = request_arguments(poses)
        else:
            own, inside, following = [stage], [], [(stage, "done")]
        moves += [[state, event, own[0]] for state, event in ends] + inside
        states += own
        ends = following
    return StateMachineDescription(
        t_ns=t_ns, states=list(dict.fromkeys(states)), transitions=moves, requests=requests
    )


def describe_nursing(t_ns: int) -> StateMachineDescription:
    """Describe the states of the nursing program, which takes no requests."""
    moves = [[state.value, event.value, to.value] for (state, event), to in nursing.TRANSITIONS.items()]
    return StateMachineDescription(
        t_ns=t_ns, states=[state.value for state in nursing.State], transitions=moves
    )


class Capabilities:
    """Publisher of the capabilities, once and after every change.

    Args:
        keys: Keys of the robot.
        control: Program of the controller.
    """

    def __init__(self, keys: Keys, control: ControllerSpec) -> None:
        self._key, self._control = keys.of("state_machine"), control
        self._published_poses: tuple[str, ...] | None = None

    def publish_if_changed(self, poses: Iterable[str], t_ns: int) -> list[tuple[str, bytes]]:
        """Return key and message if the known poses have changed; else nothing."""
        known = tuple(poses)
        if known == self._published_poses:
            return []
        self._published_poses = known
        return [(self._key, encode(describe_program(self._control, known, t_ns)))]


def _teach_and_grasp_transitions(stage: str) -> tuple[list[str], list[list[str]], list[tuple[str, str]]]:
    """States and transitions of a teach-and-grasp stage, and its final states with their event."""
    states = [f"{stage}.{state.value}" for state in state_machine.State]
    moves = [
        [f"{stage}.{state.value}", event.value, f"{stage}.{to.value}"]
        for state, row in state_machine.TRANSITIONS.items()
        for event, to in row.items()
    ]
    return states, moves, [(f"{stage}.{state_machine.State.ENDED.value}", "done")]
