"""Turbulence and mean flows that vary in space and time: well mixed, decaying, swirling, vanishing; eddies of a body's size."""

from dataclasses import replace

import numpy as np
import pytest

from tests.bodies import ideal_body, model_in, no_loads, random_orientations, started, trajectory
from warp_immersed import library
from warp_immersed.boundaries import Inlet
from warp_immersed.device_state import Group, Surroundings, wind_steps_per_frame
from warp_immersed.fluid import AIR
from warp_immersed.seen_turbulence import kept_energy, seen_turbulence, small_eddies
from warp_immersed.turbulence import LARGEST_C0, HomogeneousTurbulence, lagrangian_time_scale
from warp_immersed.turbulence_grid import TurbulenceGrid

NO_GRAVITY = (0.0, 0.0, 0.0)
# It moves with the air that it sees: without weight, and at the full level after a moment of strong drag.
TRACER = ideal_body(net_weight=0.0, loads=no_loads(drag_linear=np.full(3, 40.0)))


def grid(k, epsilon, velocity=None, lower=(0.0, 0.0, 0.0), spacing=(1.0, 1.0, 1.0), **options) -> TurbulenceGrid:
    """A grid of given k and epsilon ((nt,) nx, ny, nz), at rest unless a velocity is given."""
    k, epsilon = np.asarray(k, dtype=np.float32), np.asarray(epsilon, dtype=np.float32)
    velocity = np.zeros((*k.shape, 3)) if velocity is None else velocity
    fluid = np.ones(k.shape[-3:], dtype=bool)
    return TurbulenceGrid(lower, spacing, np.asarray(velocity, dtype=np.float32), k, epsilon, fluid, **options)


def in_flow(flow: TurbulenceGrid, **options) -> Surroundings:
    return Surroundings(AIR, gravity=NO_GRAVITY, flow=flow, **options)


# k = 1.5 sigma^2 varies by a factor of 3 along x, with epsilon / k constant, so that T_L is all but 1 s.
PERIOD, PERIODS, CELLS = 4.0, 4, 256
MIDDLE, SWING = 1.5, 0.75  # of k: from 0.75 to 2.25
MARGIN = 9.0
FREQUENCY = 1.0 / (0.75 * LARGEST_C0)


def wavy_k(x):
    """Kinetic energy at x; beyond the waves it stays at its value where they end, an extremum."""
    inside = np.clip(x, 0.0, PERIOD * PERIODS)
    return MIDDLE + SWING * np.cos(2.0 * np.pi * inside / PERIOD)


def wavy_grid() -> TurbulenceGrid:
    spacing = PERIOD * PERIODS / CELLS
    k = wavy_k((np.arange(CELLS) + 0.5) * spacing)[:, None, None]
    far = Inlet((0.0, 0.0, 0.0), float(wavy_k(0.0)), float(wavy_k(0.0)) * FREQUENCY)
    return grid(k, k * FREQUENCY, spacing=(spacing, 1.0, 1.0), far=far, fade=0.1)


def unevenness(positions, bins=8) -> float:
    """Rms over bins of one period of the deviation of the density from its mean; positions (samples, N)."""
    x = positions[(positions > 0.0) & (positions < PERIOD * PERIODS)]
    counts = np.histogram(x % PERIOD, bins, (0.0, PERIOD))[0]
    return float(np.std(counts) / counts.mean())


def uniform_start(bodies) -> np.ndarray:
    """Positions along x, evenly over the waves and a margin of three root-mean-square paths."""
    return -MARGIN + (np.arange(bodies) + 0.5) * (PERIOD * PERIODS + 2.0 * MARGIN) / bodies


# steps within a frame, and a frame a step
@pytest.mark.parametrize(
    ("level", "fps", "bodies"), [("drift", 1.0, 40_000), ("drift", 11.0, 40_000), ("quasi_steady", 2.0, 20_000)]
)
def test_well_mixed_stays_well_mixed(level, fps, bodies) -> None:
    """The density over 2 to 5 time scales: even within 3 % rms, counting noise of about 1 % included."""
    place = np.zeros((bodies, 3))
    place[:, 0] = uniform_start(bodies)
    surroundings = in_flow(wavy_grid())
    assert 10 <= fps * wind_steps_per_frame(1.0 / fps, surroundings) <= 16
    group = Group(TRACER, started(positions=place, count=bodies), 1, level)
    run = trajectory([group], None, surroundings, fps, round(5 * fps) + 1, seed=1)
    late = run["positions"][round(2 * fps) :: max(1, round(fps / 2)), :, 0]
    assert unevenness(late) < 0.03


