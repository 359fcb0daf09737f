"""How a body moves, in a word."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

STILL = 1e-4  # m/s
# A body turns over where its spin keeps its direction through most of a turn; slower than QUIET it does not rock either.
ONE_WAY = 0.6
TURN = 0.75 * 2.0 * np.pi  # rad
QUIET = 1.0  # rad/s
UPRIGHT = 0.8


def motion_word(velocities: Array, spins: Array, seconds: float) -> str:
    """What a body does over a while: velocities and angular velocities (W, 3), world axes with y up, [m/s] and [rad/s]."""
    if np.linalg.norm(velocities, axis=1).max() < STILL:
        return "at rest"
    mean = spins.mean(axis=0)
    steady, whole = float(np.linalg.norm(mean)), float(np.sqrt((spins**2).sum(axis=1).mean()))
    if steady > ONE_WAY * whole and steady * seconds > TURN:
        return "autorotating" if abs(mean[1]) > UPRIGHT * steady else "tumbling"
    if whole > QUIET:
        return "fluttering"
    course = velocities.mean(axis=0)
    return "gliding" if np.hypot(course[0], course[2]) > abs(course[1]) else "falling steadily"
