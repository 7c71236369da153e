"""Published values of the papers, by deployment and metric; data only.

Numbers are those of the papers; where a paper shows a curve and no number, its words are quoted. Expectations
are this project's own, the same as in its tests.
"""

from skinnet.analysis.report.claims import Claim
from skinnet.analysis.report.papers import event_driven, grasping, nursing

__all__ = ["CLAIMS", "SOURCES"]

CLAIMS: dict[str, tuple[Claim, ...]] = grasping.CLAIMS | nursing.CLAIMS | event_driven.CLAIMS
"""Claims by name of the deployment."""

SOURCES = {
    "M14": "Mittendorfer, Yoshida, Moulard, Cheng: A General Tactile Approach for Grasping Unknown Objects "
    "with a Humanoid Robot, 2014",
    "R11": "Mukai, Hirano, Yoshida, Nakashima, Guo, Hayakawa: Whole-Body Contact Manipulation Using Tactile "
    "Information for the Nursing-Care Assistant Robot RIBA, 2011",
    "B15": "Bergner et al.: Event-based signaling…, IROS 2015",
    "B19": "Bergner et al.: Evaluation of a large-scale event-driven robot skin, RA-L 2019",
}
"""Full references by source key."""
