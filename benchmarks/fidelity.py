"""Errors of the cheaper levels against the full model, and whether the bounds in warp_immersed/fidelity.py hold.

    python benchmarks/fidelity.py [--quick] [--bodies leaf,coin]

Bodies fall in still fluid and in turbulence of 0.1 to 3 times their fall speed with eddies 20 and 200 times their size. For
each level: error of the mean descent and of the rms horizontal path against `quasi_steady`, relative to the larger of that and
the fall, and the bound of both.
"""

import argparse
import os
import platform
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_immersed import library
from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import BodyModel, body_model, without_lift
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import Emission, random_rotations
from warp_immersed.ensemble import Ensemble
from warp_immersed.errors import InputError
from warp_immersed.fidelity import Behaviour, Level, drift_error, lift_error, point_error
from warp_immersed.fluid import AIR, WATER
from warp_immersed.level_choice import Scale, behaviour
from warp_immersed.pilot import calibrated, pilot_fall
from warp_immersed.turbulence import STILL, HomogeneousTurbulence, lagrangian_time_scale

GRAVITY = 9.81
BODIES = {
    "leaf": (library.maple_leaf, AIR),
    "paper disk": (lambda: library.disk(0.04, 1e-4, 800.0), AIR),
    "confetti": (lambda: library.rectangular_paper(0.02, 0.006, 1e-4, 700.0), AIR),
    "snow 3 mm": (lambda: library.disk(0.003, 1e-4, 300.0), AIR),
    "flake 1 mm": (lambda: library.disk(0.001, 5e-5, 300.0), AIR),
    "ash 0.3 mm": (lambda: library.disk(0.0003, 3e-5, 500.0), AIR),
    "hail": (lambda: library.sphere(0.002, 900.0), AIR),
    "coin": (lambda: library.disk(0.02, 1.5e-3, 8000.0), WATER),
    "ball": (lambda: library.sphere(0.003, 1200.0), WATER),
    "pebble": (lambda: library.ellipsoid((0.012, 0.010, 0.008), 2500.0), WATER),
    "bean": (lambda: library.ellipsoid((0.04, 0.02, 0.01), 1100.0), WATER),
    "rod": (lambda: library.ellipsoid((0.04, 0.01, 0.01), 1500.0), WATER),
}
QUICK = ("paper disk", "flake 1 mm", "ball")
CHEAPER: tuple[Level, ...] = ("kirchhoff", "point", "drift")
FRAMES, BEGIN = 101, 30


@dataclass(frozen=True)
class Errors:
    """Relative errors of the mean descent and of the horizontal path."""

    descent: float
    spread: float

    @property
    def largest(self) -> float:
        return max(abs(self.descent), abs(self.spread))


def statistics(model: BodyModel, level: Level, surroundings: Surroundings, duration: float, count: int) -> np.ndarray:
    """Mean descent and rms horizontal path over time (2,) [m/s] of bodies released at rest."""
    zero = np.zeros((count, 3))
    start = Emission(zero, random_rotations(np.random.default_rng(1).random((count, 3))), zero, zero, np.zeros(count))
    ensemble = Ensemble([Group(model, start, 1, level)], surroundings, (FRAMES - 1) / duration, "cpu")
    begin = zero
    for frame in ensemble.frames(FRAMES):
        if frame.index == BEGIN:
            begin = frame.positions.copy()
    ensemble.close()
    path = (frame.positions - begin) / (duration * (1.0 - BEGIN / (FRAMES - 1)))
    down = -np.sign(model.net_weight)
    return np.array([down * path[:, 1].mean(), path[:, [0, 2]].std()])


def bound(level: Level, body: Behaviour) -> float:
    """What fidelity.py says of a level's error."""
    if level == "kirchhoff":
        return lift_error(body)
    return point_error(body) + (drift_error(body) if level == "drift" else 0.0)


def compare(name: str, wind: float, eddies: float, count: int) -> list[tuple[str, Errors, float]]:
    """Errors and bounds of the cheaper levels for a body in turbulence of `wind` fall speeds rms, its eddies that many sizes."""
    make, fluid = BODIES[name]
    shape = make()
    model = body_model(shape, fluid, kirchhoff_tensor(shape, fluid), GRAVITY)
    fall = pilot_fall(model, fluid, GRAVITY)
    model = calibrated(model, fall, wind)
    k = 1.5 * (wind * fall.speed) ** 2
    turbulence = HomogeneousTurbulence(k, k**1.5 / (eddies * model.eddy_size)) if wind > 0.0 else STILL
    surroundings = Surroundings(fluid, gravity=(0.0, -GRAVITY, 0.0), turbulence=turbulence)
    relaxation = fall.speed * model.point.inertia / (abs(model.net_weight) * GRAVITY)
    memory = lagrangian_time_scale(turbulence, fluid)
    duration = max(40.0 * model.eddy_size / fall.speed, 10.0 * relaxation, 4.0 * memory)
    body = behaviour(shape, model, surroundings, fall, Scale(0.0, duration))
    full = statistics(model, "quasi_steady", surroundings, duration, count)
    scale = np.maximum(full, fall.speed)
    rows = []
    for level in CHEAPER:
        cheap = without_lift(model, GRAVITY) if level == "kirchhoff" else model
        errors = (statistics(cheap, level, surroundings, duration, count) - full) / scale
        rows.append((level, Errors(*(float(error) for error in errors)), bound(level, body)))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="three bodies, 200 of each; a minute instead of an hour")
    parser.add_argument("--bodies", help=f"some of: {', '.join(BODIES)}")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    count = 200 if options.quick else 1000
    names = options.bodies.split(",") if options.bodies else QUICK if options.quick else BODIES
    # counting noise of an rms over `count` bodies and two axes, in both runs
    noise = 4.0 * np.sqrt(2.0 / (4.0 * count))
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Warp {wp.__version__}"
    print(f"{machine}; {count} bodies, noise {noise:.2f}")
    print(f"{'body':12} {'u/V':>4} {'eddies':>6}  {'level':10} {'descent':>8} {'spread':>8}  bound")
    checked = kept = 0
    for name in names:
        for wind in (0.0, 0.3, 3.0) if options.quick else (0.0, 0.1, 0.3, 1.0, 3.0):
            for eddies in (20.0, 200.0) if wind > 0.0 and not options.quick else (20.0,):
                try:
                    rows = compare(name, wind, eddies, count)
                except InputError as problem:
                    print(f"{name:12} {wind:4.1f} {eddies:6.0f}  left out: {problem}", flush=True)
                    continue
                for level, errors, limit in rows:
                    holds = errors.largest <= limit + noise
                    checked, kept = checked + 1, kept + holds
                    print(
                        f"{name:12} {wind:4.1f} {eddies:6.0f}  {level:10} {errors.descent:+8.2f} {errors.spread:+8.2f} "
                        f"{limit:6.2f} {'' if holds else 'EXCEEDED'}",
                        flush=True,
                    )
    print(f"{kept} of {checked} bounds hold within the noise")


if __name__ == "__main__":
    main()
