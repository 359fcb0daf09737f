"""Speed of the k-epsilon solver, and its CPU time to its own steady state, beside OpenFOAM if that is installed."""

import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measurement import Row, rates
from benchmarks.openfoam_case import read_field, solve_step
from warp_immersed.charts.flow_cases import backward_step, centers, cube_in_wind, reattachment
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.frame_stepper import available_threads
from warp_immersed.k_epsilon import KEpsilonSolver

CELLS_PER_HEIGHT = 16


def rows(quick: bool) -> Iterator[Row]:
    """Cell-steps per CPU second on a step and a cube; CPU seconds after which velocity stays within 1 % (relative L2) and k
    within 2 % (relative L1) of the solver's own converged fields."""
    for name, setup in (("backward-facing step", backward_step(CELLS_PER_HEIGHT)), ("cube in the wind", cube_in_wind(8))):
        for threads in (1, available_threads()):
            solver = KEpsilonSolver(setup, threads=threads)
            solver.step(3)

            def block(solver: KEpsilonSolver = solver, cells: int = setup.fluid_cells) -> float:
                solver.step(5)
                return 5.0 * cells

            found = rates(block, 1.0 if quick else 4.0)
            yield {"what": "bake", "flow": name, "cells": setup.fluid_cells, "threads": threads, "unit": "cell-steps", **found}
    if quick:
        return
    ours, at = own_steady_time(backward_step(CELLS_PER_HEIGHT))
    yield {"what": "bake to steady", "solver": "warp_immersed", "cpu_s": round(ours, 2), "reattachment": round(at, 3)}
    if shutil.which("simpleFoam") is None:
        yield {"what": "bake to steady", "solver": "OpenFOAM", "skipped": "simpleFoam is not installed"}
        return
    theirs = openfoam_steady_time(CELLS_PER_HEIGHT)
    yield {"what": "bake to steady", "solver": "OpenFOAM", "cpu_s": round(theirs, 2), "over_ours": round(theirs / ours, 2)}


def distance(velocity: Any, k: Any, end: Any) -> tuple[float, float]:
    """Relative L2 of velocity and L1 of k to the end state."""
    return np.linalg.norm(velocity - end[0]) / np.linalg.norm(end[0]), np.abs(k - end[1]).sum() / end[1].sum()


def own_steady_time(setup: FlowSetup, interval: int = 10) -> tuple[float, float]:
    """CPU seconds of this solver to its steady state, and where the flow reattaches [H]."""
    fluid = setup.fluid_mask()
    solver = KEpsilonSolver(setup, threads=1)
    solver.solve(3000)
    fields = solver.fields()
    end = fields["velocity"][fluid], fields["k"][fluid]
    at = reattachment(fields["velocity"], centers(setup, 0))
    solver = KEpsilonSolver(setup, threads=1)
    solver.step(0)
    spent = 0.0
    while True:
        start = time.process_time()
        solver.step(interval)
        spent += time.process_time() - start
        fields = solver.fields()
        u, k = distance(fields["velocity"][fluid], fields["k"][fluid], end)
        if u < 0.01 and k < 0.02:
            return spent, at


def openfoam_steady_time(cells_per_height: int, iterations: int = 1500, interval: int = 25) -> float:
    """CPU seconds of OpenFOAM to its steady state."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = solve_step(Path(folder) / "plain", cells_per_height, 100, 1000) / 100
        case = Path(folder) / "sampled"
        solve_step(case, cells_per_height, iterations, interval)
        end = read_field(case, iterations, "U"), read_field(case, iterations, "k")
        for iteration in range(interval, iterations + 1, interval):
            u, k = distance(read_field(case, iteration, "U"), read_field(case, iteration, "k"), end)
            if u < 0.01 and k < 0.02:
                return iteration * seconds
    return float("nan")