def langevin_paths(bodies: int, drift: bool) -> np.ndarray:
    """The same process in NumPy, with or without the drift term: x at 2, 3, 4 and 5 s, (4, bodies)."""
    random = np.random.default_rng(0)
    x, w, h = uniform_start(bodies), random.standard_normal(bodies), 1.0 / 16.0
    decay, late = np.exp(-h), []
    for step in range(1, round(5.0 / h) + 1):
        middle = x + 0.5 * h * np.sqrt(2.0 / 3.0 * wavy_k(x)) * w
        slope = (wavy_k(middle + 1e-3) - wavy_k(middle - 1e-3)) / 2e-3 / np.sqrt(6.0 * wavy_k(middle))
        before = w
        w = decay * w + (1.0 - decay) * slope * drift + np.sqrt(1.0 - decay**2) * random.standard_normal(bodies)
        x = x + h * np.sqrt(2.0 / 3.0 * wavy_k(middle)) * (before + w) / 2.0
        if step * h in (2.0, 3.0, 4.0, 5.0):
            late.append(x)
    return np.array(late)


def test_without_its_drift_term_the_process_piles_up_where_k_is_small() -> None:
    """By 18 % rms, half as dense again as where it is large; with it, it does not: what the kernel is spared."""
    without, with_drift = langevin_paths(40_000, False), langevin_paths(40_000, True)
    assert unevenness(with_drift) < 0.03
    assert unevenness(without) > 0.15
    x = without[(without > 0.0) & (without < PERIOD * PERIODS)] % PERIOD
    calm, lively = (np.abs(x - PERIOD / 2.0) < PERIOD / 8.0).mean(), (np.abs(x - PERIOD / 2.0) > 3.0 * PERIOD / 8.0).mean()
    assert calm > 1.5 * lively


def decayed(k, epsilon, time):
    """k and epsilon of decaying homogeneous turbulence by the k-epsilon model, exact."""
    c2 = 1.92
    f = 1.0 + (c2 - 1.0) * epsilon * time / k
    return k * f ** (-1.0 / (c2 - 1.0)), epsilon * f ** (-c2 / (c2 - 1.0))


# k, epsilon and the end of a unit box, and of the grid turbulence of Comte-Bellot & Corrsin (1971) from 42 to 98 mesh lengths
DECAYS = [(1.0, 1.0, 5.0, 0.1537277), (0.07393, 0.4740, 0.28448, 0.02534)]


@pytest.mark.parametrize(("k", "epsilon", "end", "left"), DECAYS, ids=["unit", "comte_bellot_corrsin"])
def test_an_ensemble_in_decaying_turbulence_has_its_energy(k, epsilon, end, left) -> None:
    """Variance 2 k(t) / 3 of every component within 3.5 standard errors at every frame."""
    assert decayed(k, epsilon, end)[0] == pytest.approx(left, rel=1e-3), "the published value"
    bodies, frames = 20_000, 13
    times = np.linspace(0.0, end, 12 * 40 + 1)
    k_at, epsilon_at = decayed(k, epsilon, times)
    flow = grid(k_at[:, None, None, None], epsilon_at[:, None, None, None], time=times, fade=1.0)
    group = Group(TRACER, started(count=bodies), 1, "drift")
    run = trajectory([group], None, in_flow(flow), (frames - 1) / end, frames, seed=2)
    error = np.sqrt(2.0 / (3 * bodies))
    measured = (run["velocities"][1:].astype(float) ** 2).mean(axis=(1, 2))
    assert measured == pytest.approx(2.0 / 3.0 * k_at[40::40], rel=3.5 * error)


