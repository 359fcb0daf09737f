"""The plate law in its two-dimensional limit: Andersen, Pesavento & Wang, J. Fluid Mech. 541 (2005) 91, beta = 0.

Their equations, with C_T 1.2, C_R pi, A 1.4, B 1.0, mu 0.2, are this law for a strip of unit weight: M = diag(I, ., I + 1),
J = (I + 1/2) / 4, lift 2 C_T / pi, circulation 2 C_R / pi, drag (A -+ B) / pi, damping mu1 + mu2 |w|. Golden values: DOP853
at 1e-11 from (vx, vy, w, theta) = (0, 0.01, 0, 0.5), averaged over whole periods in t = 500 ... 900.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.bodies import ideal_body, no_loads, started, trajectory
from warp_immersed.device_state import Surroundings
from warp_immersed.fluid import AIR

FALL = Surroundings(AIR, gravity=(0.0, -1.0, 0.0))
FPS = 20.0


def strip(inertia: float):
    loads = no_loads(
        drag_quadratic=np.array([0.4, 0.4, 2.4]) / np.pi,
        lift=2.0 * 1.2 / np.pi,
        circulation=np.array([0.0, 2.0, 0.0]),
        damping_linear=np.array([0.0, 0.2, 0.0]),
        damping_spin=np.array([0.0, 0.2, 0.0]),
    )
    # no turning out of the plane: there the strip would be unstable, and rounding errors grow
    moment = (1e9, 0.25 * (inertia + 0.5), 1e9)
    return ideal_body((inertia, 1.0, inertia + 1.0), moment, pull=1.0, loads=loads)


def turned(theta: float) -> np.ndarray:
    """Body x at an angle theta from the horizontal, body z, the normal, at theta from the vertical."""
    tilt, roll = theta / 2.0, -np.pi / 4.0
    return np.array(
        [np.cos(tilt) * np.sin(roll), np.sin(tilt) * np.sin(roll), np.sin(tilt) * np.cos(roll), np.cos(tilt) * np.cos(roll)]
    )


def fall(inertia: float, duration: float, theta: float = 0.5, precision: str = "float64", fps: float = FPS, start=None):
    """World velocity (F, 2), unwrapped theta (F,) and its rate (F,)."""
    start = 0.01 * np.array([-np.sin(theta), np.cos(theta), 0.0]) if start is None else start
    run = trajectory(
        strip(inertia), started((0, 0, 0), turned(theta), start), FALL, fps, round(duration * fps) + 1, precision=precision
    )
    q = run["orientations"][:, 0]
    angle = np.unwrap(2.0 * np.arctan2(q[:, 2] - q[:, 1], q[:, 3] - q[:, 0]), period=2.0 * np.pi)
    return run["velocities"][:, 0, :2], angle, run["angular_velocities"][:, 0, 2]


def apw(_, y, inertia):
    vx, vy, w, theta = y
    speed = np.hypot(vx, vy)
    gamma = 2.0 / np.pi * (-1.2 * vx * vy / speed + np.pi * w)
    drag = (1.4 - (vx**2 - vy**2) / speed**2) * speed / np.pi
    return (
        ((inertia + 1.0) * w * vy - gamma * vy - np.sin(theta) - drag * vx) / inertia,
        (-inertia * w * vx + gamma * vx - np.cos(theta) - drag * vy) / (inertia + 1.0),
        (-vx * vy - 0.2 * (1.0 + abs(w)) * w) / (0.25 * (inertia + 0.5)),
        w,
    )


@pytest.mark.parametrize("inertia", [1.1, 1.4, 2.2, 3.0])
def test_the_kernel_solves_their_equations(inertia: float) -> None:
    """Against an independent integration of the printed equations, path by path."""
    _, angle, spin = fall(inertia, 20.0, fps=100.0)
    times = np.arange(len(angle)) / 100.0
    exact = solve_ivp(
        apw, (0.0, 20.0), (0.0, 0.01, 0.0, 0.5), method="DOP853", t_eval=times, args=(inertia,), rtol=1e-11, atol=1e-13
    )
    assert np.abs(angle - exact.y[3]).max() < 2e-6
    assert np.abs(spin - exact.y[2]).max() < 2e-6


@pytest.mark.parametrize(("theta", "speed"), [(0.0, 1.144114), (np.pi / 2.0, 2.8024956)], ids=["broadside", "edge-on"])
def test_fixed_points(theta: float, speed: float) -> None:
    """W = (pi / (A + B))^(1/2) and V = (pi / (A - B))^(1/2)."""
    exact = np.sqrt(np.pi / (2.4 if theta == 0.0 else 0.4))
    assert exact == pytest.approx(speed, rel=1e-6)
    velocity, _, spin = fall(2.0, 2.0, theta=theta, start=(0.0, -exact, 0.0))
    assert np.abs(-velocity[:, 1] - exact).max() < 1e-9 * exact
    assert np.abs(spin).max() < 1e-9
    # and it attracts
    velocity, _, _ = fall(2.0, 2.0, theta=theta, start=(0.0, -0.9 * exact, 0.0))
    assert np.abs(-velocity[-1, 1] - exact) < 0.09 * exact


def test_flutter_at_1_1() -> None:
    velocity, angle, spin = fall(1.1, 900.0)
    late = slice(round(500 * FPS), None)
    rising = np.flatnonzero((angle[late][:-1] < 0.0) & (angle[late][1:] >= 0.0))
    whole = slice(rising[0] + late.start, rising[-1] + late.start)
    assert np.diff(rising).mean() / FPS == pytest.approx(15.952983, rel=1e-3)
    assert -velocity[whole, 1].mean() == pytest.approx(0.584527, rel=1e-3)
    assert velocity[whole, 0].mean() == pytest.approx(0.0, abs=1e-3)
    assert np.abs(angle[late]).max() == pytest.approx(1.51815, rel=1e-3)
    assert np.abs(spin[late]).max() == pytest.approx(0.531743, rel=1e-3)


@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-3), ("float32", 1e-2)])
def test_tumbling_at_1_4(precision: str, tolerance: float) -> None:
    velocity, angle, _ = fall(1.4, 900.0, precision=precision)
    late = slice(round(500 * FPS), None)
    turns = np.floor(np.abs(angle[late]) / (2.0 * np.pi))
    starts = np.flatnonzero(np.diff(turns) > 0) + late.start
    whole = slice(starts[0], starts[-1])
    assert np.diff(starts).mean() / FPS == pytest.approx(12.84289, rel=tolerance)
    assert -velocity[whole, 1].mean() == pytest.approx(0.326673, rel=tolerance)
    assert np.abs(velocity[whole, 0].mean()) == pytest.approx(0.755928, rel=tolerance)


def test_regimes() -> None:
    """Flutter at 1.1, tumbling at 1.4, chaos at 2.2, a flutter about broadside at 3.0."""
    swing = {}
    for inertia in (1.1, 1.4, 2.2, 3.0):
        _, angle, _ = fall(inertia, 500.0)
        swing[inertia] = np.ptp(angle[round(250 * FPS) :])
    assert swing[1.1] < np.pi
    assert swing[1.4] > 20 * np.pi
    assert swing[2.2] > 2.0 * np.pi
    assert swing[3.0] < np.pi


def test_both_sides_of_the_heteroclinic_point() -> None:
    """Flutter at I = 1.2190, tumbling at 1.2192: the law's own threshold, to four digits."""
    for inertia, tumbles in ((1.2190, False), (1.2192, True)):
        _, angle, _ = fall(inertia, 1500.0)
        assert (np.ptp(angle[round(500 * FPS) :]) > 4.0 * np.pi) == tumbles
