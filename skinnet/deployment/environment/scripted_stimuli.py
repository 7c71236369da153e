"""Scripted stimuli spec: force profiles on cells, instead of physics."""

from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta, field

from skinnet.deployment.types import Fraction, NonNegative, Positive, Table, ns_of_s
from skinnet.errors import DeploymentError
from skinnet.suggestions import known_names

__all__ = ["CellPattern", "ForceProfile", "RandomPressSpec", "ScriptedPressSpec", "ScriptedStimuliSpec"]

CellPattern = Annotated[str, Meta(pattern=r"^([A-Za-z0-9_\-]+|\*)/([0-9]+|\*)$")]
"""Pattern of cells: "patch/cell", where * matches any."""


class ForceProfile(Table, frozen=True, kw_only=True):
    """Force profile of a scripted press *(assumed)*.

    A warm object approaches from `approach_m` in `approach_s`; its force rises for `rise_s`, holds for
    `hold_s` and falls in `release_s`; then it withdraws as it came. The force is modulated by the fraction
    `modulation` at `modulation_hz`. One of the three force cells receives all of it, the others less by up to
    the fraction `force_spread`.
    """

    approach_m: Positive = 0.08
    approach_s: Positive = 0.3
    rise_s: Positive = 0.15
    hold_s: NonNegative = 1.0
    release_s: Positive = 0.15
    modulation: Fraction = 0.1
    modulation_hz: NonNegative = 2.0
    force_spread: Fraction = 0.5
    temperature_c: float = 33.0

    @property
    def duration_ns(self) -> int:
        """Duration from the start of the approach to the end of the withdrawal [ns]."""
        return sum(map(ns_of_s, (self.approach_s, self.rise_s, self.hold_s, self.release_s, self.approach_s)))


class RandomPressSpec(ForceProfile, frozen=True, kw_only=True):
    """Random presses on the fraction `scripted_stimuli.stimulated_fraction` of the cells *(assumed)*.

    The force of each press on its most loaded force cell is drawn from `force_n`. Presses repeat after
    `pause_s`; with `repeat = false` each cell is pressed once, as in a hug. First presses are spread over
    `onset_spread_s` from `start_s` on, or over a whole period without it, so that they do not coincide.
    """

    force_n: tuple[Positive, Positive] = (0.8, 3.0)
    start_s: NonNegative = 0.5
    pause_s: NonNegative = 1.0
    repeat: bool = True
    onset_spread_s: NonNegative | None = None

    @property
    def period_ns(self) -> int:
        """Period of the presses on a cell [ns]."""
        return self.duration_ns + ns_of_s(self.pause_s)


class ScriptedPressSpec(ForceProfile, frozen=True, kw_only=True):
    """Press on several cells at once, at `start_s` and then with period `period_s`, or once without it."""

    cells: Annotated[tuple[CellPattern, ...], Meta(min_length=1)]
    start_s: NonNegative
    force_n: Positive
    period_s: Positive | None = None
    modulation: Fraction = 0.0
    force_spread: Fraction = 0.0


class ScriptedStimuliSpec(Table, frozen=True, kw_only=True):
    """Scripted stimuli instead of physics: joints follow their commands exactly, contact is prescribed.

    Accelerometers measure gravity and motion as given by the model's kinematics. Cells that the script does
    not press have no contact. The teacher's finger is inactive.
    """

    stimulated_fraction: Fraction = 0.0
    """Fraction of the cells that are pressed as in `random_presses`; drawn by the seed and cell name."""
    random_presses: RandomPressSpec = field(default_factory=RandomPressSpec)
    presses: tuple[ScriptedPressSpec, ...] = ()

    def check(self, cells_per_patch: Mapping[str, int]) -> None:
        """Check the script against patches of `cells_per_patch` cells.

        Raises:
            DeploymentError: forces, periods or cell patterns are inconsistent.
        """
        low_n, high_n = self.random_presses.force_n
        if low_n > high_n:
            raise DeploymentError(
                f"scripted_stimuli.random_presses.force_n = [{low_n:g}, {high_n:g}]: "
                "the smallest force comes first"
            )
        for index, press in enumerate(self.presses):
            self.pressed_cells(index, cells_per_patch)
            if press.period_s is not None and ns_of_s(press.period_s) < press.duration_ns:
                raise DeploymentError(
                    f"scripted_stimuli.presses[{index}].period_s = {press.period_s:g}: a press takes "
                    f"{press.duration_ns * 1e-9:g} s from approach to withdrawal; at least that"
                )

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
            for cell in _match_cells(pattern, cells_per_patch, index)
        }
        return [
            (patch, cell)
            for patch, n in cells_per_patch.items()
            for cell in range(n)
            if (patch, cell) in found
        ]


def _match_cells(pattern: str, cells_per_patch: Mapping[str, int], index: int) -> list[tuple[str, int]]:
    patch, _, cell = pattern.partition("/")
    key = f"scripted_stimuli.presses[{index}].cells: {pattern!r}"
    if patch != "*" and patch not in cells_per_patch:
        raise DeploymentError(f"{key}: unknown patch; {known_names(patch, cells_per_patch)}")
    patches = list(cells_per_patch) if patch == "*" else [patch]
    if cell == "*":
        return [(name, i) for name in patches for i in range(cells_per_patch[name])]
    found = [(name, int(cell)) for name in patches if int(cell) < cells_per_patch[name]]
    if not found:
        raise DeploymentError(
            f"{key}: {patch} has cells 0 to {max(cells_per_patch[name] for name in patches) - 1}"
        )
    return found
