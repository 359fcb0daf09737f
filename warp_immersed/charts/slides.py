"""The cost table of Xie & Miyata's slides beside the same bodies here."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

from warp_immersed import library
from warp_immersed.body_model import BodyModel
from warp_immersed.charts.bodies import model_in
from warp_immersed.charts.body_rates import started
from warp_immersed.charts.figures import Report, Request, publish
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.ensemble import Ensemble
from warp_immersed.fluid import AIR, WATER, Fluid
from warp_immersed.shape import Shape
from warp_immersed.sheet_mesh import ellipse_mesh
from warp_immersed.turbulence import HomogeneousTurbulence

# Body, faces, step [ms], average cost of a step [ms] on an Intel Core i7 of 3.2 GHz (the slides' table).
PRINTED = (
    ("ellipsoid 1", 320, 1.0, 1.59),
    ("ellipsoid 1", 320, 5.0, 1.63),
    ("ellipsoid 1", 320, 10.0, 1.65),
    ("ellipsoid 2", 1280, 5.0, 1.71),
    ("piece of paper", 1024, 5.0, 1.73),
    ("paper airplane", 288, 5.0, 1.86),
)
CROWD = 1000
GUSTS = HomogeneousTurbulence(0.05, 0.02)


def make_body(name: str, faces: int) -> tuple[Shape, Fluid]:
    """A mesh of the slides' kind with about as many faces, and the fluid they show it in."""
    if name.startswith("ellipsoid"):
        ball = trimesh.creation.icosphere(2 if faces == 320 else 3)
        return Shape.from_mesh(trimesh.Trimesh(ball.vertices * [0.04, 0.02, 0.01], ball.faces), 1100.0), WATER
    if name == "piece of paper":
        counts = [abs(len(ellipse_mesh(0.02, 0.005, rings).faces) - faces) for rings in range(4, 40)]
        return Shape.from_mesh(ellipse_mesh(0.02, 0.005, 4 + int(np.argmin(counts))), 800.0, 1e-4), AIR
    return library.paper_airplane(), AIR


def measure(quick: bool, report: Report) -> list[dict[str, Any]]:
    """Rows: body, the slides' faces and ours, step [ms], the slides' cost [ms per step], ours of one body alone and of one in a
    crowd of 1000 [ms of one core's time per step], and substeps a step."""
    rows = []
    models: dict[tuple[str, int], tuple[BodyModel, Fluid, int]] = {}
    for index, (name, faces, step, printed) in enumerate(PRINTED):
        report(f"{name}, {faces} faces, {step:g} ms", index / len(PRINTED))
        if (name, faces) not in models:
            shape, fluid = make_body(name, faces)
            models[name, faces] = model_in(shape, fluid), fluid, len(shape.mesh.faces)
        model, fluid, ours = models[name, faces]
        alone, substeps = step_cost(model, fluid, step, 1, 100 if quick else 500)
        crowd, _ = step_cost(model, fluid, step, CROWD, 20 if quick else 100)
        rows.append({
            "body": name, "faces_slides": faces, "faces_here": ours, "step_ms": step, "slides_ms": printed,
            "alone_ms": 1e3 * alone, "crowd_ms": 1e3 * crowd / CROWD, "substeps": substeps,
        })  # fmt: skip
    return rows


def step_cost(model: BodyModel, fluid: Fluid, step: float, count: int, frames: int) -> tuple[float, float]:
    """Seconds of one core's time a frame of `step` [ms] takes, Python and the hand-over of every frame included, best of five
    blocks; and substeps a body takes in it."""
    ensemble = Ensemble([Group(model, started(count, 3), 1)], Surroundings(fluid, turbulence=GUSTS), 1e3 / step, threads=1)
    best, done, substeps = np.inf, 0, 0.0
    for _ in range(6):
        start = time.process_time()
        for frame in ensemble.frames(frames):
            steps = frame.body_steps
        best = min(best, (time.process_time() - start) / frames)
        substeps, done = (steps - done) / frames / count, steps
    ensemble.close()
    return best, substeps


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: bars of the cost of one step, slides, one body here, one body of a thousand here."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 4.6), layout="constrained")
    axis = figure.subplots()
    at = np.arange(len(rows))
    bars = (
        ("slides: one body on a Core i7, 3.2 GHz", "slides_ms", "#9c755f"),
        ("here: one body alone, one core, with the trip to Python and back", "alone_ms", "#76b7b2"),
        ("here: one body of 1,000, one core", "crowd_ms", "#d62728"),
    )
    for n, (label, key, color) in enumerate(bars):
        values = [1e3 * row[key] for row in rows]
        drawn = axis.bar(at + 0.27 * (n - 1), values, 0.26, label=label, color=color)
        axis.bar_label(drawn, [f"{value:,.0f}" if value > 10.0 else f"{value:.2g}" for value in values], fontsize=7.5, padding=1)
    axis.set_yscale("log")
    axis.set_ylim(0.1, 4e4)
    axis.set_xticks(at, [f"{row['body']}\n{row['faces_slides']} faces, {row['step_ms']:g} ms" for row in rows], fontsize=8.5)
    axis.set_ylabel("time of one step of one body, µs")
    axis.legend(fontsize=8.5, loc="upper right", ncols=1)
    ratio = np.median([row["slides_ms"] / row["crowd_ms"] for row in rows])
    axis.set_title(f"The slides' own table: a step costs {ratio:,.0f} times less here, turbulence and loads included")
    return figure


def chart(request: Request) -> str:
    """Time the slides' bodies, draw the figure, and write both."""
    rows = measure(request.quick, request.report)
    publish(request, lambda: draw(rows), rows)
    ratios = [row["slides_ms"] / row["crowd_ms"] for row in rows]
    costs = [1e3 * row["crowd_ms"] for row in rows]
    return (
        f"A step of the slides' bodies costs {min(costs):.2g} to {max(costs):.2g} µs of one core here, {min(ratios):,.0f} to "
        f"{max(ratios):,.0f} times less."
    )
