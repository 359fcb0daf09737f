"""The ladder of body models: how much of the physics a body is given, and the choice of the cheapest level that will do.

The errors below are bounds on what was measured over leaves, paper, confetti, snow, ash, coins, spheres and ellipsoids in
turbulence of 0 to 3 times their fall speed, in eddies 20 and 200 times their size (`benchmarks/fidelity.py`): error of the mean
descent and of the horizontal spread against the full model, relative to the larger of that and the fall.
"""

from dataclasses import dataclass
from math import inf, sqrt
from typing import Literal, get_args

# What a scene may ask for, from the cheapest to the fullest, and what "auto" picks for every body.
Level = Literal["drift", "point", "kirchhoff", "quasi_steady"]
Fidelity = Literal["auto", "drift", "point", "kirchhoff", "quasi_steady"]
LEVELS: tuple[Level, ...] = get_args(Level)

DEFAULT_TOLERANCE = 0.2
# A body smaller than this in a picture shows no attitude.
ATTITUDE_PIXELS = 3.0
# Bodies with nearly equal axes look and fall alike from all sides.
ROUND = 0.15
# Plates below this Reynolds number fall flat and steadily (Field et al., Nature 388 (1997) 252); above, they swing.
STEADY_REYNOLDS = 100.0
# Below this one bodies keep the attitude they have, and drag is linear: a point needs no calibration.
CREEPING_REYNOLDS = 0.1


@dataclass(frozen=True)
class Behaviour:
    """What decides how much of a body's physics shows.

    flatness: 1 for a plate, 0 for a sphere; roundness: shortest over longest axis; reynolds: of its fall; wind: rms of the seen
    fluctuation over the fall speed; stokes: fall speed over gravity, over the time scale of the seen wind; glide:
    sideways over fall speed in still fluid; start: time to reach the fall speed over the length of the scene; pixels: its
    size in most pictures, infinite if unknown.
    """

    flatness: float
    roundness: float
    reynolds: float
    wind: float
    stokes: float
    glide: float
    start: float
    pixels: float = inf

    @property
    def attitude_shows(self) -> bool:
        """Whether one sees how the body is turned."""
        return self.roundness < 1.0 - ROUND and self.pixels >= ATTITUDE_PIXELS


@dataclass(frozen=True)
class Choice:
    """A level, its expected relative error, and why no cheaper one."""

    level: Level
    error: float
    reason: str


def choose(body: Behaviour, tolerance: float) -> Choice:
    """The cheapest level whose error is within the tolerance."""
    if body.attitude_shows:
        error = lift_error(body)
        if error <= tolerance:
            return Choice("kirchhoff", error, "its attitude shows, lift is weak")
        return Choice("quasi_steady", 0.0, f"without lift its fall could be {100 * error:.0f} % off")
    unseen = "round" if body.roundness >= 1.0 - ROUND else f"{body.pixels:.1f} pixels large"
    point, drift = point_error(body), drift_error(body)
    if point + drift <= tolerance:
        return Choice("drift", point + drift, f"{unseen}, follows the wind at once")
    if point <= tolerance:
        return Choice("point", point, f"{unseen}; without inertia it could be {100 * drift:.0f} % off")
    if lift_error(body) <= tolerance:
        return Choice("kirchhoff", lift_error(body), f"as a point it could be {100 * point:.0f} % off")
    return Choice("quasi_steady", 0.0, f"as a point it could be {100 * point:.0f} % off")


def swings(body: Behaviour) -> float:
    """0 for bodies that fall steadily, 1 for plates that swing."""
    return body.flatness / (1.0 + (STEADY_REYNOLDS / max(body.reynolds, 1e-9)) ** 3)


def lift_error(body: Behaviour) -> float:
    """Error of `kirchhoff` against the full model: plates that swing do not glide without lift."""
    return (0.65 * swings(body) + 0.1 * body.flatness) * (1.0 + 0.6 * body.wind)


def point_error(body: Behaviour) -> float:
    """Error of `point`: shaken bodies that are not round fall otherwise; a glide keeps its heading, which the wind ought to
    change, and does not slow down in gusts that are faster than it follows."""
    descent = (1.0 - body.roundness) * (0.03 + 0.2 * min(1.3, body.wind))
    heading = 0.6 * body.glide * min(1.0, 10.0 * body.wind) / (1.0 + 2.5 * body.wind)
    gusts = 0.5 * body.glide * body.wind * min(1.0, body.stokes)
    return max(descent, heading + gusts)


def drift_error(body: Behaviour) -> float:
    """Error of `drift` against `point`: drag that grows faster than the speed slows a shaken fall, inertia calms it, and it
    takes its time to start."""
    shaken = body.wind**2 * body.stokes / (1.0 + body.stokes) if body.stokes < inf else body.wind**2
    speed = (sqrt(1.0 + min(body.stokes, 100.0)) - 1.0) * body.wind / sqrt(1.0 + body.wind**2)
    return max(shaken / (shaken + 1.5), speed, body.start)
