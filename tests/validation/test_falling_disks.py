"""The calibrated law on what it was fitted to, and on what it was not: paper drops, the map of regimes, long falls,
spheres. Subsets in the fast suite, the whole tables with --slow."""

import numpy as np
import pytest

from benchmarks.paper_drops import (
    AREAL_DENSITY,
    DESCENT,
    DROPS,
    GLIDE,
    PEAK_SPEED,
    RADII,
    RATE_TIMES_DIAMETER,
    THICKNESS,
    TUMBLING,
    all_measured_tumbling,
    drop_sheets,
    paper_disk,
    summarize,
)
from tests.bodies import model_in, random_orientations, started, trajectory
from warp_immersed import library
from warp_immersed.charts import falls
from warp_immersed.charts.falls import simulate_falls
from warp_immersed.charts.regimes import agreement, boundary_points, falls_at_own_reynolds
from warp_immersed.device_state import Surroundings
from warp_immersed.fluid import AIR, Fluid

DISK = library.disk(1.0, 1e-3, 1000.0)


def share_error(share: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Standard error of a share found in `number` drops."""
    return np.sqrt(np.maximum(share * (1.0 - share), 0.02) / number)


def test_paper_disks_fall_as_measured() -> None:
    """A twentieth of a second a drop: 500 of them, some radii of each bin."""
    count = 25
    found = summarize(drop_sheets([paper_disk(2e-3 * r) for r in (16, 18, 20, 22, 24, 28, 32, 36, 42, 48)], count)[0])
    error = 2.0 * share_error(all_measured_tumbling(), np.array([4, 4, 4, 4, 4]) * count)
    assert (np.abs(found.all_tumbling - all_measured_tumbling()) < 0.15 + error).all(), found.all_tumbling
    for label, speed in DESCENT.items():
        assert found.descent[label] == pytest.approx(speed, rel=0.08), label
    assert found.rate_times_diameter == pytest.approx(RATE_TIMES_DIAMETER, rel=0.15)
    assert found.glide == pytest.approx(GLIDE, abs=15.0)
    assert found.peak_speed["edge"].mean() == pytest.approx(np.mean(PEAK_SPEED["edge"]), rel=0.15)
    assert found.peak_speed["flat"].mean() == pytest.approx(np.mean(PEAK_SPEED["flat"]), rel=0.15)
    assert found.peak_speed["edge"].mean() > 1.1 * found.peak_speed["flat"].mean(), "a release on edge turns faster"


@pytest.mark.slow
def test_the_whole_table_of_paper_disks() -> None:
    """2880 drops: shares labelled tumbling by bin and release, peak rates, descent, glide."""
    count = 40
    found = summarize(drop_sheets([paper_disk(2.0 * radius) for radius in RADII], count)[0])
    assert np.abs(found.all_tumbling - all_measured_tumbling()).max() < 0.15, found.all_tumbling
    for release, measured in TUMBLING.items():
        # the measured shares have errors of their own
        error = share_error(np.array(measured), np.array(DROPS[release]))
        assert (np.abs(found.tumbling[release] - np.array(measured)) < 0.2 + error).all(), (release, found.tumbling[release])
        mean = found.peak_speed[release].mean()
        assert mean == pytest.approx(np.mean(PEAK_SPEED[release]), rel=0.15)
    for label, speed in DESCENT.items():
        assert found.descent[label] == pytest.approx(speed, rel=0.08), label
    assert found.rate_times_diameter == pytest.approx(RATE_TIMES_DIAMETER, rel=0.15)
    assert found.glide == pytest.approx(GLIDE, abs=15.0)


def polygon(corners: int, area: float) -> np.ndarray:
    """Corners of a regular polygon of an area [m^2]."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    radius = np.sqrt(2.0 * area / (corners * np.sin(2.0 * np.pi / corners)))
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("corners", [4, 6])
def test_polygons_of_the_paper_fall_as_disks_of_their_area(corners: int) -> None:
    """Their descent was measured to be that of disks, within a few percent."""
    shapes = [library.sheet(polygon(corners, np.pi * r**2), THICKNESS, AREAL_DENSITY / THICKNESS) for r in (0.018, 0.026, 0.036)]
    found = drop_sheets(shapes, 40)[0]
    disks = drop_sheets([paper_disk(2.0 * r) for r in (0.018, 0.026, 0.036)], 40)[0]
    assert found.complete.all()
    assert found.descent.mean() == pytest.approx(disks.descent.mean(), rel=0.06)


DEEP_INSIDE = {
    "steady": ((30.0, 0.004), (45.0, 0.010), (50.0, 0.02), (60.0, 0.008)),
    "periodic": ((170.0, 0.005), (250.0, 0.006), (400.0, 0.005), (500.0, 0.004)),
    "chaotic": ((400.0, 0.018), (700.0, 0.017), (1000.0, 0.017), (1500.0, 0.018)),
    "tumbling": ((3000.0, 0.08), (6000.0, 0.06), (9000.0, 0.07), (12000.0, 0.1)),
}


def test_disks_well_inside_a_regime_fall_in_it() -> None:
    for name, points in DEEP_INSIDE.items():
        (found,) = simulate_falls(DISK, *np.array(points).T)
        assert (found.most_frequent == falls.REGIMES.index(name)).all(), (name, found.most_frequent)


@pytest.mark.slow
def test_the_map_of_regimes() -> None:
    """Points between the published boundaries, with Re by the nominal speed and by that of the fall."""
    reynolds, inertia, regime = boundary_points()
    for found in (simulate_falls(DISK, reynolds, inertia)[0], falls_at_own_reynolds(DISK, reynolds, inertia)):
        shares = agreement(found.most_frequent, regime)
        assert shares["all"] > 0.85, shares
        assert shares["chaotic"] > 0.65, shares


LONG_FALLS = {
    "paper disk of 3 cm": library.disk(0.03, 69.4e-6, 1008.6),
    "paper disk of 6 cm": library.disk(0.06, 69.4e-6, 1008.6),
    "paper disk of 10 cm": library.disk(0.10, 69.4e-6, 1008.6),
    "ellipse 1:2": library.elliptic_paper(0.06, 0.03),
    "ellipse 1:4": library.elliptic_paper(0.04, 0.01),
    "large ellipse 1:4": library.elliptic_paper(0.12, 0.03),
}


@pytest.mark.parametrize("name", LONG_FALLS)
def test_a_long_fall_does_not_change_its_kind(name: str) -> None:
    """No body comes to fall along its own axis, edge-on and twice too fast, as they did without roll damping."""
    start = started((0.0, 100.0, 0.0), random_orientations(24, 3), count=24)
    run = trajectory(model_in(LONG_FALLS[name], AIR), start, Surroundings(AIR), 30.0, 600)
    descent = -run["velocities"][:, :, 1]
    early, late = descent[60:150].mean(axis=0), descent[-150:].mean(axis=0)
    assert late.mean() == pytest.approx(early.mean(), rel=0.12)
    assert late.max() < 1.35 * early.mean()


def terminal_speed(density: float, diameter: float, fluid: Fluid) -> float:
    model = model_in(library.sphere(0.5 * diameter, density), fluid)
    run = trajectory(model, started(), Surroundings(fluid), 100.0, 400)
    return float(-run["velocities"][-1, 0, 1])


SPHERES = {
    # ten Cate et al., Phys. Fluids 14 (2002) 4012: nylon, 15 mm, in silicone oil
    "oil, Re 1.5": (1120.0, 0.015, Fluid(970.0, 0.373 / 970.0), 0.038),
    "oil, Re 4.1": (1120.0, 0.015, Fluid(965.0, 0.212 / 965.0), 0.060),
    "oil, Re 11.6": (1120.0, 0.015, Fluid(962.0, 0.113 / 962.0), 0.091),
    "oil, Re 31.9": (1120.0, 0.015, Fluid(960.0, 0.058 / 960.0), 0.128),
    # Mordant & Pinton, Eur. Phys. J. B 18 (2000) 343: glass, 0.5 mm, in water
    "water, Re 41.6": (2560.0, 5e-4, Fluid(997.0, 8.90e-7), 0.0741),
}


@pytest.mark.parametrize("name", SPHERES)
def test_spheres_settle_as_measured(name: str) -> None:
    density, diameter, fluid, measured = SPHERES[name]
    assert terminal_speed(density, diameter, fluid) == pytest.approx(measured, rel=0.08)


@pytest.mark.parametrize("reynolds", [1.0, 10.0, 50.0, 80.0])
def test_steady_disks_fall_at_the_speed_of_the_measured_drag(reynolds: float) -> None:
    """Against Clift, Grace & Weber, within 8 % in speed: the fall is measured in their speed."""
    (found,) = simulate_falls(DISK, reynolds, 0.008, tilts=(0.5,))
    assert found.descent[0, 0] == pytest.approx(1.0, rel=0.08)
