"""A picture of why the sources of k and epsilon are not stepped explicitly: decaying turbulence at growing time steps."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.figures import Request, publish

C_2 = 1.92
Array = NDArray[np.float64]
Step = Callable[[float, float, float], tuple[float, float]]


def exact(k: float, epsilon: float, dt: float) -> tuple[float, float]:
    """Decay without production over dt [s] in closed form, as the solver's unsteady path takes it."""
    f = 1.0 + (C_2 - 1.0) * dt * epsilon / k
    return k * f ** (-1.0 / (C_2 - 1.0)), epsilon * f ** (-C_2 / (C_2 - 1.0))


def explicit(k: float, epsilon: float, dt: float) -> tuple[float, float]:
    """One explicit step, as the slides print it."""
    return k - dt * epsilon, epsilon - dt * C_2 * epsilon**2 / k


def patankar(k: float, epsilon: float, dt: float) -> tuple[float, float]:
    """Sinks as a rate times the new value (Patankar 1980), as the solver's steady path takes them: positive at any step."""
    rate = epsilon / k
    return k / (1.0 + dt * rate), epsilon / (1.0 + C_2 * dt * rate)


FORMS: dict[str, Step] = {"explicit (as printed)": explicit, "Patankar": patankar, "exact": exact}


def relative_error(step: Step, dt: float, duration: float = 10.0) -> float:
    """Largest error of k relative to the closed form over `duration`, from k = epsilon = 1; infinite once not positive."""
    k, epsilon, worst = 1.0, 1.0, 0.0
    for n in range(1, max(1, round(duration / dt)) + 1):
        k, epsilon = step(k, epsilon, dt)
        if not (np.isfinite(k) and np.isfinite(epsilon) and k > 0.0 and epsilon > 0.0):
            return float("inf")
        worst = max(worst, abs(k / exact(1.0, 1.0, n * dt)[0] - 1.0))
    return worst


def table() -> list[dict[str, Any]]:
    """Rows: form, time step in units of k / epsilon at the start, largest relative error of k (inf: not positive)."""
    return [
        {"form": name, "step": float(dt), "error": relative_error(step, dt)}
        for name, step in FORMS.items()
        for dt in np.logspace(-2, 1, 25)
    ]


def draw_sources(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: error of k against the time step for each form; a cross where the form leaves positive numbers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axis = figure.subplots()
    for name in FORMS:
        steps, errors = np.array([(row["step"], row["error"]) for row in rows if row["form"] == name]).T
        finite = np.isfinite(errors)
        (line,) = axis.loglog(steps[finite], np.maximum(errors[finite], 1e-7), marker="o", markersize=3, label=name)
        if not finite.all():
            axis.plot(steps[~finite], np.full((~finite).sum(), 10.0), "x", color=line.get_color())
            axis.annotate("not positive", (steps[~finite][0], 10.0), xytext=(-64, -3), textcoords="offset points")
    axis.set(
        xlabel="time step x epsilon / k at the start",
        ylabel="largest relative error of k",
        title="Decaying turbulence: printed, the sources leave positive numbers",
    )
    axis.set_ylim(5e-8, 30.0)
    axis.legend()
    return figure


def chart(request: Request) -> str:
    """Compute the errors, draw the figure, and write both."""
    rows = table()
    publish(request, lambda: draw_sources(rows), rows)
    broken = min(row["step"] for row in rows if not np.isfinite(row["error"]))
    return f"As printed the sources leave positive numbers at steps from {broken:.2g} k / epsilon on; those used here never do."
