"""The seen wind against the exact Ornstein-Uhlenbeck process, and Galilean invariance."""

import numpy as np
import pytest

from tests.bodies import ideal_body, model_in, no_loads, random_orientations, started, trajectory
from warp_immersed import library
from warp_immersed.device_state import Surroundings, wind_steps_per_frame
from warp_immersed.errors import InputError
from warp_immersed.fluid import AIR, WATER
from warp_immersed.turbulence import HomogeneousTurbulence, kolmogorov_constant, lagrangian_time_scale, taylor_reynolds

PUBLISHED_C0 = {1: 0.1589, 5: 0.7638, 10: 1.4345, 40: 3.8313, 100: 5.334, 200: 5.9716, 400: 6.2777, 1000: 6.4326, 10000: 6.4968}


@pytest.mark.parametrize(("reynolds", "value"), PUBLISHED_C0.items())
def test_kolmogorov_constant(reynolds, value) -> None:
    assert kolmogorov_constant(reynolds) == pytest.approx(value, abs=6e-5)


def test_time_scale_is_finite_or_says_why() -> None:
    assert lagrangian_time_scale(HomogeneousTurbulence(0.0, 0.0), AIR) == 0.0
    assert lagrangian_time_scale(HomogeneousTurbulence(0.0, 1.0), AIR) == 0.0
    assert lagrangian_time_scale(HomogeneousTurbulence(1.0, 0.0), AIR) == np.inf
    turbulence = HomogeneousTurbulence(0.5, 0.1)
    c0 = kolmogorov_constant(taylor_reynolds(turbulence, AIR))
    assert lagrangian_time_scale(turbulence, AIR) == pytest.approx(0.5 / (0.75 * c0 * 0.1))
    with pytest.raises(InputError, match="k: found -1"):
        HomogeneousTurbulence(-1.0, 1.0)


def passive_cloud(turbulence, fps, frames, bodies, **options):
    """Bodies without weight or drag: each keeps its velocity relative to the wind it sees, so v(t) = u(t) - u(0)."""
    body = ideal_body(net_weight=0.0)
    surroundings = Surroundings(AIR, gravity=(0.0, 0.0, 0.0), turbulence=turbulence)
    return trajectory(body, started(count=bodies), surroundings, fps, frames, seed=3, **options)


# frames per T_L: fine, and so coarse that several wind updates fall into each
@pytest.mark.parametrize("frames_per_time_scale", [20.0, 2.0, 0.5])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_variance_correlation_and_dispersion_are_exact(frames_per_time_scale, precision) -> None:
    """<(u(t) - u(0))^2> = 2 s^2 (1 - e^(-t/T)), and <(x + u(0) t)^2> after Taylor (1921): 3 standard errors."""
    turbulence = HomogeneousTurbulence(k=1.5, epsilon=0.5)
    sigma, time_scale = 1.0, lagrangian_time_scale(turbulence, AIR)
    fps = frames_per_time_scale / time_scale
    bodies, frames = 20_000, max(3, round(4.0 * frames_per_time_scale)) + 1
    run = passive_cloud(turbulence, fps, frames, bodies, precision=precision)
    error = np.sqrt(2.0 / (3 * bodies))
    for frame in range(1, frames):
        t = frame / fps / time_scale
        change = run["velocities"][frame]
        assert (change**2).mean() == pytest.approx(2.0 * sigma**2 * (1.0 - np.exp(-t)), rel=3.5 * error)
        # x = int u - u0 t: Taylor's dispersion, less twice the covariance of int u and u0, plus u0^2 t^2
        spread = 2.0 * (t - 1.0 + np.exp(-t)) + t**2 - 2.0 * t * (1.0 - np.exp(-t))
        # the wind between updates is a straight line, which leaves out the bridges between: h^3 / 6 of variance each
        steps = wind_steps_per_frame(1.0 / fps, Surroundings(AIR, turbulence=turbulence))
        bridges = t * (1.0 / frames_per_time_scale / steps) ** 2 / 6.0
        measured = (run["positions"][frame] ** 2).mean() / (sigma * time_scale) ** 2
        assert measured == pytest.approx(spread - bridges, rel=3.5 * error)


@pytest.mark.parametrize(("time", "expected"), [(1.0, 0.8522453), (2.0, 2.9430355), (5.0, 12.656680), (20.0, 72.000363)])
def test_published_taylor_dispersion_is_the_formula_used_above(time, expected) -> None:
    """<x^2> for s = 1, T = 2."""
    t = time / 2.0
    assert 2.0 * 4.0 * (t - 1.0 + np.exp(-t)) == pytest.approx(expected, rel=1e-7)


