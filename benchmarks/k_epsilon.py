"""Speed of the k-epsilon solver, and its CPU time to its own steady state, beside OpenFOAM if that is installed.

    python benchmarks/k_epsilon.py [--threads 1] [--cells-per-height 16] [--device cpu] [--skip-openfoam]

Prints cell-steps per second and core, and the CPU time after which velocity stays within 1 % (relative L2) and k within
2 % (relative L1) of the solver's own converged fields. Times are CPU times; on a busy machine they vary by 30 %.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from flow_cases import backward_step, centers, cube_in_wind, reattachment
from openfoam_case import read_field, solve_step

from warp_immersed.k_epsilon import KEpsilonSolver


def speed(name, setup, device, threads, steps=40):
    """Print cell-steps per second."""
    solver = KEpsilonSolver(setup, device, threads=threads)
    solver.step(3)
    wp.synchronize_device(solver.device)
    cpu, wall = time.process_time(), time.perf_counter()
    solver.step(steps)
    wp.synchronize_device(solver.device)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    work = steps * setup.fluid_cells / 1e6
    print(f"{name}: {setup.fluid_cells} cells, {work / wall:.2f} million cell-steps/s, {work / cpu:.2f} per CPU second")


def distance(velocity, k, end):
    """Relative L2 of velocity and L1 of k to the end state."""
    return np.linalg.norm(velocity - end[0]) / np.linalg.norm(end[0]), np.abs(k - end[1]).sum() / end[1].sum()


def own_steady_time(setup, device, interval=10):
    """Print and return the CPU time of this solver to its steady state."""
    fluid = setup.fluid_mask()
    solver = KEpsilonSolver(setup, device, threads=1)
    solver.solve(3000)
    fields = solver.fields()
    end = fields["velocity"][fluid], fields["k"][fluid]
    x = reattachment(fields["velocity"], centers(setup, 0))
    solver = KEpsilonSolver(setup, device, threads=1)
    solver.step(0)
    spent = 0.0
    while True:
        start = time.process_time()
        solver.step(interval)
        wp.synchronize_device(solver.device)
        spent += time.process_time() - start
        fields = solver.fields()
        u, k = distance(fields["velocity"][fluid], fields["k"][fluid], end)
        if u < 0.01 and k < 0.02:
            print(f"warp_immersed: {solver.steps_taken} steps, {spent:.1f} s of CPU, reattachment {x:.3f} H")
            return spent


def openfoam_steady_time(cells_per_height, iterations=1500, interval=25):
    """Print and return the CPU time of OpenFOAM to its steady state."""
    with tempfile.TemporaryDirectory() as folder:
        seconds = solve_step(Path(folder) / "plain", cells_per_height, 100, 1000) / 100
        case = Path(folder) / "sampled"
        solve_step(case, cells_per_height, iterations, interval)
        end = read_field(case, iterations, "U"), read_field(case, iterations, "k")
        for iteration in range(interval, iterations + 1, interval):
            u, k = distance(read_field(case, iteration, "U"), read_field(case, iteration, "k"), end)
            if u < 0.01 and k < 0.02:
                cells = len(end[1])
                rate = cells / seconds / 1e6
                spent = iteration * seconds
                print(f"OpenFOAM: {iteration} iterations, {spent:.1f} s of CPU, {rate:.2f} million cell-iterations/s")
                return spent
    return float("nan")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--cells-per-height", type=int, default=16)
    parser.add_argument("--skip-openfoam", action="store_true")
    given = parser.parse_args()
    step = backward_step(given.cells_per_height)
    speed("backward-facing step", step, given.device, given.threads)
    speed("cube in the wind", cube_in_wind(8), given.device, given.threads)
    ours = own_steady_time(step, given.device)
    if given.skip_openfoam or shutil.which("simpleFoam") is None:
        print("OpenFOAM: not installed or skipped")
        return
    theirs = openfoam_steady_time(given.cells_per_height)
    print(f"CPU time to its own steady state, warp_immersed over OpenFOAM: {ours / theirs:.2f}")


if __name__ == "__main__":
    main()
