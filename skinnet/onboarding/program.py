"""Programs of a new deployment: touch, network or grasp, each with the time that it takes."""

from collections.abc import Sequence
from enum import StrEnum

from skinnet.onboarding.touch_choice import TouchedCell
from skinnet.toml_values import toml_comment, toml_value

__all__ = ["Template", "program_lines", "program_time_s"]

_STRUCTURE_S_PER_JOINT, _MAP_S_PER_JOINT = 5.5, 5.5
_TOUCH_S, _HOME_S, _LISTEN_S, _FORMATION_S = 4.5, 2.0, 5.0, 5.0
_TILT_FREQUENCY_HZ = 2.0
"""Frequency of the second sine of the map: half that of the first (assumed)."""


class Template(StrEnum):
    """Template of the program of a new deployment."""

    TOUCH = "touch"
    GRASP = "grasp"
    NETWORK = "network"


def program_time_s(template: Template, n_joints: int, n_touches: int) -> float:
    """Estimate the simulated time [s] that a program takes at most."""
    if template is Template.NETWORK:
        return _FORMATION_S + _LISTEN_S
    explored_s = n_joints * (_STRUCTURE_S_PER_JOINT + _MAP_S_PER_JOINT)
    if template is Template.GRASP:
        return _FORMATION_S + explored_s + 60.0
    return _FORMATION_S + explored_s + n_touches * (_TOUCH_S + _HOME_S)


def program_lines(
    template: Template, touches: Sequence[TouchedCell], arms: Sequence[Sequence[str]]
) -> list[str]:
    """Lines of TOML for controller, teacher and stimuli.

    Args:
        template: What the controller does.
        touches: Cells that the teacher touches, for `touch`.
        arms: Cells of each arm, for `grasp`.
    """
    if template is Template.NETWORK:
        return _network_lines()
    if template is Template.GRASP:
        return _grasp_lines(arms)
    return _touch_lines(touches)


def _touch_lines(touches: Sequence[TouchedCell]) -> list[str]:
    stages = [f"touch_{number}" for number in range(1, len(touches) + 1)]
    program = ["structure", "map"]
    for stage in stages:
        program += [stage, "home"]
    lines = [
        *toml_comment(
            "The robot explores which joint moves which cells (structure), then how each cell moves (map), "
            "and evades the teacher's finger by what it has found (touch). It returns home after each touch."
        ),
        "[controller]",
        f"program = {toml_value(program)}",
        "",
        *_map_lines(),
        "[controller.stages]",
        'structure = { kind = "structure" }',
        'map = { kind = "map" }',
    ]
    lines += [
        f'{stage} = {{ kind = "guide", duration_s = {_TOUCH_S}, force_gain = 1.0, force_threshold = 0.05 }}'
        for stage in stages
    ]
    lines.append('home = { kind = "posture" }')
    if not touches:
        lines += [
            "",
            "# No touch: the finger reaches no cell at home that the joints could move out of its way.",
        ]
    for stage, touch in zip(stages, touches, strict=True):
        lines += [
            "",
            *toml_comment(
                f"On {toml_value(touch.body)}: nothing stands in the way of the finger at home, and unit "
                f"joint velocities move the cell by {touch.evasion_m:g} m/s along its normal. 30 mm is "
                "deeper than the foam: the robot has to evade."
            ),
            "[[teacher.touches]]",
            f"cell = {toml_value(touch.cell)}",
            f"stage = {toml_value(stage)}",
            "start_s = 0.2",
            "approach_m = 0.02",
            "depth_m = 0.03",
        ]
    return lines


def _map_lines() -> list[str]:
    return [
        *toml_comment(
            "A second sine of each joint tells inertia from the tilt of gravity, which at 4 Hz turns the "
            "signs of cells nearer than 16 mm to an axis."
        ),
        "[controller.map]",
        f"tilt_frequency_hz = {_TILT_FREQUENCY_HZ}",
        "",
    ]


def _network_lines() -> list[str]:
    return [
        *toml_comment(
            "Cells and network only: forces on half of the cells are scripted, no physics is simulated, "
            "and the robot rests."
        ),
        "[scripted_stimuli]",
        "stimulated_fraction = 0.5",
        "",
        "[controller]",
        'program = ["listen"]',
        "",
        "[controller.stages]",
        f'listen = {{ kind = "passive", duration_s = {_LISTEN_S} }}',
    ]


def _grasp_lines(arms: Sequence[Sequence[str]]) -> list[str]:
    cells = [cell for arm in arms for cell in arm]
    lines = [
        *toml_comment(
            "The robot explores its structure, remembers its home pose with a map, and is taught its "
            "contact area: the teacher strokes both arms. Poses to grasp with and a chest are taught "
            "likewise, see docs/grasping.md and deployments/hrp2_teach.toml; a grasp needs the poses home, "
            "open, closed, pulled."
        ),
        "[controller]",
        'program = ["structure", "teach_and_grasp"]',
        "",
        *_map_lines(),
        "[controller.stages]",
        'structure = { kind = "structure" }',
        'teach_and_grasp = { kind = "teach_and_grasp" }',
    ]
    for request in (
        {"state": "idle", "request": "remember", "argument": "home"},
        {"state": "idle", "request": "attend", "argument": "contact"},
        {
            "state": "attend",
            "request": "attend",
            "argument": "off",
            "delay_s": 3.0,
            "contact_free_s": 2.0,
        },
        {"state": "idle", "request": "end", "delay_s": 1.0},
    ):
        lines += ["", "[[controller.teach_and_grasp.operator_requests]]"]
        lines += [f"{key} = {toml_value(value)}" for key, value in request.items()]
    if cells:
        lines += [
            "",
            "[[teacher.strokes]]",
            'stage = "teach_and_grasp.attend"',
            f"cells = {toml_value(cells)}  # some of each arm",
        ]
    return lines
