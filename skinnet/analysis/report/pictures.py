"""PNG pictures of a run folder: captions, and sizes read without an image library."""

from dataclasses import dataclass
from pathlib import Path

__all__ = ["Picture", "read_pictures"]

_BEGIN, _END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
_CAPTIONS = {
    "body": ("The body", "Cells and elements coloured by their readings at the strongest touch."),
    "activity_matrix": ("Activity matrix", "DoFs against the cells that they move [M14, (1)]."),
    "kinematic_tree": (
        "Kinematic tree",
        "Body parts and joints found by structural exploration [M14, Fig. 4].",
    ),
    "sensory_motor_map": (
        "Sensory-motor map",
        "Motion of each cell along its normal by each DoF [M14, (3)].",
    ),
    "touch": (
        "Touch and joint motion",
        "Force and proximity of every cell, and joint motion [M14, Fig. 8].",
    ),
    "grasp": ("Grasp", "Joints, pre-contact, force and the object over the states [M14, Fig. 10]."),
    "reactions": ("Reactions", "Latency components from the stimulus to the command in effect."),
    "deviations": ("Deviations", "Object, evaluation function, position and rotation [R11, Figs. 9, 10]."),
    "feedback": ("Tactile feedback", "Forces, centres of pressure, adjustments [R11, Figs. 12, 13]."),
    "object": ("The object", "Ground truth of position and slip."),
    "patterns": ("Pressure patterns", "Readings of the elements at three moments [R11, Fig. 14]."),
    "event_driven": (
        "Event-driven rates",
        "Fractions of the clock-driven rate, measured and published.",
    ),
    "thresholds": ("Thresholds", "Fraction of the clock-driven rate against the send-on-delta threshold."),
    "rates": ("Rates", "Packets per second into the controller."),
    "cpu": ("CPU", "Of each process, per simulated second."),
    "latency": ("Latency", "From the sample to the gateway."),
    "plan": ("Link budget", "Cells coloured by the load of their link to the gateway."),
}
"""Title and caption by name, in the order of display; other pictures follow by name."""


@dataclass(frozen=True)
class Picture:
    """PNG file of a run folder; sizes in pixels."""

    name: str
    title: str
    caption: str
    width: int
    height: int
    data: bytes


def read_pictures(folder: Path) -> tuple[list[Picture], list[str]]:
    """Read the PNG pictures in `folder`; return also the names of files that are not valid PNG."""
    order = list(_CAPTIONS)
    names = sorted(
        (path.stem for path in folder.glob("*.png")),
        key=lambda name: (order.index(name) if name in order else len(order), name),
    )
    found, damaged = [], []
    for name in names:
        data = (folder / f"{name}.png").read_bytes()
        if not (data.startswith(_BEGIN) and data.endswith(_END)):
            damaged.append(f"{name}.png")
            continue
        width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
        title, caption = _CAPTIONS.get(name, (name.replace("_", " ").capitalize(), ""))
        found.append(Picture(name, title, caption, width, height, data))
    return found, damaged
