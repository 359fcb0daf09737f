"""Turbulence that bodies feel: none, or homogeneous with given k and epsilon."""

from dataclasses import dataclass

import numpy as np

from warp_immersed.errors import InputError
from warp_immersed.fluid import Fluid


@dataclass(frozen=True)
class HomogeneousTurbulence:
    """Statistically steady, homogeneous, isotropic turbulence.

    Args:
        k: turbulent kinetic energy [m^2/s^2], >= 0.
        epsilon: its dissipation rate [m^2/s^3], >= 0. Zero freezes the wind that each body sees.

    Raises:
        InputError: a value is negative or not finite.
    """

    k: float
    epsilon: float

    def __post_init__(self) -> None:
        for name in ("k", "epsilon"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"turbulence {name}: found {value!r}, must be a number >= 0")

    @property
    def velocity_rms(self) -> float:
        """Standard deviation of one velocity component, (2 k / 3)^(1/2) [m/s]."""
        return float(np.sqrt(2.0 * self.k / 3.0))


STILL = HomogeneousTurbulence(0.0, 0.0)

# C0 at large Reynolds numbers.
LARGEST_C0 = 6.5


def kolmogorov_constant(reynolds: float) -> float:
    """Lagrangian Kolmogorov constant C0(Re) = 6.5 (1 + 140 Re^(-4/3))^(-3/4) (Xie & Miyata's slides).

    In the literature its argument is the Taylor-scale Reynolds number (Sawford, Phys. Fluids A 3 (1991) 1577).
    """
    if reynolds <= 0.0:
        return 0.0
    return float(LARGEST_C0 * (1.0 + 140.0 * reynolds ** (-4.0 / 3.0)) ** -0.75)


def taylor_reynolds(turbulence: HomogeneousTurbulence, fluid: Fluid) -> float:
    """R_lambda = k (20 / (3 nu epsilon))^(1/2), Pope, Turbulent Flows, eq. 6.63-6.65."""
    if turbulence.epsilon == 0.0:
        return float("inf")
    return float(turbulence.k * np.sqrt(20.0 / (3.0 * fluid.kinematic_viscosity * turbulence.epsilon)))


def lagrangian_time_scale(turbulence: HomogeneousTurbulence, fluid: Fluid) -> float:
    """T_L [s] of the wind seen in turbulence whose k does not change: 1 / T_L = 3/4 C0 epsilon / k.

    The printed rate (1/2 + 3/4 C0) epsilon / k belongs to decaying turbulence; with a constant k it would lose the
    variance 2 k / 3 by the factor C0 / (C0 + 2/3). Zero where there is no turbulence, infinite where epsilon is zero.
    """
    if turbulence.k == 0.0:
        return 0.0
    c0 = kolmogorov_constant(taylor_reynolds(turbulence, fluid))
    rate = 0.75 * c0 * turbulence.epsilon / turbulence.k
    return float("inf") if rate == 0.0 else 1.0 / rate