@pytest.mark.parametrize("size", [1e-5, 1e-2, 3.0])
def test_even_turbulence_in_a_grid_is_homogeneous_turbulence(size) -> None:
    """The same random numbers make the same paths: standard deviations, decay rates and rotation agree as float32 allows."""
    turbulence = HomogeneousTurbulence(0.8, 0.6)
    loads = no_loads(drag_linear=np.full(3, 40.0), damping_linear=np.full(3, 100.0))
    body = replace(ideal_body(net_weight=0.0, loads=loads), eddy_size=size)
    fps, count = 40.0 / lagrangian_time_scale(turbulence, AIR), 50
    even = grid(np.full((3, 3, 3), 0.8), np.full((3, 3, 3), 0.6), far=Inlet((0.0, 0.0, 0.0), 0.8, 0.6))
    for level in ("drift", "quasi_steady"):
        groups = [Group(body, started(count=count), 1, level)]
        one = trajectory(groups, None, Surroundings(AIR, gravity=NO_GRAVITY, turbulence=turbulence), fps, 40)
        other = trajectory(groups, None, in_flow(even), fps, 40)
        for name in ("positions", "velocities", "angular_velocities"):
            largest = np.abs(one[name]).max()
            assert np.abs(one[name] - other[name]).max() <= 2e-4 * largest


# A sphere in a fluid in solid-body rotation, without gravity: fluid over body density, and where it goes.
TURNING, DRAG = 1.0, 3.0


def spiral_rate(fluid_over_body: float) -> complex:
    """Slow root of (1 + a) s^2 + d (s - i W) + (f + a) W^2 = 0, a = f / 2: Maxey & Riley's sphere with Stokes drag."""
    added = fluid_over_body / 2.0
    roots = np.roots([1.0 + added, DRAG, -1j * DRAG * TURNING + (fluid_over_body + added) * TURNING**2])
    return complex(roots[np.argmax(roots.real)])


@pytest.mark.parametrize("level", ["point", "kirchhoff", "quasi_steady"])
@pytest.mark.parametrize("fluid_over_body", [1.0, 0.1, 5.0], ids=["neutral", "heavy", "light"])
def test_spheres_in_a_vortex_spiral_as_maxey_and_riley_say(fluid_over_body, level) -> None:
    """A neutral sphere goes round with the fluid, a heavy one spirals out and a bubble in, at the exact rates."""
    n = 24
    x = (np.arange(n) - n / 2 + 0.5) * 0.25
    velocity = np.zeros((n, n, 1, 3))
    velocity[..., 0], velocity[..., 1] = -TURNING * x[None, :, None], TURNING * x[:, None, None]
    still = np.zeros((n, n, 1))
    flow = grid(still, still, velocity, (-n / 8, -n / 8, 0.0), (0.25, 0.25, 1.0))
    mass = 1.0 + fluid_over_body / 2.0
    body = ideal_body(
        mass=(mass,) * 3, moment=(mass,) * 3, net_weight=1.0 - fluid_over_body, loads=no_loads(drag_linear=np.full(3, DRAG))
    )
    rate = spiral_rate(fluid_over_body)
    sign = 1.0 - fluid_over_body
    assert np.sign(np.round(rate.real, 12)) == np.sign(sign)
    start = started(positions=(1.0, 0.0, 0.0), velocities=(rate.real, rate.imag, 0.0))
    fps, frames = 100.0, 401
    run = trajectory([Group(body, start, 1, level)], None, in_flow(flow), fps, frames)
    path = run["positions"][:, 0, 0] + 1j * run["positions"][:, 0, 1]
    exact = np.exp(rate * np.arange(frames) / fps)
    # its slip through the vortex enters to first order in the wind step
    assert np.abs(path - exact).max() < 0.012
    assert np.log(np.abs(path[-1])) == pytest.approx(rate.real * (frames - 1) / fps, abs=0.012)


