"""The map of how a shape falls, over the measured points and boundaries of falling disks."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed import library
from warp_immersed.charts.falls import REGIMES, Falls, simulate_falls
from warp_immersed.charts.figures import Request, save_figure
from warp_immersed.errors import InputError
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

REYNOLDS_RANGE, INERTIA_RANGE = (20.0, 2.0e4), (1.0e-3, 0.2)
COLORS = ("#3b76af", "#5aa469", "#d9a441", "#b5484b", "#9a86c5", "#303030")
# Smooth lines through the boundaries that Field, Klaus, Moore & Nori, Nature 388 (1997) 252 drew between the motions of disks,
# (Re, I*): a few numbers read off.
MEASURED_BOUNDARIES = {
    "steady - periodic": ((145.0, 0.0012), (106.0, 0.0026), (89.0, 0.0057), (89.0, 0.0119), (99.0, 0.0199), (135.0, 0.0525)),
    "periodic - chaotic": (
        (155.0, 0.0405),
        (162.0, 0.0261),
        (232.0, 0.0145),
        (429.0, 0.0101),
        (1017.0, 0.0086),
        (8917.0, 0.0097),
    ),
    "chaotic - tumbling": ((162.0, 0.0376), (722.0, 0.0394), (4584.0, 0.0409), (11605.0, 0.0421)),
}


def read_points(path: str | Path) -> tuple[Array, Array, NDArray[np.int64]]:
    """Re, I* and regime (P,) of measured points, from a CSV file with columns Re, Istar, class.

    Raises:
        InputError: the file is missing, or a row is not two positive numbers and a regime.
    """
    rows = []
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            for number, row in enumerate(csv.DictReader(file), start=2):
                try:
                    reynolds, inertia, regime = float(row["Re"]), float(row["Istar"]), REGIMES.index(row["class"].strip())
                except (KeyError, TypeError, ValueError, AttributeError) as error:
                    raise InputError(
                        f"{path}: line {number}: found {dict(row)}, must have Re and Istar, positive numbers, and class, one of "
                        f"{', '.join(REGIMES[:4])}"
                    ) from error
                if not (np.isfinite([reynolds, inertia]).all() and reynolds > 0.0 and inertia > 0.0):
                    raise InputError(f"{path}: line {number}: found Re {reynolds:g} and Istar {inertia:g}, must be positive")
                rows.append((reynolds, inertia, regime))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if not rows:
        raise InputError(f"{path}: holds no points, must have columns Re, Istar, class")
    table = np.array(rows)
    return table[:, 0], table[:, 1], table[:, 2].astype(np.int64)


def boundary_points() -> tuple[Array, Array, NDArray[np.int64]]:
    """Re, I* and regime (P,) of points where experiments were made, well between the measured boundaries."""
    steady, periodic, _ = (np.log(np.array(line)) for line in MEASURED_BOUNDARIES.values())
    reynolds, inertia = np.meshgrid(np.geomspace(30.0, 1.2e4, 14), np.geomspace(0.004, 0.1, 9), indexing="ij")
    x, y = np.log(reynolds.ravel()), np.log(inertia.ravel())
    first = np.interp(y, steady[:, 1], steady[:, 0])
    # the second boundary falls with Re, then is level
    second = np.interp(x, periodic[:, 0], periodic[:, 1], left=np.inf)
    margin = 0.18
    regime = np.full(len(x), -1)
    regime[x < first - margin] = 0
    outside = x > first + margin
    regime[outside & (y < second - margin)] = 1
    regime[outside & (y > second + margin) & (y < np.log(0.040) - margin)] = 2
    regime[outside & (y > np.log(0.040) + margin) & (x > np.log(1000.0))] = 3
    measured_so_far = (x < np.log(3000.0)) | (y > np.log(0.025))
    kept = (regime >= 0) & measured_so_far & ((regime > 0) | (y < np.log(0.03)))
    return np.exp(x[kept]), np.exp(y[kept]), regime[kept]


def agreement(found: NDArray[Any], measured: NDArray[Any]) -> dict[str, float]:
    """Share of points whose regime is the measured one: "all", and by measured regime."""
    shares = {"all": float((found == measured).mean())}
    for code, name in enumerate(REGIMES[:4]):
        if (measured == code).any():
            shares[name] = float((found == measured)[measured == code].mean())
    return shares


def falls_at_own_reynolds(shape: Shape, reynolds: Array, inertia: Array, threads: int | None = None, **options: Any) -> Falls:
    """`simulate_falls` at points whose Re was measured with the mean speed of the fall, as `simulate_falls` finds it: the
    viscosity is corrected twice by the speed found."""
    factor = np.ones(len(reynolds))
    for _ in range(2):
        (falls,) = simulate_falls(shape, reynolds, inertia, viscosity_factor=factor, threads=threads, **options)
        factor = np.clip(np.nan_to_num(falls.descent.mean(axis=1), nan=1.0), 0.3, 3.0)
    (falls,) = simulate_falls(shape, reynolds, inertia, viscosity_factor=factor, threads=threads, **options)
    return falls


def regime_grid(count: int) -> tuple[Array, Array]:
    """Re and I* (count^2,) of a grid over the plane, logarithmic, I* fastest."""
    reynolds, inertia = np.meshgrid(np.geomspace(*REYNOLDS_RANGE, count), np.geomspace(*INERTIA_RANGE, count), indexing="ij")
    return reynolds.ravel(), inertia.ravel()


def draw_map(reynolds: Array, inertia: Array, regime: NDArray[Any], title: str, points: Any = None) -> Any:
    """A matplotlib figure: the simulated grid as fields of colour, the measured boundaries, and measured points if given."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    count = round(np.sqrt(len(reynolds)))
    figure = Figure(figsize=(7.6, 5.4), layout="constrained")
    axis = figure.subplots()
    axis.pcolormesh(
        reynolds.reshape(count, count), inertia.reshape(count, count), regime.reshape(count, count),
        cmap=ListedColormap(COLORS), vmin=-0.5, vmax=len(REGIMES) - 0.5, shading="nearest", alpha=0.45,
    )  # fmt: skip
    for line in MEASURED_BOUNDARIES.values():
        axis.plot(*zip(*line, strict=True), color="black", linewidth=1.2)
    if points is not None:
        for code in range(4):
            chosen = points[2] == code
            axis.plot(points[0][chosen], points[1][chosen], "o", markersize=4, color=COLORS[code], markeredgecolor="white")
    present = [code for code in range(len(REGIMES)) if (regime == code).any() or code < 4]
    axis.legend(handles=[Patch(color=COLORS[code], alpha=0.7, label=REGIMES[code]) for code in present], loc="upper left")
    axis.set(xscale="log", yscale="log", xlabel="Re = U D / nu", ylabel="I*")
    axis.set_title(title, fontsize="medium")
    return figure


