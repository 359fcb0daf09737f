"""The Kirchhoff equations and their integrator against exact solutions and conservation laws."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.bodies import ideal_body, model_in, rotate, started, trajectory
from warp_immersed import library
from warp_immersed.device_state import Surroundings
from warp_immersed.fluid import AIR, Fluid

NO_GRAVITY = Surroundings(AIR, gravity=(0.0, 0.0, 0.0))

# A free body in an ideal fluid: M, J, v0, w0 (body axes) and its state at t = 5 s, from DOP853 at 1e-13.
MASS, MOMENT = np.array([1.2, 1.7, 3.1]), np.array([0.9, 0.6, 0.4])
V0, W0 = np.array([0.5, -0.3, 0.8]), np.array([0.2, 0.7, -0.4])
V5 = np.array([0.5160309938, -0.2731290384, 0.8013680308])
W5 = np.array([0.2971308866, 0.5942456285, -0.5062343144])
X5 = np.array([0.7815647817, -0.8311884673, 4.5994079084])


def free_run(fps: float, seconds: float, precision: str, coupling=None):
    body = ideal_body(MASS, MOMENT, coupling=coupling)
    frames = round(seconds * fps) + 1
    run = trajectory(body, started(velocities=V0, angular_velocities=W0), NO_GRAVITY, fps, frames, precision=precision)
    q = run["orientations"][:, 0]
    conjugate = q * [-1.0, -1.0, -1.0, 1.0]
    return {
        "x": run["positions"][:, 0],
        "q": q,
        "v": rotate(conjugate, run["velocities"][:, 0]),
        "w": rotate(conjugate, run["angular_velocities"][:, 0]),
    }


@pytest.mark.parametrize(("precision", "fps", "tolerance"), [("float64", 1000.0, 2e-9), ("float32", 100.0, 2e-5)])
def test_free_body_follows_the_exact_solution(precision, fps, tolerance) -> None:
    run = free_run(fps, 5.0, precision)
    assert np.abs(run["v"][-1] - V5).max() < tolerance
    assert np.abs(run["w"][-1] - W5).max() < tolerance
    assert np.abs(run["x"][-1] - X5).max() < 5.0 * tolerance


@pytest.mark.parametrize(("precision", "fps", "tolerance"), [("float64", 500.0, 1e-9), ("float32", 120.0, 2e-5)])
@pytest.mark.parametrize("coupled", [False, True])
def test_energy_and_momenta_are_conserved(precision, fps, tolerance, coupled) -> None:
    """H, |P|^2, P.L and, in the world, P and L + x x P; with and without coupling of translation and rotation."""
    coupling = np.array([[0.05, -0.1, 0.02], [0.2, 0.0, 0.1], [-0.05, 0.15, 0.1]]) if coupled else None
    run = free_run(fps, 10.0, precision, coupling)
    d = np.zeros((3, 3)) if coupling is None else coupling
    p = run["v"] * MASS + run["w"] @ d.T
    l = run["v"] @ d + run["w"] * MOMENT  # noqa: E741
    world_p = rotate(run["q"], p)
    world_l = rotate(run["q"], l) + np.cross(run["x"], world_p)
    energy = 0.5 * ((p * run["v"]).sum(axis=1) + (l * run["w"]).sum(axis=1))
    for value in (energy, (p**2).sum(axis=1), (p * l).sum(axis=1), world_p, world_l):
        assert np.abs(value - value[0]).max() < tolerance * max(1.0, np.abs(value[0]).max())
    if not coupled:
        assert energy[0] == pytest.approx(1.4155, rel=1e-6)


def test_rk4_converges_with_order_four() -> None:
    errors = []
    for fps in (20.0, 40.0, 80.0):
        run = free_run(fps, 5.0, "float64")
        errors.append(np.abs(run["v"][-1] - V5).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 4.0) < 0.25).all(), f"errors {errors}"


def test_loads_and_lift_lag_keep_order_four() -> None:
    """With the whole plate law the right-hand side is smooth in still air, and so must be the order."""
    shape = library.elliptic_paper(0.08, 0.05, 2e-4)
    model = model_in(shape, AIR)
    start = started(
        orientations=(np.sin(0.3), 0.0, 0.0, np.cos(0.3)), velocities=(0.3, -0.8, 0.1), angular_velocities=(2.0, 1.0, 0.0)
    )
    ends = []
    for fps in (320.0, 640.0, 1280.0, 5120.0):
        run = trajectory(model, start, Surroundings(AIR), fps, round(0.25 * fps) + 1, precision="float64")
        assert run["body_steps"][-1] == len(run["body_steps"]) - 1, "one substep a frame"
        ends.append(np.concatenate([run["velocities"][-1, 0], 0.01 * run["angular_velocities"][-1, 0]]))
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.6), f"errors {errors}"
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.4), f"errors {errors}"


def test_munk_moment_growth_edge_on() -> None:
    """Translation along the axis of least added mass: growth rate U (m1 (m2 - m1) / (m2 J))^(1/2)."""
    body = ideal_body((1.2, 3.1, 2.0), (1.0, 1.0, 0.5))
    run = trajectory(
        body,
        started(velocities=(1.0, 0.0, 0.0), angular_velocities=(0.0, 0.0, 1e-7)),
        NO_GRAVITY,
        200.0,
        1801,
        precision="float64",
    )
    spin = run["angular_velocities"][:, 0, 2]
    growth = np.log(spin[1800] / spin[1400]) / 2.0
    assert growth == pytest.approx(1.2128346, rel=1e-3)


def test_munk_moment_frequency_broadside() -> None:
    """Translation along the axis of largest added mass: frequency U (m2 (m2 - m1) / (m1 J))^(1/2)."""
    body = ideal_body((1.2, 3.1, 2.0), (1.0, 1.0, 0.5))
    run = trajectory(
        body,
        started(velocities=(0.0, 1.0, 0.0), angular_velocities=(0.0, 0.0, 1e-5)),
        NO_GRAVITY,
        200.0,
        4001,
        precision="float64",
    )
    spin = run["angular_velocities"][:, 0, 2]
    crossings = np.flatnonzero((spin[:-1] > 0.0) & (spin[1:] <= 0.0))
    times = (crossings + spin[crossings] / (spin[crossings] - spin[crossings + 1])) / 200.0
    assert 2.0 * np.pi / np.diff(times).mean() == pytest.approx(3.1331560, rel=1e-3)


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 2e-6), ("float32", 5e-4)])
def test_heavy_body_falls_from_rest_as_the_exact_ode_says(precision, tolerance) -> None:
    """theta'' = -(kappa^2 / 2) t^2 sin 2 theta, kappa^2 = W^2 (m2 - m1) / (m1 m2 J); m1 1.2, m2 3.1, J 0.5, W 1."""
    body = ideal_body((1.2, 3.1, 2.0), (1.0, 1.0, 0.5), pull=1.0)
    tilt = 0.05
    start = started(orientations=(0.0, 0.0, np.sin(tilt / 2.0), np.cos(tilt / 2.0)))
    run = trajectory(body, start, Surroundings(AIR, gravity=(0.0, -1.0, 0.0)), 100.0, 1201, precision=precision)
    q = run["orientations"][:, 0]
    theta = 2.0 * np.arctan2(q[:, 2], q[:, 3])
    published = {1: 0.0458274, 3: -0.0153677, 6: 0.0097584, 9: -0.0154882, 12: -0.0139861}
    for second, value in published.items():
        assert theta[100 * second] == pytest.approx(value, abs=tolerance)
    kappa2 = 1.9 / (1.2 * 3.1 * 0.5)
    ode = solve_ivp(lambda t, y: (y[1], -0.5 * kappa2 * t**2 * np.sin(2.0 * y[0])), (0, 12), (tilt, 0), rtol=1e-11, atol=1e-13)
    assert theta[1200] == pytest.approx(ode.y[0, -1], abs=tolerance)


CASES = [
    ("light sphere in water", library.sphere(0.05, 100.0), Fluid(1000.0, 1e-6), 900.0 / (100.0 + 500.0)),
    (
        "broadside disk in air",
        library.disk(0.1, 1e-4, 500.0),
        AIR,
        -(500.0 - 1.204) * 1e-4 * np.pi * 0.0025 / (500.0 * 1e-4 * np.pi * 0.0025 + 8.0 / 3.0 * 1.204 * 0.05**3),
    ),
    (
        "broadside disk, lighter than water",
        library.disk(0.1, 1e-3, 100.0),
        Fluid(1000.0, 1e-6),
        900.0 * 1e-3 * np.pi * 0.0025 / (100.0 * 1e-3 * np.pi * 0.0025 + 8.0 / 3.0 * 1000.0 * 0.05**3),
    ),
]


@pytest.mark.parametrize(("name", "shape", "fluid", "expected"), CASES, ids=[c[0] for c in CASES])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_initial_acceleration_is_exact(name, shape, fluid, expected, precision) -> None:
    """(m - rho V) g over mass and added mass, within 1e-4. Explicit added mass, or none, is off by factors of 2 to 600."""
    flat = (np.sin(-np.pi / 4.0), 0.0, 0.0, np.cos(np.pi / 4.0))  # the body's z axis up
    surroundings = Surroundings(fluid, gravity=(0.0, -9.81, 0.0))
    run = trajectory(model_in(shape, fluid), started(orientations=flat), surroundings, 5000.0, 2, precision=precision)
    assert run["velocities"][-1, 0, 1] * 5000.0 == pytest.approx(9.81 * expected, rel=1e-4)


def test_momentum_survives_many_small_rotations_in_float32() -> None:
    """60,000 steps of a turning body: a rotation written as a product loses 7e-3 of |p|; as an increment, 1e-5."""
    body = ideal_body((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    start = started(velocities=(0.3, 0.2, 0.1), angular_velocities=(0.5, 1.0, 0.2))
    run = trajectory(body, start, NO_GRAVITY, 1000.0, 60_001, threads=1)
    speed = np.linalg.norm(run["velocities"][:, 0], axis=1)
    assert np.abs(speed / speed[0] - 1.0).max() < 2e-4


def test_a_far_origin_does_not_change_the_fall() -> None:
    """0.3 m/s for 10 s at 1 kHz from 4 km away: plain float32 positions fall 2.44 m instead of 3."""
    body = ideal_body(net_weight=0.0)
    for height in (0.0, 4000.0):
        start = started(positions=(height, height, 0.0), velocities=(0.0, -0.3, 0.0))
        run = trajectory(body, start, NO_GRAVITY, 1000.0, 10_001)
        fallen = run["positions"][0, 0, 1].astype(float) - run["positions"][-1, 0, 1]
        assert fallen == pytest.approx(3.0, abs=3e-4)
