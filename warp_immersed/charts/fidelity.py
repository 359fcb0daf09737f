"""Cost against error of the levels of fidelity on the built-in scenes, and what `auto` chose."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.figures import Report, Request, publish
from warp_immersed.errors import InputError
from warp_immersed.fidelity import LEVELS, Level
from warp_immersed.kernels.rigid_body import MOVING
from warp_immersed.scene import Scene, builtin_scenes
from warp_immersed.simulation import ensemble_of, plan

Array = NDArray[np.float64]

COLORS = ("#76b7b2", "#59a14f", "#4e79a7", "#d62728", "#b07aa1")
FINE = 8  # the reference has this many times the frames


def measure(quick: bool, report: Report) -> list[dict[str, Any]]:
    """Rows: scene, level, body, how many of it the whole scene has, whether `auto` gives the body that level, errors of the mean
    fall (relative to it) and of the sideways spread (relative to the larger of it and the fall) against the fullest level
    at 8 times the frame rate, the standard error of the fall (all nan where the level refuses the scene), and the scene's
    cost [us of one core per body-second]."""
    scenes = [Scene.load(name) for name in sorted(builtin_scenes())]
    if quick:  # without those whose wind would have to be baked
        scenes = [scene for scene in scenes if scene.turbulence is None or scene.turbulence.kind != "grid"]
    bodies, seconds = (150, 2.0) if quick else (600, 6.0)
    rows = []
    for n, full in enumerate(scenes):
        report(full.name, n / len(scenes))
        scene = full.changed(count_scale=min(1.0, bodies * len(full.bodies) / full.body_count))
        chosen = {kind.table.name: kind.level for kind in plan(scene).kinds}
        counts = {table.name: table.count for table in full.bodies}
        fine = scene.model_copy(update={"fps": FINE * scene.fps})
        expected = next(found for level in reversed(LEVELS) if (found := averages(fine, level, seconds)))[0]
        for level in LEVELS:
            measured = averages(scene, level, seconds)
            for body, (true_fall, true_spread, true_error) in expected.items():
                fall, spread, error = measured[0][body] if measured else (np.nan, np.nan, np.nan)
                rows.append({
                    "scene": scene.name, "level": level, "body": body, "bodies": counts[body], "auto": int(chosen[body] == level),
                    "fall_error": abs(fall - true_fall) / max(abs(true_fall), 1e-9),
                    "spread_error": abs(spread - true_spread) / max(true_spread, abs(true_fall), 1e-9),
                    "standard_error": float(np.hypot(error, true_error)) / max(abs(true_fall), 1e-9),
                    "us_per_body_second": 1e6 * measured[1] if measured else np.nan,
                })  # fmt: skip
    return rows


Averages = tuple[dict[str, tuple[float, float, float]], float]


def averages(scene: Scene, level: Level, seconds: float) -> Averages | None:
    """Of every kind at one level: mean fall [m/s] of bodies in flight, rms over them of how far they stray sideways from their
    mean [m/s], and the standard error of the fall; and core seconds per second of one body in flight. None where the level
    refuses the scene."""
    fps = scene.fps
    try:
        planned = plan(scene.changed(fidelity=level).model_copy(update={"fps": fps}))
        ensemble = ensemble_of(planned, "cpu", threads=1)
    except InputError:
        return None
    frames = ensemble.frames(round(seconds * fps) + 1)
    start = next(frames).positions.copy()
    last, falls, count = start.copy(), np.zeros(len(start)), np.zeros(len(start))
    began = time.process_time()
    for frame in frames:
        moving = frame.state == MOVING
        falls[moving] -= frame.velocities[moving, 1]
        last[moving] = frame.positions[moving]
        count += moving
    spent = time.process_time() - began
    ensemble.close()
    found, begin = {}, 0
    for kind in planned.kinds:
        mine = slice(begin, begin + kind.table.count)
        begin = mine.stop
        seen = count[mine] > 0
        fall = falls[mine][seen] / count[mine][seen]
        away = (last - start)[mine][seen][:, [0, 2]] / (count[mine][seen, None] / fps)
        spread = float(np.sqrt(((away - away.mean(axis=0)) ** 2).sum(axis=1).mean()))
        found[kind.table.name] = (float(fall.mean()), spread, float(fall.std() / np.sqrt(max(seen.sum(), 1))))
    return found, spent / (count.sum() / fps)


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: cost against error, a line a scene, a colour a level, rings where `auto` goes."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(9.6, 5.4), layout="constrained")
    axis = figure.subplots()
    for scene in dict.fromkeys(row["scene"] for row in rows):
        points = []
        for level, color in zip(LEVELS, COLORS, strict=False):
            mine = [row for row in rows if row["scene"] == scene and row["level"] == level and np.isfinite(row["fall_error"])]
            if not mine:
                continue
            at = (mine[0]["us_per_body_second"], max(worst(mine), 1e-3))
            points.append(at)
            noise = max(row["standard_error"] for row in mine)
            axis.plot([at[0], at[0]], [max(at[1] - noise, 1e-3), at[1] + noise], color=color, linewidth=1.0, alpha=0.5)
            axis.plot(*at, "o", color=color, markersize=7, zorder=3)
            if any(row["auto"] for row in mine):
                axis.plot(*at, "o", color="black", markersize=12, markerfacecolor="none", zorder=4)
        if points:
            axis.plot(*np.array(points).T, color="0.8", linewidth=0.8, zorder=1)
            axis.annotate(scene, points[-1], xytext=(8, 0), textcoords="offset points", fontsize=7.5, color="0.3", va="center")
    axis.set(xscale="log", yscale="log", xlabel="one core's time for a second of one body in flight, µs")
    axis.set_ylabel("error of mean fall or sideways spread, the larger")
    keys: list[Any] = [
        Line2D([], [], color=color, marker="o", linestyle="", label=level) for level, color in zip(LEVELS, COLORS, strict=False)
    ]
    keys.append(
        Line2D([], [], color="black", marker="o", markerfacecolor="none", markersize=11, linestyle="", label="chosen by auto")
    )
    axis.legend(handles=keys, fontsize=8.5, loc="lower left")
    axis.grid(alpha=0.25)
    axis.margins(x=0.2)
    axis.set_title("Fidelity on the built-in scenes: auto (rings) takes the cheapest level that is right (bars: standard error)")
    return figure


def worst(rows: Sequence[dict[str, Any]]) -> float:
    """The larger of the two errors, over the bodies of one scene at one level."""
    return float(np.max([max(row["fall_error"], row["spread_error"]) for row in rows]))


def chart(request: Request) -> str:
    """Run every built-in scene at every level, draw the figure, and write both."""
    rows = measure(request.quick, request.report)
    publish(request, lambda: draw(rows), rows)
    words = []
    for level in LEVELS:
        mine = [row for row in rows if row["level"] == level and np.isfinite(row["fall_error"])]
        if mine:
            cost, error = np.median([row["us_per_body_second"] for row in mine]), np.median([row["fall_error"] for row in mine])
            words.append(f"{level} {cost:.3g} µs and {100 * error:.2g} %")
    return f"Median cost of a body-second and error of the fall: {', '.join(words)}. {auto_saves(rows)}"


def auto_saves(rows: Sequence[dict[str, Any]]) -> str:
    """How much less `auto` costs than the fullest level, over all scenes with all their bodies, and what that does to falls."""

    def cost(some: Sequence[dict[str, Any]]) -> float:
        return sum(row["bodies"] * row["us_per_body_second"] for row in some if np.isfinite(row["us_per_body_second"]))

    chosen = [row for row in rows if row["auto"]]
    full = [row for row in rows if row["level"] == LEVELS[-1]]
    cheaper = [row for row in chosen if row["level"] != LEVELS[-1] and np.isfinite(row["fall_error"])]
    worst_error = worst(cheaper) if cheaper else 0.0
    saved = cost(full) / cost(chosen)
    return (
        f"Over all scenes with all their bodies auto costs {saved:.3g} times less than {LEVELS[-1]} throughout; "
        f"where it takes less, falls and spreads are within {100 * worst_error:.2g} %."
    )
