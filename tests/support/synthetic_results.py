"""Results of processes as metrics read them, with values that a test chooses."""

from typing import Any

import numpy as np
from locations import DEPLOYMENTS

from skinnet.deployment import Deployment
from skinnet.deployment.load import load
from skinnet.runtime.process_result import ProcessResult

MS = 1_000_000
S = 1_000_000_000
TICK_NS = 5 * MS
N_DOFS = 14

TOUCH_DEPLOYMENT: Deployment = load(DEPLOYMENTS / "hrp2_touch.toml")
GRASP_DEPLOYMENT: Deployment = load(DEPLOYMENTS / "hrp2_grasp.toml")
CYLINDER_DEPLOYMENT: Deployment = load(DEPLOYMENTS / "riba_cylinder.toml")
N_CELLS = sum(patch.n_cells for patch in TOUCH_DEPLOYMENT.patches)


def ticks_ns(end_ns: int) -> np.ndarray:
    """Control ticks from 0 up to and without `end_ns`."""
    return np.arange(0, end_ns, TICK_NS, dtype=np.int64)


def touch_controller(end_ns: int = S, stage: str = "force_guidance", **arrays: Any) -> ProcessResult:
    """A controller in one guide stage all the time, at rest, without tactile input."""
    t_ns = ticks_ns(end_ns)
    idle = {
        "t_ns": t_ns,
        "velocity_rad_s": np.zeros((len(t_ns), N_DOFS), dtype=np.float32),
        "tactile_input_t_ns": t_ns,
        "tactile_input": np.zeros((len(t_ns), N_CELLS, 4), dtype=np.float16),
        "reaction_log": np.zeros(
            0,
            dtype=[
                ("tick_ns", "i8"),
                ("t_sampled_ns", "i8"),
                ("t_delivered_ns", "i8"),
                ("cell", "i4"),
                ("channel", "i4"),
                ("stage", "i4"),
            ],
        ),
    }
    facts = {"stages": [[stage, 0]], "end_ns": end_ns, "command_delay_ns": 123 * MS}
    return ProcessResult("controller", "controller", facts, idle | arrays)


def touch_body(end_ns: int = S, **facts_and_arrays: Any) -> ProcessResult:
    """A body that does not move, touched by nobody, with every command in effect 5 ms after its tick."""
    t_ns = ticks_ns(end_ns)
    arrays: dict[str, Any] = {
        "joint_t_ns": t_ns,
        "joint_rad": np.zeros((len(t_ns), N_DOFS), dtype=np.float32),
        "peak_force_t_ns": t_ns,
        "peak_force_n": np.zeros(len(t_ns), dtype=np.float32),
        "command_ns": np.column_stack([t_ns, t_ns + TICK_NS]),
    }
    facts: dict[str, Any] = {
        "threshold_crossings": [],
        "touches": [],
        "lessons": [],
        "strokes": [],
        "motion_onsets": [],
        "peak_force_by_stage_n": {},
    }
    for name, value in facts_and_arrays.items():
        (arrays if name in arrays else facts)[name] = value
    return ProcessResult("body", "body", facts, arrays)


def touch_facts(**changes: Any) -> dict[str, Any]:
    """Ground truth of the first touch of the deployment: 1.0 N on force cell 0 of `left_forearm/5`."""
    return {
        "touch": 0,
        "cell": "left_forearm/5",
        "stage": "force_guidance",
        "begin_ns": 0,
        "contact_ns": 100 * MS,
        "hold_ns": 300 * MS,
        "end_ns": 800 * MS,
        "peak_force_n": 1.1,
        "mean_hold_force_n": 1.0,
        "mean_felt_force_n": 1.0,
        "mean_gauge_force_n": 1.0,
        "evaded_m": 0.02,
        "depth_controlled": False,
        "onset_gap_m": None,
    } | changes


def grasp_transitions(
    contacts: tuple[int, int, int] = (12, 11, 1), last_event: str = "pose reached"
) -> list[dict[str, Any]]:
    """A whole grasp: opened, approached, pulled to the chest with `contacts`, held, released."""
    log = [
        ("open", "pose reached", 1, (0, 0, 0)),
        ("approach", "object near both arms", 2, (0, 0, 0)),
        ("contact", "object touches both arms", 3, (6, 1, 0)),
        ("load", "both arms press", 4, (10, 10, 0)),
        ("pull", "object touches the chest", 6, contacts),
        ("hold", "release", 16, (10, 10, 12)),
        ("release", last_event, 20, (0, 0, 0)),
    ]
    following = [state for state, *_ in log[1:]] + ["idle"]
    return [
        {
            "state": state,
            "event": event,
            "t_ns": t_s * S,
            "contacts": list(cells),
            "next_state": after,
            "argument": "",
        }
        for (state, event, t_s, cells), after in zip(log, following, strict=True)
    ]


def grasp_controller(transitions: list[dict[str, Any]]) -> ProcessResult:
    t_ns = np.arange(0, 20 * S, 100 * MS, dtype=np.int64)
    facts = {
        "transitions": transitions,
        "stages": [["teach_and_grasp", 0]],
        "end_ns": 20 * S,
        "poses": [],
        "refused_requests": [],
        "areas": {},
    }
    arrays = {
        "patch_t_ns": t_ns,
        "patch_readings": np.zeros((len(t_ns), 4, 4), dtype=np.float32),
        "t_ns": t_ns,
        "velocity_rad_s": np.zeros((len(t_ns), N_DOFS), dtype=np.float32),
    }
    return ProcessResult("controller", "controller", facts, arrays)


def grasp_body(**changes: Any) -> ProcessResult:
    """A body whose object was carried by skin for six seconds and stands on the stand at the end."""
    t_ns = np.arange(0, 20 * S, 100 * MS, dtype=np.int64)
    pose = np.tile(np.array([0.4, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], dtype=np.float32), (len(t_ns), 1))
    thing = {
        "name": "delivery_box",
        "mass_kg": 1.0,
        "weight_n": 9.81,
        "initial_position_m": [0.4, 0.0, 1.0],
        "yaw_rad": 0.0,
        "dropped_ns": None,
        "carried_without_stand_s": 6.0,
        "carried_on_skin_s": 6.0,
        "max_descent_m": 0.03,
        "peak_speed_m_s": 0.1,
        "rigid_contacts": {},
    }
    arrays = {
        "object_t_ns": t_ns,
        "object_pose": pose,
        "object_stand_force_n": np.full(len(t_ns), 9.81, dtype=np.float32),
        "peak_force_t_ns": t_ns,
        "peak_force_n": np.full(len(t_ns), 0.8, dtype=np.float32),
    }
    for name, value in changes.items():
        (arrays if name in arrays else thing)[name] = value
    facts = {"object": thing, "peak_force_by_stage_n": {"teach_and_grasp.pull": 0.9}}
    return ProcessResult("body", "body", facts, arrays)
