"""Scripted stimuli, as a deployment describes them: what presses which cells, and when."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.table import NonNegative, Positive, Share, Table, ns_of_s
from skinnet.errors import DeploymentError

__all__ = ["CellPattern", "Course", "ScriptSpec", "ScriptTouch", "StimulationSpec"]

CellPattern = Annotated[str, Meta(pattern=r"^([A-Za-z0-9_\-]+|\*)/([0-9]+|\*)$")]
"""Cells: "patch/cell", where * stands for any."""


class Course(Table, frozen=True, kw_only=True):
    """The course of a scripted press *(assumed)*.

    Something warm comes near from `approach_m` in `approach_s`, presses harder for `rise_s`, holds for
    `hold_s`, lets go in `release_s` and leaves as it came. While it presses, its force swings by the share
    `modulation` at `modulation_hz`: nobody holds still. One of the three force cells feels all of it, the
    others less by up to the share `unevenness`.
    """

    approach_m: Positive = 0.08
    approach_s: Positive = 0.3
    rise_s: Positive = 0.15
    hold_s: NonNegative = 1.0
    release_s: Positive = 0.15
    modulation: Share = 0.1
    modulation_hz: NonNegative = 2.0
    unevenness: Share = 0.5
    temperature_c: float = 33.0

    @property
    def duration_ns(self) -> int:
        """From the moment it comes near to the moment it is gone [ns]."""
        return sum(map(ns_of_s, (self.approach_s, self.rise_s, self.hold_s, self.release_s, self.approach_s)))


class StimulationSpec(Course, frozen=True, kw_only=True):
    """How the share `script.stimulated` of the cells is pressed *(assumed)*.

    Each press has a force of its own within `force_n`, on the force cell that is pressed most. Cells are
    pressed again after `pause_s`, or with `repeat = false` once: a hug. Their first presses are spread over
    `stagger_s` from `start_s` on, without `stagger_s` over a whole period, so that they never beat together.
    """

    force_n: tuple[Positive, Positive] = (0.8, 3.0)
    start_s: NonNegative = 0.5
    pause_s: NonNegative = 1.0
    repeat: bool = True
    stagger_s: NonNegative | None = None

    @property
    def period_ns(self) -> int:
        """From one press of a cell to its next [ns]."""
        return self.duration_ns + ns_of_s(self.pause_s)


class ScriptTouch(Course, frozen=True, kw_only=True):
    """Cells that are pressed all at once, at `start_s` of the run and then `every_s`, or once without it."""

    cells: Annotated[tuple[CellPattern, ...], Meta(min_length=1)]
    start_s: NonNegative
    force_n: Positive
    every_s: Positive | None = None
    modulation: Share = 0.0
    unevenness: Share = 0.0


class ScriptSpec(Table, frozen=True, kw_only=True):
    """Stimuli from a script instead of physics: joints follow their commands exactly, touch is prescribed.

    Cells feel gravity and their own motion as the model's kinematics give them; what the script does not
    press, nothing touches. The teacher's finger does not act.
    """

    stimulated: Share = 0.0
    """Share of the cells that are pressed as `script.stimulation` says; the seed chooses them by name."""
    stimulation: StimulationSpec = field(default_factory=StimulationSpec)
    touches: tuple[ScriptTouch, ...] = ()

    def check(self, sizes: Mapping[str, int]) -> None:
        """Raises DeploymentError if the script contradicts itself or patches of `sizes` cells."""
        low_n, high_n = self.stimulation.force_n
        if low_n > high_n:
            raise DeploymentError(
                f"script.stimulation.force_n = [{low_n:g}, {high_n:g}]: the smallest force comes first"
            )
        for index, touch in enumerate(self.touches):
            self.touched(index, sizes)
            if touch.every_s is not None and ns_of_s(touch.every_s) < touch.duration_ns:
                raise DeploymentError(
                    f"script.touches[{index}].every_s = {touch.every_s:g}: a press takes "
                    f"{touch.duration_ns * 1e-9:g} s from approach to withdrawal; at least that"
                )

    def touched(self, index: int, sizes: Mapping[str, int]) -> list[tuple[str, int]]:
        """Cells that touch `index` presses, each once, in the order of the patches.

        Raises:
            DeploymentError: it names a patch or a cell that does not exist.
        """
        found = {cell for pattern in self.touches[index].cells for cell in _matching(pattern, sizes, index)}
        return [(patch, cell) for patch, n in sizes.items() for cell in range(n) if (patch, cell) in found]


def _matching(pattern: str, sizes: Mapping[str, int], index: int) -> list[tuple[str, int]]:
    patch, _, cell = pattern.partition("/")
    key = f"script.touches[{index}].cells: {pattern!r}"
    if patch != "*" and patch not in sizes:
        raise DeploymentError(f"{key}: unknown patch; there are {', '.join(sizes)}")
    patches = list(sizes) if patch == "*" else [patch]
    if cell == "*":
        return [(name, i) for name in patches for i in range(sizes[name])]
    found = [(name, int(cell)) for name in patches if int(cell) < sizes[name]]
    if not found:
        raise DeploymentError(f"{key}: {patch} has cells 0 to {max(sizes[name] for name in patches) - 1}")
    return found
