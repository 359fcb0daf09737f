"""Error against time of the k-epsilon precompute over resolution and step, on four flows with known answers."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from warp_immersed.charts.figures import Report, Request, publish
from warp_immersed.charts.flow_cases import (
    STEP_REATTACHMENT,
    backward_step,
    cavity_errors,
    centers,
    decaying_duct,
    exact_decay,
    lid_cavity,
    reattachment,
    taylor_green,
)
from warp_immersed.k_epsilon import KEpsilonSolver

Solve = Callable[[int, float], float]


def decay(cells: int, cfl: float) -> float:
    """Largest relative error of k along a duct in which turbulence decays, against the closed form."""
    solver = KEpsilonSolver(decaying_duct(cells), cfl=cfl, threads=1)
    solver.solve(2000, 1e-5)
    exact, _ = exact_decay(centers(solver.setup, 0), 0.01, 0.01)
    return float(np.abs(solver.fields()["k"][:, 1, 0] / exact - 1.0).max())


def cavity(cells: int, cfl: float) -> float:
    """Largest error of u on the centre line of the lid-driven cavity at Re 100, in lid speeds."""
    solver = KEpsilonSolver(lid_cavity(cells, 100), cfl=cfl, threads=1)
    solver.solve(4000)
    return cavity_errors(solver)[0]


def step(cells: int, cfl: float) -> float:
    """Relative error of the reattachment behind a step against OpenFOAM on 16 cells a height."""
    solver = KEpsilonSolver(backward_step(cells), cfl=cfl, threads=1)
    solver.solve(2500)
    found = reattachment(solver.fields()["velocity"], centers(solver.setup, 0))
    return abs(found / STEP_REATTACHMENT - 1.0)


# Flow: what is solved, its cells in quick and full charts, its CFL numbers, and the error that is asked of the finest.
FLOWS: dict[str, tuple[Solve, tuple[int, ...], tuple[int, ...], tuple[float, ...], float]] = {
    "decay along a duct: k": (decay, (25, 50), (25, 50, 100), (1.0, 10.0), 0.02),
    "Taylor-Green vortex: velocity": (taylor_green, (16, 32), (16, 32, 64, 128), (0.5, 1.0, 2.0), 5.3e-4),
    "lid-driven cavity, Re 100: u": (cavity, (16, 32), (16, 32, 64), (5.0, 10.0), 0.006),
    "backward-facing step: reattachment": (step, (4,), (4, 8, 16), (5.0, 10.0), 0.03),
}


def measure(quick: bool, report: Report) -> list[dict[str, Any]]:
    """Rows: flow, cells (along x, an edge, or a step height), CFL number, error, and seconds of one core."""
    rows = []
    for n, (flow, (solve, few, many, numbers, asked)) in enumerate(FLOWS.items()):
        for cells in few if quick else many:
            for cfl in numbers:
                report(f"{flow}, {cells} cells, CFL {cfl:g}", n / len(FLOWS))
                start = time.process_time()
                error = solve(cells, cfl)
                spent = time.process_time() - start
                rows.append({"flow": flow, "cells": cells, "cfl": cfl, "error": error, "cpu_s": spent, "asked": asked})
    return rows


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: error against time, a panel a flow, a line a CFL number, the points finer and finer."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(12.6, 3.9), layout="constrained")
    axes = figure.subplots(1, len(FLOWS))
    for axis, flow in zip(axes, FLOWS, strict=True):
        mine = [row for row in rows if row["flow"] == flow]
        for color, cfl in zip(("#4e79a7", "#d62728", "#59a14f"), sorted({row["cfl"] for row in mine}), strict=False):
            points = np.array([(row["cpu_s"], row["error"]) for row in mine if row["cfl"] == cfl])
            axis.loglog(*points.T, "o-", color=color, label=f"CFL {cfl:g}", markersize=5)
        last = max(row["cfl"] for row in mine)
        for row in mine:
            if row["cfl"] == last:
                at = (row["cpu_s"], row["error"])
                axis.annotate(f"{row['cells']}", at, xytext=(5, 4), textcoords="offset points", fontsize=8)
        axis.axhline(mine[0]["asked"], color="grey", linewidth=0.8, linestyle="--")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_title(flow.replace(": ", ":\n"), fontsize=9.5)
        axis.set_xlabel("CPU time, s")
        axis.legend(fontsize=7.5)
        axis.grid(alpha=0.25)
    axes[0].set_ylabel("relative error (dashed: asked of the finest)")
    figure.suptitle(
        "Baking the wind: resolution (numbers: cells) buys accuracy, long steps (CFL) cost none of it where the flow is steady"
    )
    return figure


def chart(request: Request) -> str:
    """Solve the flows, draw the figure, and write both."""
    rows = measure(request.quick, request.report)
    publish(request, lambda: draw(rows), rows)
    words = []
    for flow in FLOWS:
        mine = [row for row in rows if row["flow"] == flow]
        best = min(mine, key=lambda row: row["error"])
        words.append(f"{flow.split(':')[0]} {100 * best['error']:.2g} % in {best['cpu_s']:.2g} s")
    return f"Error and core time: {', '.join(words)}."
