"""Fits the coefficients of the plate law, or prints how the ones in the package compare with what they were fitted to.

    python benchmarks/calibrate.py --check [--points FILE]     # a residual table, about a minute
    python benchmarks/calibrate.py [--points FILE] [--minutes 20] [--processes 3]   # fit; needs the extra calibrate (cma)

Fitted to: paper disks dropped in air (Howison, Hughes & Iida 2020; benchmarks/paper_drops.py holds the numbers) and the
regime map of falling disks (Field, Klaus, Moore & Nori, Nature 388 (1997) 252, as digitised by Howison et al.). FILE is that
digitised map, a CSV file with columns Re, Istar, class, which is not part of this repository: every other point is fitted, the
rest is left out and reported apart. Without it, points between the published boundaries stand in for it.
Left out of the fit altogether: every other radius of the paper disks, other outlines of the paper, spheres, the drag of
disks at rest in a stream (it bounds the broadside drag), plates in two dimensions, falls in turbulence, and long falls.

All sets of coefficients of a generation are body kinds of one ensemble; CMA-ES proposes them.
"""

import argparse
import json
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

import numpy as np
import warp as wp
from paper_drops import (
    DESCENT,
    GLIDE,
    HORIZONTAL,
    INERTIA_BINS,
    PEAK_SPEED,
    RADII,
    RATE_TIMES_DIAMETER,
    TUMBLING,
    Summary,
    all_measured_tumbling,
    drop_sheets,
    paper_disk,
    summarize,
)

from warp_immersed import library
from warp_immersed.charts.falls import REGIMES, TILTS, Falls, simulate_falls
from warp_immersed.charts.regimes import boundary_points, falls_at_own_reynolds, read_points
from warp_immersed.force_law import CALIBRATED_PLATE, PlateCoefficients

# What is fitted, within which bounds. The broadside drag stays within 8 % of the speed of a disk in a stream (C_D = 1.17).
BOUNDS = {
    "broadside_drag": (1.05, 1.33),
    "edge_drag": (0.03, 0.40),
    "oblique_drag": (0.0, 1.6),
    "edge_friction": (0.8, 6.0),
    "translational_lift": (0.5, 2.2),
    "rotational_lift": (0.3, 2.0),
    "lift_onset_reynolds": (30.0, 110.0),
    "lift_lag": (0.2, 1.6),
    "munk_cut_edge": (0.3, 0.95),
    "munk_cut_broadside": (0.7, 1.1),
    "damping_oblique": (0.0, 0.15),
    "damping_by_spin": (0.0, 0.12),
    "damping_viscous": (0.5, 5.0),
}
# Errors that count one: of a share, of a peak rate, of a mean speed, of the rate of tumbling, of the glide [degrees]
SHARE, RELEASE_SHARE, PEAK, SPEED, RATE, ANGLE = 0.08, 0.10, 0.09, 0.04, 0.08, 8.0
# Weights of the regimes, and of the map against the drops
REGIME_WEIGHT, MAP_WEIGHT = np.array([1.0, 1.6, 1.6, 0.9]), 64.0
FIT_TILTS = (3.0, 40.0, 80.0)
# Between the height stated, 1.1 m, and the 1.0 m where the tracks of flat drops begin [m]
FIT_HEIGHT = 1.05

Points = tuple[np.ndarray, np.ndarray, np.ndarray]


def residuals(found: Summary) -> dict[str, np.ndarray]:
    """Errors of the paper drops over what counts one."""
    rows = {"tumbling": (found.all_tumbling - all_measured_tumbling()) / SHARE}
    for release, measured in TUMBLING.items():
        rows[f"tumbling {release}"] = (found.tumbling[release] - np.array(measured)) / RELEASE_SHARE
        rows[f"peak rate {release}"] = (found.peak_speed[release] / np.array(PEAK_SPEED[release]) - 1.0) / PEAK
    rows["descent"] = np.array([found.descent[label] / value - 1.0 for label, value in DESCENT.items()]) / SPEED
    rows["rate of tumbling"] = np.array([found.rate_times_diameter / RATE_TIMES_DIAMETER - 1.0]) / RATE
    rows["glide"] = np.array([(found.glide - GLIDE) / ANGLE])
    rows["drift of chaotic ones"] = np.array([found.horizontal["chaotic"] / HORIZONTAL["chaotic"] - 1.0]) / 0.3
    return rows


def map_loss(falls: Falls, measured: np.ndarray) -> float:
    """Weighted share of wrong points, half by the most frequent regime and half by release."""
    right = 0.5 * (falls.most_frequent == measured) + 0.5 * (falls.regime == measured[:, None]).mean(axis=1)
    return float(
        sum(REGIME_WEIGHT[code] * (1.0 - right[measured == code].mean()) for code in range(4) if (measured == code).any())
    )


def losses(laws: Sequence[PlateCoefficients], points: Points, factor: np.ndarray) -> list[float]:
    """What the fit makes small, for each law; factor (P,) corrects the viscosity of the points for the speed of the fall."""
    drops = drop_sheets([paper_disk(2.0 * radius) for radius in RADII[::2]], 12, laws, height=FIT_HEIGHT, threads=1)
    disk = library.disk(1.0, 1e-3, 1000.0)
    falls = simulate_falls(disk, *points[:2], FIT_TILTS, factor, laws, window=45.0, threads=1)
    values = []
    for dropped, fallen in zip(drops, falls, strict=True):
        errors = np.nan_to_num(np.concatenate(list(residuals(summarize(dropped)).values())), nan=4.0)
        values.append(float(np.minimum(errors**2, 16.0).sum()) + MAP_WEIGHT * map_loss(fallen, points[2]))
        values[-1] += 200.0 * max(0.0, 0.98 - float(dropped.complete.mean()))
    return values