def named_shape(name: str) -> Shape:
    """A shape of the library with its defaults. Raises InputError if there is none of that name that has defaults."""
    if name not in library.SHAPES:
        raise InputError(f"shape: found {name!r}, must be one of {', '.join(library.SHAPES)}")
    try:
        return library.SHAPES[name]()
    except TypeError as error:
        raise InputError(f"shape: {name} has no defaults; pass the Shape to chart_regimes in Python") from error


def chart_regimes(
    output: str | Path,
    points: str | Path | None = None,
    shape: Shape | str | None = None,
    count: int = 15,
    threads: int | None = None,
) -> str:
    """Simulate a shape over a count x count grid of (Re, I*), draw the map, and write the grid to a .csv beside it.

    shape: a `Shape`, a name of the library, or None for a disk; points: a CSV file of measured points (columns Re, Istar,
    class). Returns the shares of the regimes, and the agreement with the points, in a line.

    Raises:
        InputError: the points cannot be read, no such shape, it would float at the smallest I*, or the files cannot be written.
    """
    measured = None if points is None else read_points(points)
    disk = shape is None
    body = library.disk(1.0, 1e-3, 1000.0) if shape is None else named_shape(shape) if isinstance(shape, str) else shape
    reynolds, inertia = regime_grid(count)
    (falls,) = simulate_falls(body, reynolds, inertia, threads=threads)
    regime = falls.most_frequent
    conclusion = f"{count} x {count} points: " + ", ".join(
        f"{(regime == code).mean():.0%} {name}" for code, name in enumerate(REGIMES) if (regime == code).any()
    )
    title = "Falling disks" if disk else f"Falling {shape if isinstance(shape, str) else 'bodies'} (lines: disks)"
    if measured is not None:
        shares = agreement(falls_at_own_reynolds(body, *measured[:2], threads=threads).most_frequent, measured[2])
        verdict = ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
        title += f"; of {len(measured[0])} measured points agree:\n{verdict}"
        conclusion += f"; of {len(measured[0])} measured points agree: {verdict}"
    path = save_figure(lambda: draw_map(reynolds, inertia, regime, title, measured), output)
    write_grid(path.with_suffix(".csv"), reynolds, inertia, falls)
    return conclusion


def chart(request: Request) -> str:
    """The map of a library shape, or of a disk, over the measured points of `request.source`, if any."""
    return chart_regimes(request.output, request.source, request.shape, 7 if request.quick else 15)


def write_grid(path: Path, reynolds: Array, inertia: Array, falls: Falls) -> None:
    """Write the grid to a CSV file: Re, I*, the regime of most releases, how many releases had each, descent over U."""
    header = ["Re", "Istar", "class", *(f"releases_{name}" for name in REGIMES), "mean_descent"]
    regime = falls.most_frequent
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            for i in range(len(reynolds)):
                counts: Sequence[int] = [int((falls.regime[i] == code).sum()) for code in range(len(REGIMES))]
                descent = float(np.nanmean(falls.descent[i]))
                writer.writerow([f"{reynolds[i]:.5g}", f"{inertia[i]:.5g}", REGIMES[regime[i]], *counts, f"{descent:.4f}"])
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