@pytest.mark.parametrize("level", ["drift", "point", "kirchhoff", "quasi_steady"])
def test_where_turbulence_vanishes_everything_stays_finite(level) -> None:
    """Blocks with k = 0, epsilon = 0, both and neither, of vanishing and of enormous turbulence, and an obstacle."""
    values = np.array([(0.0, 0.0), (0.0, 1.0), (0.3, 0.0), (0.3, 0.1), (1e-20, 1e-30), (1e-12, 1.0), (5.0, 1e4), (0.1, 0.1)])
    block = np.arange(8).reshape(2, 2, 2).repeat(2, 0).repeat(2, 1).repeat(2, 2)
    k, epsilon = values[block, 0], values[block, 1]
    flow = grid(k, epsilon, np.full((4, 4, 4, 3), 0.5), spacing=(0.5, 0.5, 0.5), far=Inlet((0.0, 0.0, 0.0), 0.0, 0.0))
    flow.fluid[1:3, 1, 1] = False
    count = 200
    place = np.random.default_rng(3).uniform(-0.2, 2.2, (count, 3)) + [0.0, 0.5, 0.0]
    start = started(positions=place, orientations=random_orientations(count, 4), count=count)
    surroundings = Surroundings(AIR, flow=flow)
    run = trajectory([Group(model_in(library.maple_leaf(), AIR), start, 1, level)], None, surroundings, 24.0, 49)
    assert (run["state"] == 1).all()
    for name in ("positions", "orientations", "velocities", "angular_velocities"):
        assert np.isfinite(run[name]).all()
    assert np.abs(run["velocities"]).max() < 50.0


def test_energy_of_eddies_larger_than_a_body() -> None:
    """Kolmogorov's spectrum where the body is small, the inverse of its volume where it is large, falling throughout."""
    turbulence = HomogeneousTurbulence(0.5, 0.2)
    small = small_eddies(turbulence, 1e-5)
    assert 1.0 - kept_energy(turbulence, 1e-5) == pytest.approx(small, rel=2e-3)
    # 3/2 C eps^(2/3) kappa^(-2/3) / k with C = 1.5
    assert small == pytest.approx(1.5 * 1.5 * 0.2 ** (2 / 3) * (np.pi / 1e-5) ** (-2 / 3) / 0.5)
    assert kept_energy(turbulence, 2e4) / kept_energy(turbulence, 1e4) == pytest.approx(2.0**-3, rel=0.03)
    kept = [kept_energy(turbulence, size) for size in np.geomspace(1e-6, 1e4, 60)]
    assert (np.diff(kept) < 0.0).all()


def test_rotation_that_a_small_body_sees_is_that_of_the_fluid() -> None:
    """Half the vorticity, whose variance is eps / nu / 3 a component; large bodies hardly turn."""
    turbulence = HomogeneousTurbulence(0.5, 0.2)
    seen = seen_turbulence(turbulence, AIR, 1e-7)
    assert seen.rotation_rms**2 == pytest.approx(0.2 / AIR.kinematic_viscosity / 12.0, rel=1e-2)
    sizes = np.geomspace(1e-7, 1e3, 60)
    rms = [seen_turbulence(turbulence, AIR, size).rotation_rms for size in sizes]
    assert (np.diff(rms) < 0.0).all()
    # far inside the inertial range, as size^(-2/3)
    assert seen_turbulence(turbulence, AIR, 0.016).rotation_rms / seen_turbulence(turbulence, AIR, 0.008).rotation_rms < 0.7


@pytest.mark.parametrize("size", [1e-3, 0.05])
def test_a_free_rotor_turns_with_the_air_that_it_sees(size) -> None:
    """Variance of its angular velocity under strong damping: rotation_rms^2, within 4 standard errors and 3 % for its lag."""
    turbulence = HomogeneousTurbulence(0.5, 0.02)
    seen = seen_turbulence(turbulence, AIR, size)
    loads = no_loads(drag_linear=np.full(3, 1.0), damping_linear=np.full(3, 200.0 / seen.rotation_time_scale))
    body = replace(ideal_body(net_weight=0.0, loads=loads), eddy_size=size)
    bodies = 4000
    surroundings = Surroundings(AIR, gravity=NO_GRAVITY, turbulence=turbulence)
    fps = 20.0 / seen.rotation_time_scale
    run = trajectory(body, started(count=bodies), surroundings, fps, 41)
    measured = run["angular_velocities"][[20, 40]].astype(float)
    error = np.sqrt(2.0 / measured.size)
    assert (measured**2).mean() == pytest.approx(seen.rotation_rms**2, rel=4.0 * error + 0.03)
    assert abs(measured.mean()) < 4.0 * seen.rotation_rms / np.sqrt(measured.size / 2)