def test_initial_wind_is_gaussian_with_the_variance_of_k() -> None:
    """In a frozen wind (epsilon = 0) drag carries every body to the velocity that it saw at release, and keeps it there."""
    bodies = 20_000
    body = ideal_body(net_weight=0.0, loads=no_loads(drag_linear=np.full(3, 20.0)))
    surroundings = Surroundings(AIR, gravity=(0.0, 0.0, 0.0), turbulence=HomogeneousTurbulence(k=1.5, epsilon=0.0))
    run = trajectory(body, started(count=bodies), surroundings, 24.0, 49)
    u = run["velocities"][-1].astype(float)
    assert np.abs(u - run["velocities"][-13]).max() < 1e-4, "frozen"
    draws = 3 * bodies
    assert abs(u.mean()) < 4.0 / np.sqrt(draws)
    assert u.var() == pytest.approx(1.0, rel=4.0 * np.sqrt(2.0 / draws))
    assert (u**4).mean() == pytest.approx(3.0, abs=4.0 * np.sqrt(96.0 / draws)), "Gaussian, not a sum of bytes"


@pytest.mark.parametrize(("k", "epsilon"), [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1e-12, 1e-12)])
def test_degenerate_turbulence_stays_finite(k, epsilon) -> None:
    surroundings = Surroundings(AIR, turbulence=HomogeneousTurbulence(k, epsilon))
    start = started(orientations=random_orientations(20, 0), count=20)
    run = trajectory(model_in(library.disk(), AIR), start, surroundings, 24.0, 49)
    assert np.isfinite(run["positions"]).all()
    assert (run["state"] == 1).all()


def test_turbulence_too_fast_for_the_frames_is_refused() -> None:
    surroundings = Surroundings(AIR, turbulence=HomogeneousTurbulence(1.0, 1e5))
    with pytest.raises(InputError, match="time scale T_L"):
        wind_steps_per_frame(1.0 / 24.0, surroundings)


@pytest.mark.parametrize(
    ("shape", "fluid"), [(library.maple_leaf(), AIR), (library.disk(0.02, 1e-3, 2700.0), WATER)], ids=["leaf", "coin"]
)
def test_uniform_wind_changes_no_statistic(shape, fluid) -> None:
    """Galilean invariance at three times the fall speed: drift 0.97 to 1.00 of the wind, everything else the same.

    With absolute momentum in the Kirchhoff terms the drift is 0.2 to 0.5 of the wind and the tumbling dies. Weak turbulence
    lets the bodies forget how they were released: in still air some shapes have two ways to fall, and keep the one they took.
    """
    turbulence = HomogeneousTurbulence(0.02, 0.04) if fluid is AIR else HomogeneousTurbulence(2e-4, 1e-4)
    bodies, fps, frames = 1500, 60.0, 481
    start = started(orientations=random_orientations(bodies, 1), count=bodies)
    model = model_in(shape, fluid)
    still = trajectory(model, start, Surroundings(fluid, turbulence=turbulence), fps, frames)
    fall = -still["velocities"][180:, :, 1].mean()
    wind = np.array([3.0 * fall, 0.0, 0.0])
    blown = trajectory(model, start, Surroundings(fluid, mean_wind=tuple(wind), turbulence=turbulence), fps, frames)
    drifts = (blown["velocities"][180:] - still["velocities"][180:]).mean(axis=0)[:, 0] / wind[0]
    # bodies glide, each on a heading that it keeps: over the bodies it averages out
    assert 0.97 <= drifts.mean() <= 1.0 + 4.0 * drifts.std() / np.sqrt(bodies)

    def statistics(run):
        spin = np.linalg.norm(run["angular_velocities"][180:], axis=2).mean(axis=0)
        return np.array([-run["velocities"][180:, :, 1].mean(axis=0), spin])

    one, other = statistics(still), statistics(blown)
    error = np.sqrt(one.var(axis=1) + other.var(axis=1)) / np.sqrt(bodies)
    assert (np.abs(one.mean(axis=1) - other.mean(axis=1)) < 4.0 * error + 0.005 * one.mean(axis=1)).all()


def test_released_with_the_wind_a_body_falls_exactly_as_in_still_air() -> None:
    """The same motion seen from a moving frame, path by path, in float64."""
    start = started(orientations=random_orientations(10, 2), count=10)
    wind = (4.0, 1.0, -2.0)
    with_wind = started(orientations=start.orientations, velocities=wind, count=10)
    model = model_in(library.maple_leaf(), AIR)
    still = trajectory(model, start, Surroundings(AIR), 24.0, 25, precision="float64")
    blown = trajectory(model, with_wind, Surroundings(AIR, mean_wind=wind), 24.0, 25, precision="float64")
    assert np.abs(blown["positions"] - still["positions"] - np.arange(25)[:, None, None] / 24.0 * wind).max() < 1e-6
