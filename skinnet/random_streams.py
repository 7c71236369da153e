"""Named random streams of one seed, with a counter-based generator for hot loops.

Every entity draws from a stream of its own name, so that one more cell, patch or process does not shift the
draws of the others. A value of the counter-based hash depends on (key, counter) only, hence not on chunks,
threads or processes.
"""

import hashlib
import math

import numpy as np

from skinnet import pinned_math
from skinnet.compilation import compiled

__all__ = ["StreamName", "generator", "hash64", "standard_normal", "stream_key", "uniform"]


class StreamName:
    """Names of the random streams, frozen: each is part of every result that was ever published.

    They follow neither identifiers nor deployment keys; whatever is renamed, these literals stay.
    """

    BABBLING = "babble"
    BENCHMARK = "bench"
    BOARD_NETWORK = "boards"
    FAULT = "fault"
    FAULT_BURST = "burst"
    FAULT_PICK = "pick"
    HOME_POSE = "home_pose"
    MODEL_ERROR = "nursing"
    MODEL_ERROR_JOINT = "joint"
    MODEL_ERROR_LINK = "link"
    NETWORK = "network"
    NODE = "node"
    SAMPLING_PHASE = "phase"
    SCRIPTED_STIMULI = "script"
    SENSOR_NOISE = "noise"
    STAND = "stand"
    SWAY = "sway"


def stream_key(seed: int, *names: str | int) -> np.uint64:
    """Return the 64-bit key of the stream `names` under `seed`, the same on every platform."""
    digest = hashlib.sha256(repr((seed, *names)).encode()).digest()
    return np.uint64(int.from_bytes(digest[:8], "little"))


def generator(seed: int, *names: str | int) -> np.random.Generator:
    """Return the NumPy generator of the stream `names` under `seed`, for set-up outside hot loops."""
    return np.random.default_rng(int(stream_key(seed, *names)))


@compiled
def hash64(key: np.uint64, counter: np.uint64) -> np.uint64:
    """Hash (key, counter) to uniform 64 bits: the finaliser of SplitMix64 (Steele et al., 2014), twice."""
    z = key + np.uint64(0x9E3779B97F4A7C15) * (counter + np.uint64(1))
    for _ in range(2):
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return z


@compiled
def uniform(key: np.uint64, counter: np.uint64) -> float:
    """Draw a uniform value in the open interval (0, 1) with 52 random bits (53 could round to 1)."""
    return (float(hash64(key, counter) >> np.uint64(12)) + 0.5) * (1.0 / 4503599627370496.0)


@compiled
def standard_normal(key: np.uint64, counter: np.uint64) -> float:
    """Draw a standard normal value (Box and Muller, 1958) from counters 2 × counter and the next."""
    even = counter * np.uint64(2)
    radius = math.sqrt(-2.0 * pinned_math.log(uniform(key, even)))
    return radius * pinned_math.cos_of_turns(uniform(key, even + np.uint64(1)))
