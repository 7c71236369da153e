"""Validation of a cell's encoder settings: thresholds of levels, hysteresis and deltas by modality.

Force and proximity have levels; every modality has a delta.
"""

import math
from collections.abc import Iterable
from itertools import pairwise

from skinnet.protocol.level_crossing import MAX_LEVELS
from skinnet.protocol.messages import Modality

__all__ = [
    "DELTA_MODALITIES",
    "LEVEL_MODALITIES",
    "validated_deltas",
    "validated_hysteresis",
    "validated_levels",
]

DELTA_MODALITIES = tuple(modality.name.lower() for modality in Modality)
"""Modalities that have a delta, in the order of `Modality`."""
LEVEL_MODALITIES = DELTA_MODALITIES[:2]
"""Modalities that have levels."""


def validated_levels(levels: dict[str, list[float]]) -> dict[str, list[float]]:
    """Validate thresholds by modality; return them ascending, padded with inf to `MAX_LEVELS`.

    Raises:
        ValueError: a modality without levels, too many thresholds, or thresholds that do not ascend.
    """
    _check_names("levels", levels, LEVEL_MODALITIES)
    for name, thresholds in levels.items():
        rising = all(low < high for low, high in pairwise(thresholds))
        if not (rising and len(thresholds) <= MAX_LEVELS and all(map(math.isfinite, thresholds))):
            raise ValueError(
                f"levels.{name} = {thresholds}: needs at most {MAX_LEVELS} finite thresholds that ascend"
            )
    return {
        name: thresholds + [math.inf] * (MAX_LEVELS - len(thresholds)) for name, thresholds in levels.items()
    }


def validated_hysteresis(hysteresis: dict[str, float]) -> dict[str, float]:
    """Validate the hysteresis by modality: the margin below a threshold at which its level is left.

    Raises:
        ValueError: a modality without levels, or a value that is negative or not finite.
    """
    _check_names("hysteresis", hysteresis, LEVEL_MODALITIES)
    for name, margin in hysteresis.items():
        if not (math.isfinite(margin) and margin >= 0.0):
            raise ValueError(f"hysteresis.{name} = {margin}: needs a finite value of zero or more")
    return hysteresis


def validated_deltas(deltas: dict[str, float]) -> dict[str, float]:
    """Validate the deltas by modality: the change of a reading above which it is sent.

    Raises:
        ValueError: an unknown modality, or a value that is not positive and finite.
    """
    _check_names("deltas", deltas, DELTA_MODALITIES)
    for name, delta in deltas.items():
        if not (math.isfinite(delta) and delta > 0.0):
            raise ValueError(f"deltas.{name} = {delta}: needs a finite value above zero")
    return deltas


def _check_names(setting: str, names: Iterable[str], allowed: tuple[str, ...]) -> None:
    for name in names:
        if name not in allowed:
            raise ValueError(
                f"{setting}.{name}: unknown modality, or one without {setting}; use one of {allowed}"
            )
