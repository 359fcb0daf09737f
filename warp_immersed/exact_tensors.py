"""Added-mass (Kirchhoff) tensors known in closed form, and how a tensor moves with its reference point.

All tensors are (6, 6), linear then angular, [[M, D], [D^T, J]] in [kg, kg m, kg m^2], so that the kinetic energy of
the fluid around a body with velocity v and angular velocity w is (v, w) . K (v, w) / 2.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ellipe, ellipk, elliprd

Array = NDArray[np.float64]


def ellipsoid_tensor(semi_axes: ArrayLike, density: float) -> Array:
    """Tensor of an ellipsoid about its centre, in its axes.

    semi_axes: (3,) [m]; density of the fluid [kg/m^3].
    Lamb, Hydrodynamics, 6th ed., art. 114-115, with alpha_0 = 2/3 abc R_D(b^2, c^2, a^2) (Carlson's integral).
    """
    axes = np.asarray(semi_axes, dtype=np.float64)
    displaced = density * 4.0 / 3.0 * np.pi * axes.prod()
    squares = axes**2
    # alpha_0, beta_0, gamma_0; they add up to 2, and 2 - alpha_0 is taken as beta_0 + gamma_0 to keep digits.
    shape_factors = np.array([2.0 / 3.0 * axes.prod() * elliprd(*np.delete(squares, i), squares[i]) for i in range(3)])
    tensor = np.zeros((6, 6))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        tensor[i, i] = displaced * shape_factors[i] / (shape_factors[j] + shape_factors[k])
        difference, total = squares[j] - squares[k], squares[j] + squares[k]
        if difference != 0.0:
            lag = shape_factors[k] - shape_factors[j]
            tensor[3 + i, 3 + i] = displaced / 5.0 * difference**2 * lag / (2.0 * difference - total * lag)
    return tensor


def elliptic_sheet_tensor(a: float, b: float, density: float) -> Array:
    """Tensor of an infinitely thin elliptic plate about its centre; x along a, y along b, normal z.

    a, b: semi-axes [m]; density of the fluid [kg/m^3]. The limit of Lamb's ellipsoid for c -> 0: 8/3 rho a^3 and
    16/45 rho a^5 for a disk (Lamb, art. 108 and 102).
    """
    if a < b:
        swap = [1, 0, 2, 4, 3, 5]
        return elliptic_sheet_tensor(b, a, density)[np.ix_(swap, swap)]
    tensor = np.zeros((6, 6))
    if a - b < 1e-7 * a:
        tensor[2, 2] = 8.0 / 3.0 * density * a**3
        tensor[3, 3] = tensor[4, 4] = 16.0 / 45.0 * density * a**5
        return tensor
    m = 1.0 - (b / a) ** 2
    first, second = ellipk(m), ellipe(m)
    alpha = 2.0 * b * (first - second) / (a**2 * m)
    beta = 2.0 * (second - (1.0 - m) * first) / (b * m)
    tensor[2, 2] = 4.0 / 3.0 * np.pi * density * a * b**2 / second
    tensor[3, 3] = 8.0 / 15.0 * np.pi * density * a * b**3 / (alpha + 2.0 * beta)
    tensor[4, 4] = 8.0 / 15.0 * np.pi * density * a**3 * b / (2.0 * alpha + beta)
    return tensor


def cross_matrix(r: ArrayLike) -> Array:
    """S(r) with S(r) w = r x w."""
    x, y, z = np.asarray(r, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def shifted_tensor(tensor: Array, offset: ArrayLike) -> Array:
    """The same tensor about another point: `offset` (3,) [m] leads from the new reference point to the old one.

    The velocity of the old point is v + w x offset, so K' = X^T K X with X = [[1, -S(offset)], [0, 1]].
    """
    transform = np.eye(6)
    transform[:3, 3:] = -cross_matrix(offset)
    return transform.T @ tensor @ transform
