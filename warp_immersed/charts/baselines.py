"""Formulations that the product refuses: the slides' equations as printed, lagged added mass, drag in absolute velocity, and
Langevin noise by Euler-Maruyama."""

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.body_rates import BodyRates, L, P, Q, X, cross, rotate, rotate_back
from warp_immersed.charts.integrators import loads, normalized, runge_kutta_4, times_vector

Array = NDArray[np.float64]


class LaggedAddedMass:
    """Semi-implicit Euler with the added mass as a force from the last step's acceleration, as a plug-in for an engine has it:
    it diverges wherever the added mass exceeds the mass, whatever the step.

    Args:
        rates: of the bodies.
        solid: (N, 6, 6) inertia without the fluid.
    """

    def __init__(self, rates: BodyRates, solid: Array):
        self._inverse = np.linalg.inv(solid)
        self._added = rates.inertia - solid
        self._acceleration = np.zeros((len(solid), 6))

    def __call__(self, rates: BodyRates, y: Array, h: float) -> Array:
        """One step."""
        dy = rates(y)
        pushed = dy[:, :6] - np.einsum("nij,nj->ni", self._added, self._acceleration)
        self._acceleration = np.einsum("nij,nj->ni", self._inverse, pushed)
        velocities = rates.velocities + h * self._acceleration
        moved = y + h * dy
        moved[:, :6] = np.einsum("nij,nj->ni", rates.inertia, velocities)
        moved[:, X] = y[:, X] + h * rotate(y[:, Q], velocities[:, :3])
        moved[:, Q] = y[:, Q] + 0.5 * h * times_vector(y[:, Q], velocities[:, 3:])
        return normalized(moved)


class PrintedEquations:
    """The slides' equations as printed, in still air, by RK4: the Kirchhoff term v x (M w) for w x (M v), and no drag.

    Args:
        rates: of the bodies.
        net_weights: (N,) of gravity after buoyancy.
    """

    def __init__(self, rates: BodyRates, net_weights: Array):
        self._inertia, self._inverse = rates.inertia, rates.inverse
        self._gravity = np.outer(net_weights, (0.0, -9.81, 0.0))

    def rates(self, y: Array) -> Array:
        """Rates of states (N, 25), in which the momenta are M v and J w."""
        dy = np.zeros_like(y)
        velocities = np.einsum("nij,nj->ni", self._inverse, y[:, :6])
        v, w = velocities[:, :3], velocities[:, 3:]
        dy[:, P] = -cross(v, np.einsum("nij,nj->ni", self._inertia[:, :3, :3], w)) + rotate_back(y[:, Q], self._gravity)
        added = y[:, P] - v  # the mass is 1
        dy[:, L] = -cross(w, y[:, L]) - cross(v, added)
        dy[:, Q] = 0.5 * times_vector(y[:, Q], w)
        dy[:, X] = rotate(y[:, Q], v)
        return dy

    def __call__(self, rates: BodyRates, y: Array, h: float) -> Array:
        """One step."""
        return runge_kutta_4(self.rates, y, h)


class AbsoluteVelocity:
    """RK4 with the relative velocity in the loads only, and the absolute one in Kirchhoff's terms, in a uniform wind.

    Args:
        rates: of the bodies.
        wind: (3,) [m/s].
    """

    def __init__(self, rates: BodyRates, wind: tuple[float, float, float]):
        self._rates = rates
        self._wind = np.tile(wind, (len(rates.inertia), 1))

    def rates(self, y: Array) -> Array:
        """Rates of states (N, 25), whose momenta are absolute."""
        body = self._rates
        wind = rotate_back(y[:, Q], self._wind)
        relative = y.copy()
        relative[:, :6] -= np.einsum("nij,nj->ni", body.inertia[:, :, :3], wind)
        dy = loads(body, relative)
        w = body.velocities[:, 3:]
        v = body.velocities[:, :3] + wind
        dy[:, P] += cross(y[:, P], w)
        dy[:, L] += cross(y[:, L], w) + cross(y[:, P], v)
        dy[:, Q] = 0.5 * times_vector(y[:, Q], w)
        dy[:, X] = rotate(y[:, Q], v)
        return dy

    def __call__(self, rates: BodyRates, y: Array, h: float) -> Array:
        """One step."""
        return runge_kutta_4(self.rates, y, h)


def variance_ratio(form: str, step: float, seed: int = 0, bodies: int = 2000) -> float:
    """Stationary variance of an Ornstein-Uhlenbeck process, over the exact one, by "Euler-Maruyama" or by "RK4, noise after"
    (the slides' standard Runge-Kutta) at a step in units of its time scale; inf where it grows without bound."""
    keep = 1.0 - step
    if form == "RK4, noise after":
        keep = 1.0 - step + step**2 / 2.0 - step**3 / 6.0 + step**4 / 24.0
    random = np.random.default_rng(seed)
    u = random.standard_normal(bodies)
    total, count = 0.0, 0
    settle = 20 + int(5.0 / step)
    for n in range(3 * settle):
        u = keep * u + np.sqrt(2.0 * step) * random.standard_normal(bodies)
        if not np.abs(u).max() < 1e3:
            return float("inf")
        if n >= settle:
            total, count = total + float((u**2).mean()), count + 1
    return total / count


def undamped_spin(times: Array, beta: float) -> Array:
    """Root mean square of a spin that takes d omega = beta dW and no damping, as printed, one component."""
    return beta * np.sqrt(times)
