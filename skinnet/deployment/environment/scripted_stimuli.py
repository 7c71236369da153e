"""Scripted stimuli spec: force profiles on cells, instead of physics."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.cell_names import CellPattern, match_cells
from skinnet.deployment.types import Fraction, NonNegative, Positive, Table, ns_of_s

__all__ = ["ForceProfile", "RandomPressSpec", "ScriptedPressSpec", "ScriptedStimuliSpec"]


class ForceProfile(Table, frozen=True, kw_only=True):
    """Force profile of a scripted press *(assumed)*.

    A warm object approaches from `approach_m` in `approach_s`; its force rises for `rise_s`, holds for
    `hold_s` and falls in `release_s`; then it withdraws as it came. The force is modulated by the fraction
    `modulation` at `modulation_hz`. One of the three force cells receives all of it, the others less by up to
    the fraction `force_spread`.
    """

    approach_m: Positive = 0.08
    """Distance from which the object approaches."""
    approach_s: Positive = 0.3
    """Duration of the approach, and of the withdrawal."""
    rise_s: Positive = 0.15
    """Rise time of the force."""
    hold_s: NonNegative = 1.0
    """Duration of the full force."""
    release_s: Positive = 0.15
    """Fall time of the force."""
    modulation: Fraction = 0.1
    """Relative amplitude of the modulation of the force."""
    modulation_hz: NonNegative = 2.0
    """Frequency of the modulation."""
    force_spread: Fraction = 0.5
    """Largest fraction of the force that a force cell may lack."""
    temperature_c: float = 33.0
    """Temperature of the object."""

    @property
    def duration_ns(self) -> int:
        """Duration from the start of the approach to the end of the withdrawal [ns]."""
        return sum(map(ns_of_s, (self.approach_s, self.rise_s, self.hold_s, self.release_s, self.approach_s)))


class RandomPressSpec(ForceProfile, frozen=True, kw_only=True):
    """Random presses on the fraction `stimulated_fraction` of the cells *(assumed)*.

    The force of each press on its most loaded force cell is drawn from `force_n`. Presses repeat after
    `pause_s`; with `repeat = false` each cell is pressed once, as in a hug. First presses are spread over
    `onset_spread_s` from `start_s` on, or over a whole period without it, so that they do not coincide.
    """

    force_n: tuple[Positive, Positive] = (0.8, 3.0)
    """Smallest and largest force on the most loaded force cell."""
    start_s: NonNegative = 0.5
    """Earliest start of a first press."""
    pause_s: NonNegative = 1.0
    """Pause between two presses on a cell."""
    repeat: bool = True
    """Press each cell again and again, instead of once."""
    onset_spread_s: NonNegative | None = None
    """Interval over which first presses are spread; a whole period unless given."""

    @property
    def period_ns(self) -> int:
        """Period of the presses on a cell [ns]."""
        return self.duration_ns + ns_of_s(self.pause_s)


class ScriptedPressSpec(ForceProfile, frozen=True, kw_only=True):
    """Press on several cells at once, at `start_s` and then with period `period_s`, or once without it."""

    cells: Annotated[tuple[CellPattern, ...], Meta(min_length=1)]
    """Cells that are pressed at once."""
    start_s: NonNegative
    """Start of the first approach."""
    force_n: Positive
    """Force on the most loaded force cell of each cell."""
    period_s: Positive | None = None
    """Period of the presses; a single press unless given."""
    modulation: Fraction = 0.0
    force_spread: Fraction = 0.0


class ScriptedStimuliSpec(Table, frozen=True, kw_only=True):
    """Scripted stimuli instead of physics: joints follow their commands exactly, contact is prescribed.

    Accelerometers measure gravity and motion as given by the model's kinematics. Cells that the script does
    not press have no contact. The teacher's finger is inactive.
    """

    stimulated_fraction: Fraction = 0.0
    """Fraction of the cells that are pressed as in `random_presses`, drawn by seed and cell name."""
    random_presses: RandomPressSpec = field(default_factory=RandomPressSpec)
    """Random presses on the stimulated cells."""
    presses: tuple[ScriptedPressSpec, ...] = ()
    """Presses on given cells at given times."""

    def pressed_cells(self, index: int, cells_per_patch: Mapping[str, int]) -> list[tuple[str, int]]:
        """List the cells pressed by press `index`, each once, in the order of the patches.

        Args:
            index: Index in `presses`.
            cells_per_patch: Number of cells of every patch.

        Raises:
            DeploymentError: a pattern names a patch or a cell that does not exist.
        """
        found = {
            cell
            for pattern in self.presses[index].cells
            for cell in match_cells(f"scripted_stimuli.presses[{index}].cells", pattern, cells_per_patch)
        }
        return [
            (patch, cell)
            for patch, n in cells_per_patch.items()
            for cell in range(n)
            if (patch, cell) in found
        ]