def law_at(position: np.ndarray) -> PlateCoefficients:
    """The law at a place in the unit cube of BOUNDS."""
    low, high = np.array(list(BOUNDS.values())).T
    return PlateCoefficients(**dict(zip(BOUNDS, (low + (high - low) * np.asarray(position)).tolist(), strict=True)))


def fit(points: Points, minutes: float, processes: int, output: Path) -> PlateCoefficients:
    """CMA-ES from the law in the package; writes the best coefficients to a JSON file as it goes."""
    try:
        import cma
    except ModuleNotFoundError as error:
        raise SystemExit("calibrate needs cma: pip install 'warp-immersed[calibrate]'") from error
    low, high = np.array(list(BOUNDS.values())).T
    start = np.array([getattr(CALIBRATED_PLATE, name) for name in BOUNDS])
    disk = library.disk(1.0, 1e-3, 1000.0)
    chosen: Points = (points[0][::2], points[1][::2], points[2][::2])
    # midway between both readings of Re: by the nominal speed, and by that of the fall
    factor = np.sqrt(falls_at_own_reynolds(disk, *chosen[:2]).descent.mean(axis=1))
    search = cma.CMAEvolutionStrategy(
        np.clip((start - low) / (high - low), 0.001, 0.999), 0.1,
        {"bounds": [0.0, 1.0], "popsize": 8 * processes, "verbose": -9, "seed": 1},
    )  # fmt: skip
    end, best, best_loss = time.monotonic() + 60.0 * minutes, CALIBRATED_PLATE, np.inf
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        while time.monotonic() < end and not search.stop():
            positions = search.ask()
            laws = [law_at(position) for position in positions]
            tasks = [pool.submit(losses, laws[n::processes], chosen, factor) for n in range(processes)]
            values = np.empty(len(laws))
            for n, task in enumerate(tasks):
                values[n::processes] = task.result()
            search.tell(positions, values.tolist())
            if values.min() < best_loss:
                best, best_loss = laws[int(values.argmin())], float(values.min())
                output.write_text(json.dumps(asdict(best), indent=1))
            print(f"generation {search.countiter}: best {best_loss:.1f}, this one {values.min():.1f}", flush=True)
    return best


def report(law: PlateCoefficients, points: Points, measured_points: bool) -> None:
    """Print coefficients and residual tables."""
    print({name: round(getattr(law, name), 4) for name in BOUNDS})
    (drops,) = drop_sheets([paper_disk(2.0 * radius) for radius in RADII], 20, (law,))
    found = summarize(drops)
    print(f"\nPaper disks, {len(drops.diameter)} drops: measured / simulated")

    def row(name: str, measured: Sequence[float], simulated: Sequence[float]) -> None:
        print(f"{name:34s}" + "  ".join(f"{m:5.2f} /{s:5.2f}" for m, s in zip(measured, simulated, strict=True)))

    print(f"{'':34s}I* " + " ".join(f"{low}-{high}" for low, high in pairwise(INERTIA_BINS)))
    row("labelled tumbling", all_measured_tumbling(), found.all_tumbling)
    for release, measured in TUMBLING.items():
        row(f"  released {release}", measured, found.tumbling[release])
    for release, speeds in PEAK_SPEED.items():
        row(f"pi f D, {release}, radii 15 to 50 mm", speeds, found.peak_speed[release])
    row("descent, tumbling and chaotic", list(DESCENT.values()), list(found.descent.values()))
    row("horizontal, tumbling and chaotic", list(HORIZONTAL.values()), list(found.horizontal.values()))
    row("rate x D", [RATE_TIMES_DIAMETER], [found.rate_times_diameter])
    row("glide, degrees", [GLIDE], [found.glide])

    disk = library.disk(1.0, 1e-3, 1000.0)
    (nominal,) = simulate_falls(disk, *points[:2], TILTS, plates=(law,))
    own = falls_at_own_reynolds(disk, *points[:2], plates=(law,))
    kind = "measured points" if measured_points else "points between the published boundaries"
    print(f"\nMap, {len(points[0])} {kind}: share in their regime")
    for name, falls in (("nominal Re", nominal), ("Re from the simulated speed", own)):
        regime = falls.most_frequent
        right = regime == points[2]
        print(f"{name:30s} all {right.mean():.3f}  fitted half {right[::2].mean():.3f}  other half {right[1::2].mean():.3f}")
        for code in range(4):
            mask = points[2] == code
            counts = {REGIMES[k]: int((regime[mask] == k).sum()) for k in range(len(REGIMES)) if (regime[mask] == k).any()}
            print(f"    {REGIMES[code]:10s} {right[mask].mean():.2f}   {counts}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="print the residuals of the law in the package")
    parser.add_argument("--points", type=Path, help="CSV file of the measured map: Re, Istar, class")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--processes", type=int, default=3)
    parser.add_argument("--output", type=Path, default=Path("plate_coefficients.json"))
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    points = read_points(options.points) if options.points else boundary_points()
    law = CALIBRATED_PLATE if options.check else fit(points, options.minutes, options.processes, options.output)
    report(law, points, options.points is not None)


if __name__ == "__main__":
    main()
