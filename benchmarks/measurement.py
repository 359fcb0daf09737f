"""What the benchmarks share: timing that stands other work on the machine."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from warp_immersed import library
from warp_immersed.charts.bodies import model_in
from warp_immersed.charts.body_rates import started
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.ensemble import Ensemble
from warp_immersed.fluid import AIR
from warp_immersed.turbulence import HomogeneousTurbulence

Row = dict[str, Any]

GUSTS = HomogeneousTurbulence(0.05, 0.02)
THIN_ELLIPSOID = (0.02, 0.01, 0.0002)  # m
THIN_DENSITY = 800.0  # kg/m^3


def rates(block: Callable[[], float], seconds: float) -> Row:
    """Work per second of CPU time and of wall time: medians over blocks of work, each call of which returns how much it did."""
    cpu, wall, begin = [], [], time.perf_counter()
    while time.perf_counter() - begin < seconds or len(cpu) < 5:
        spent, passed = time.process_time(), time.perf_counter()
        work = block()
        cpu.append(work / max(time.process_time() - spent, 1e-9))
        wall.append(work / (time.perf_counter() - passed))
    return {
        "per_core_s": round(float(np.median(cpu))),
        "best_per_core_s": round(max(cpu)),
        "per_s": round(float(np.median(wall))),
    }


def paired_ratio(ours: Callable[[], float], theirs: Callable[[], float], seconds: float) -> float:
    """Median of our work per CPU second over theirs, block by block in turn, so that both see the same machine."""
    ratios, begin = [], time.perf_counter()
    while time.perf_counter() - begin < seconds or len(ratios) < 7:
        speeds = []
        for block in (ours, theirs):
            spent = time.process_time()
            work = block()
            speeds.append(work / max(time.process_time() - spent, 1e-9))
        ratios.append(speeds[0] / speeds[1])
    return float(np.median(ratios))


def seconds_of(work: Callable[[], Any], times: int = 3) -> float:
    """Wall seconds of the best of some runs."""
    found = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        found.append(time.perf_counter() - start)
    return min(found)


def thin_ellipsoids(count: int, fps: float, device: str = "cpu", threads: int | None = 1) -> Ensemble:
    """Thin ellipsoids of 4 x 2 x 0.04 cm that fall through gusty air, full added mass and noise on."""
    model = model_in(library.ellipsoid(THIN_ELLIPSOID, THIN_DENSITY), AIR)
    surroundings = Surroundings(AIR, turbulence=GUSTS)
    return Ensemble([Group(model, started(count, 1, height=1000.0), 1)], surroundings, fps, device, threads=threads)


def frames_done(ensemble: Ensemble, frames: int) -> Callable[[], float]:
    """A block of work for `rates`: some frames, counted in substeps of all bodies."""
    before = 0

    def block() -> float:
        nonlocal before
        for frame in ensemble.frames(frames):
            done = frame.body_steps
        work, before = done - before, done
        return float(work)

    block()  # from rest to falling, and everything loaded
    return block
