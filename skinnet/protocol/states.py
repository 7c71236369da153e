"""States that the controller publishes: before its program, and those of teaching and grasping [M14, Fig. 7].

Their values are the names in deployments, messages, metrics and plots. Transitions are the controller's
(`controller.grasping.state_machine`).
"""

from enum import Enum

__all__ = ["CONFIGURABLE_STATES", "FORMING", "GRASP_STATES", "TeachAndGraspState"]

FORMING = "forming"
"""State before the program begins, while the skin's network forms."""


class TeachAndGraspState(Enum):
    """States of teaching and grasping."""

    IDLE = "idle"
    GUIDE_FORCE = "guide_force"
    GUIDE_PROXIMITY = "guide_proximity"
    ATTEND = "attend"
    REMEMBER = "remember"
    GO = "go"
    OPEN = "open"
    APPROACH = "approach"
    CONTACT = "contact"
    LOAD = "load"
    PULL = "pull"
    HOLD = "hold"
    SET_DOWN = "set_down"
    RELEASE = "release"
    SAFE = "safe"
    ENDED = "ended"


CONFIGURABLE_STATES = tuple(
    state.value for state in TeachAndGraspState if state is not TeachAndGraspState.ENDED
)
"""Names of the states in which the robot may be, and for which a deployment may set parameters."""
GRASP_STATES = tuple(
    state.value
    for state in (
        TeachAndGraspState.OPEN,
        TeachAndGraspState.APPROACH,
        TeachAndGraspState.CONTACT,
        TeachAndGraspState.LOAD,
        TeachAndGraspState.PULL,
        TeachAndGraspState.HOLD,
        TeachAndGraspState.SET_DOWN,
        TeachAndGraspState.RELEASE,
        TeachAndGraspState.SAFE,
    )
)
"""Names of the states of a grasp, including those that end it."""
