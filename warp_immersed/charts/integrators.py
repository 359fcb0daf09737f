"""Fixed-step integrators that the product does not use, for charts that show why."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.body_rates import BodyRates, L, P, Q, X, cross, rotate

Array = NDArray[np.float64]
Step = Callable[[BodyRates, Array, float], Array]


def normalized(y: Array) -> Array:
    """The states with unit quaternions, in place."""
    y[:, Q] /= np.linalg.norm(y[:, Q], axis=1, keepdims=True)
    return y


def explicit_euler(rates: BodyRates, y: Array, h: float) -> Array:
    """y + h f(y)."""
    return normalized(y + h * rates(y))


def semi_implicit_euler(rates: BodyRates, y: Array, h: float) -> Array:
    """Momenta first, then orientation and position with the new velocities, as engines for games do it."""
    moved = y + h * rates(y)
    velocities = np.einsum("nij,nj->ni", rates.inverse, moved[:, :6])
    q = y[:, Q]
    moved[:, X] = y[:, X] + h * rotate(q, velocities[:, :3])
    moved[:, Q] = q + 0.5 * h * times_vector(q, velocities[:, 3:])
    return normalized(moved)


def runge_kutta_2(rates: BodyRates, y: Array, h: float) -> Array:
    """The midpoint rule."""
    return normalized(y + h * rates(y + 0.5 * h * rates(y)))


def runge_kutta_4(rates: Callable[[Array], Array], y: Array, h: float) -> Array:
    """The classical method at a fixed step."""
    a = rates(y)
    b = rates(y + 0.5 * h * a)
    c = rates(y + 0.5 * h * b)
    d = rates(y + h * c)
    return normalized(y + h / 6.0 * (a + 2.0 * (b + c) + d))


def strang_splitting(rates: BodyRates, y: Array, h: float) -> Array:
    """Half a step of the free body in exact pieces, a step of the loads by the midpoint rule, half a step of the free body.

    The pieces are the Lie-Poisson flows of the kinetic energy's translation and of its rotation about each axis (Hairer,
    Lubich & Wanner, ch. VII.5), which keep |p| and p.l; they need an inertia without coupling.
    """
    y = y.copy()
    for axis in range(3):
        turn(rates, y, 0.5 * h, axis)
    glide(rates, y, 0.5 * h)
    middle = y + 0.5 * h * loads(rates, y)
    y += h * loads(rates, middle)
    glide(rates, y, 0.5 * h)
    for axis in reversed(range(3)):
        turn(rates, y, 0.5 * h, axis)
    return normalized(y)


def loads(rates: BodyRates, y: Array) -> Array:
    """The rates without what a free body in an ideal fluid does."""
    dy = rates(y)
    velocities = rates.velocities
    dy[:, P] -= cross(y[:, P], velocities[:, 3:])
    dy[:, L] -= cross(y[:, L], velocities[:, 3:]) + cross(y[:, P], velocities[:, :3])
    dy[:, Q] = 0.0
    dy[:, X] = 0.0
    return dy


def glide(rates: BodyRates, y: Array, h: float) -> None:
    """The flow of the translational kinetic energy, in place."""
    velocity = y[:, P] / np.einsum("nii->ni", rates.inertia[:, :3, :3])
    y[:, L] += h * cross(y[:, P], velocity)
    y[:, X] += h * rotate(y[:, Q], velocity)


def turn(rates: BodyRates, y: Array, h: float, axis: int) -> None:
    """The flow of the kinetic energy of rotation about one axis, in place."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    angle = h * y[:, L.start + axis] / rates.inertia[:, 3 + axis, 3 + axis]
    cosine, sine = np.cos(angle), np.sin(angle)
    for part in (P.start, L.start):
        u, v = y[:, part + j].copy(), y[:, part + k].copy()
        y[:, part + j], y[:, part + k] = cosine * u + sine * v, cosine * v - sine * u
    half = np.zeros((len(y), 3))
    half[:, axis] = np.sin(0.5 * angle)
    q = y[:, Q].copy()
    y[:, Q] = q * np.cos(0.5 * angle)[:, None] + times_vector(q, half)


def times_vector(q: Array, v: Array) -> Array:
    """Products (N, 4) of quaternions q (N, 4) and (v, 0), v (N, 3)."""
    u, w = q[:, :3], q[:, 3:]
    return np.concatenate([w * v + cross(u, v), -(u * v).sum(axis=1, keepdims=True)], axis=1)


# The step and what it costs in evaluations of the loads; the exact pieces of a splitting take as long as two.
INTEGRATORS: dict[str, tuple[Step, int]] = {
    "explicit Euler": (explicit_euler, 1),
    "semi-implicit Euler": (semi_implicit_euler, 1),
    "RK2": (runge_kutta_2, 2),
    "RK4, fixed step": (runge_kutta_4, 4),
    "Strang splitting": (strang_splitting, 4),
}


def needs_diagonal(step: Step) -> bool:
    """Whether an integrator cannot take a body whose translation and rotation are coupled."""
    return step is strang_splitting
