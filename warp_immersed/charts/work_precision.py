"""Cost against error of integrators on six bodies: what the product's choice is worth."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.bodies import EVALUATIONS_PER_SUBSTEP, TestBody, evaluation_cost, run_product, test_bodies
from warp_immersed.charts.body_rates import BodyRates, Q, X, dop853, rotate, started
from warp_immersed.charts.figures import Report, Request, publish
from warp_immersed.charts.integrators import INTEGRATORS, needs_diagonal
from warp_immersed.device_state import Surroundings

Array = NDArray[np.float64]

OURS = "warp_immersed"
STYLE = {
    "explicit Euler": ("#c7a76c", "v"),
    "semi-implicit Euler": ("#9c755f", "^"),
    "RK2": ("#76b7b2", "s"),
    "RK4, fixed step": ("#4e79a7", "o"),
    "Strang splitting": ("#b07aa1", "D"),
    OURS: ("#d62728", "o"),
}
SAMPLES_PER_SECOND = 12
WARM_UP = 1.0  # s before statistics are taken


def measure(quick: bool, report: Report) -> list[dict[str, Any]]:
    """Rows: body, chaotic, integrator, step [ms] (the frame, for the product), cost [us per body-second], error, its standard
    error, and the share of bodies lost."""
    rows: list[dict[str, Any]] = []
    bodies = test_bodies()
    for index, body in enumerate(bodies):
        report(body.name, index / len(bodies))
        rows += measure_statistics(body, quick) if body.chaotic else measure_paths(body, quick)
    return rows


def measure_paths(body: TestBody, quick: bool) -> list[dict[str, Any]]:
    """Median over starts of the distance in lengths plus the angle in radians to the reference after a time."""
    seconds = 0.25 if body.spin[0] > 100.0 else 1.0
    emission = started(8 if quick else 16, 1, body.spin)
    rates = BodyRates([body.model], np.zeros(len(emission.positions), dtype=np.int64))
    start = rates.state(emission)
    reference = dop853(rates, start, np.array([seconds]))[0][0]
    length, cost = body.shape.bounding_radius, evaluation_cost(body.model, body.fluid)

    def error(positions: Array, orientations: Array) -> float:
        away = np.linalg.norm(positions - reference[:, X], axis=1) / length
        cosine = np.abs((orientations * reference[:, Q]).sum(axis=1)) / np.linalg.norm(orientations, axis=1)
        return float(np.median(away + 2.0 * np.arccos(np.clip(cosine / np.linalg.norm(reference[:, Q], axis=1), -1.0, 1.0))))

    rows = []
    for name, (step, evaluations) in INTEGRATORS.items():
        for h in steps(seconds, quick):
            y = start
            with np.errstate(all="ignore"):
                for _ in range(round(seconds / h)):
                    y = step(rates, y, h)
                    if not np.isfinite(y).any(axis=1).all():
                        break
                found = error(y[:, X], y[:, Q])
            lost = float((~np.isfinite(y).all(axis=1)).mean())
            rows.append(row_of(body, name, h, evaluations / h * cost, found if lost < 0.5 else np.nan, 0.0, lost))
    for h in steps(seconds, quick):
        run = run_product([(body.model, emission)], Surroundings(body.fluid), 1.0 / h, seconds, seconds)
        spent = run.body_steps * EVALUATIONS_PER_SUBSTEP / len(emission.positions) / seconds * cost
        found = error(run.positions[-1], run.orientations[-1])
        rows.append(row_of(body, OURS, h, spent, found, 0.0, float(run.failed.mean())))
    return rows


def steps(seconds: float, quick: bool) -> list[float]:
    """Steps [s] that divide a time, from a twelfth of a second down."""
    longest = 1.0 / 12.0
    return [longest / 2**n for n in range(8 if quick else 9)]


def measure_statistics(body: TestBody, quick: bool) -> list[dict[str, Any]]:
    """Largest relative error of mean descent, tilt and spin, and its standard error."""
    seconds, count = (2.5, 64) if quick else (4.0, 240)
    emission = started(count, 1, body.spin)
    rates = BodyRates([body.model], np.zeros(count, dtype=np.int64))
    start = rates.state(emission)
    times = np.arange(1, round(seconds * SAMPLES_PER_SECOND) + 1) / SAMPLES_PER_SECOND
    late = times > WARM_UP
    states, _ = dop853(rates, start, times, 1e-7)
    expected = statistics(rates, states[late])
    cost = evaluation_cost(body.model, body.fluid)
    rows = []
    diagonal = np.abs(body.model.inertia[:3, 3:]).max() < 1e-9
    for name, (step, evaluations) in INTEGRATORS.items():
        if needs_diagonal(step) and not diagonal:
            continue
        for h in steps(seconds, quick)[1:-2]:
            every = round(1.0 / SAMPLES_PER_SECOND / h)
            y, kept, broken = start, [], False
            with np.errstate(all="ignore"):
                for n in range(1, round(seconds / h) + 1):
                    y = step(rates, y, h)
                    if n % every == 0:
                        kept.append(y)
                        if not np.isfinite(y).all():
                            broken = True
                            break
            lost = float((~np.isfinite(y).all(axis=1)).mean())
            found = (np.nan, np.nan) if broken else compare(statistics(rates, np.array(kept)[late]), expected)
            rows.append(row_of(body, name, h, evaluations / h * cost, *found, lost))
    for h in steps(seconds, quick)[:-2]:
        run = run_product([(body.model, emission)], Surroundings(body.fluid), 1.0 / h, seconds, 1.0 / SAMPLES_PER_SECOND)
        kept = [run.velocities[1:][late], run.orientations[1:][late], run.angular_velocities[1:][late]]
        spent = run.body_steps * EVALUATIONS_PER_SUBSTEP / count / seconds * cost
        rows.append(row_of(body, OURS, h, spent, *compare(averages(*kept), expected), float(run.failed.mean())))
    return rows


def statistics(rates: BodyRates, states: Array) -> Array:
    """Descent [m/s], tilt [rad] and spin [rad/s] of each body (3, N), averaged over states (T, N, 25)."""
    velocities = np.einsum("nij,tnj->tni", rates.inverse, states[..., :6])
    return averages(rotate(states[..., Q], velocities[..., :3]), states[..., Q], velocities[..., 3:])


def averages(velocities: Array, orientations: Array, angular_velocities: Array) -> Array:
    """The same from velocities in world axes, orientations and angular velocities in any axes, (T, N, ...) each."""
    normal = rotate(orientations, np.broadcast_to([0.0, 0.0, 1.0], velocities.shape))
    tilt = np.arccos(np.clip(np.abs(normal[..., 1]) / np.linalg.norm(normal, axis=-1), 0.0, 1.0))
    return np.stack(
        [-velocities[..., 1].mean(axis=0), tilt.mean(axis=0), np.linalg.norm(angular_velocities, axis=-1).mean(axis=0)]
    )


def compare(found: Array, expected: Array) -> tuple[float, float]:
    """Largest relative error of the three means, and the standard error of that one; both (3, N)."""
    mean, scale = found.mean(axis=1), np.abs(expected.mean(axis=1))
    errors = np.abs(mean - expected.mean(axis=1)) / scale
    spread = (found - expected).std(axis=1) / np.sqrt(found.shape[1]) / scale  # the starts are the same: pairs
    worst = int(errors.argmax())
    return float(errors[worst]), float(spread[worst])


def row_of(
    body: TestBody, name: str, h: float, seconds: float, error: float, standard_error: float, lost: float
) -> dict[str, Any]:
    """One row of the table."""
    return {
        "body": body.name, "chaotic": int(body.chaotic), "integrator": name, "step_ms": 1e3 * h,
        "us_per_body_second": 1e6 * seconds, "error": float(error), "standard_error": float(standard_error), "lost": lost,
    }  # fmt: skip


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: one panel a body, cost against error, one line an integrator."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    names = list(dict.fromkeys(row["body"] for row in rows))
    figure = Figure(figsize=(11.0, 6.9), layout="constrained")
    axes = figure.subplots(2, 3).ravel()
    for axis, name in zip(axes, names, strict=True):
        mine = [row for row in rows if row["body"] == name]
        chaotic = bool(mine[0]["chaotic"])
        floor = 1e-5 if chaotic else 1e-7
        for method, (color, marker) in STYLE.items():
            points = sorted((row["us_per_body_second"], row["error"]) for row in mine if row["integrator"] == method)
            good = np.array([(cost, max(error, floor)) for cost, error in points if np.isfinite(error)])
            ours = method == OURS
            if len(good):
                width, size, level = (2.4, 6, 3) if ours else (1.2, 4, 2)
                axis.loglog(*good.T, marker + "-", color=color, linewidth=width, markersize=size, zorder=level)
            broken = [cost for cost, error in points if not np.isfinite(error)]
            axis.plot(broken, np.full(len(broken), 3.0 * 1.4 ** list(STYLE).index(method)), "x", color=color, markersize=5)
        axis.set_ylim(0.5 * floor, 20.0)
        axis.set_ylabel("error of mean fall, tilt, spin" if chaotic else "path error, lengths + radians")
        if chaotic:
            noise = 2.0 * np.median([row["standard_error"] for row in mine if row["integrator"] == OURS])
            axis.axhspan(0.5 * floor, max(noise, floor), color="0.9", zorder=0)
        mark_frame(axis, [row for row in mine if row["integrator"] == OURS], floor)
        axis.set_title(name, fontsize=10)
        axis.grid(alpha=0.25, which="major")
    for axis in axes[3:]:
        axis.set_xlabel("one core's time for a second of one body, µs")
    keys: list[Any] = [Line2D([], [], color=c, marker=m, label=name) for name, (c, m) in STYLE.items()]
    keys += [
        Line2D([], [], color="0.4", marker="x", linestyle="", label="diverged"),
        Patch(color="0.9", label="within statistics"),
    ]
    axes[2].legend(handles=keys, loc="lower left", fontsize=8)
    figure.suptitle(
        "warp_immersed (red) loses no body at any frame rate; fixed steps diverge (crosses) on thin and on fast bodies"
    )
    return figure


def mark_frame(axis: Any, mine: Sequence[dict[str, Any]], floor: float) -> None:
    """Point at what the product does at 24 frames a second."""
    for row in mine:
        if abs(row["step_ms"] - 1e3 / 24.0) < 1e-3:
            at = (row["us_per_body_second"], max(row["error"], floor))
            axis.annotate("24 fps", at, xytext=(8, 10), textcoords="offset points", fontsize=8, color=STYLE[OURS][0])
            axis.plot(*at, "o", markersize=10, markerfacecolor="none", color=STYLE[OURS][0])


def chart(request: Request) -> str:
    """Run every integrator on every body, draw the figure, and write both."""
    rows = measure(request.quick, request.report)
    publish(request, lambda: draw(rows), rows)
    ours = [row for row in rows if row["integrator"] == OURS]
    film = [row for row in ours if abs(row["step_ms"] - 1e3 / 24.0) < 1e-3]
    worst = max(film, key=lambda row: row["error"] if row["chaotic"] else 0.0)
    fixed = sum(1 for row in rows if row["integrator"] == "RK4, fixed step" and not np.isfinite(row["error"]))
    return (
        f"At 24 fps no body is lost, and mean fall, tilt and spin are within {100 * worst['error']:.1f} % "
        f"(standard error {100 * worst['standard_error']:.1f} %) of DOP853; RK4 at a fixed step diverges in {fixed} cases."
    )
