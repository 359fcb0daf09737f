"""What homogeneous turbulence is to a body of a certain size (kernels/langevin.py has the same, point by point)."""

from dataclasses import dataclass
from math import exp, inf, pi, sqrt

from warp_immersed.fluid import Fluid
from warp_immersed.turbulence import HomogeneousTurbulence, lagrangian_time_scale

# E(kappa) = C eps^(2/3) kappa^(-5/3) with C = 1.5 holds 3/2 C eps^(2/3) kappa^(-2/3) beyond kappa (Pope, Turbulent Flows, 6.239).
INERTIAL_ENERGY = 2.25
# The energy of motions averaged over a large body falls as (size)^-3, the inverse of its volume.
LARGE_BODY_POWER = 4.5
# Time scale of the vorticity that a body sees, in units of its inverse: in fluid followed without a body, 5 to 7.
VORTICITY_TIME = 5.0


@dataclass(frozen=True)
class SeenTurbulence:
    """Fluctuations that a body feels, one component each: velocity_rms [m/s] with time_scale [s], and rotation_rms
    [rad/s] of the air about it with rotation_time_scale [s]; an endless time scale is a frozen fluctuation."""

    velocity_rms: float
    time_scale: float
    rotation_rms: float
    rotation_time_scale: float


def kept_energy(turbulence: HomogeneousTurbulence, size: float) -> float:
    """Share of k in eddies larger than a body of this size [m], in (0, 1].

    (1 + s / n)^(-n) with n = 9/2 and s = 2.25 (eps size / pi)^(2/3) / k, the share that Kolmogorov's spectrum has beyond the
    wave number pi / size: exact where s is small, and falling as size^-3 where the body is larger than all eddies.
    """
    return (1.0 + small_eddies(turbulence, size) / LARGE_BODY_POWER) ** -LARGE_BODY_POWER


def small_eddies(turbulence: HomogeneousTurbulence, size: float) -> float:
    """Energy of the inertial range beyond the wave number pi / size, over k."""
    return float(INERTIAL_ENERGY * (turbulence.epsilon * size / pi) ** (2.0 / 3.0) / turbulence.k)


def seen_turbulence(turbulence: HomogeneousTurbulence, fluid: Fluid, size: float) -> SeenTurbulence:
    """Statistics of the air that a body of a size [m] sees.

    Velocity: variance 2 k' / 3 with k' the energy of eddies larger than the body; their time scale is T_L (2 - k' / k), so
    that small bodies keep the diffusivity sigma^2 T_L to first order. Rotation: half the vorticity of the flow
    averaged over the body, <w^2> = 1 / (1 / (k s (pi / size)^2) + nu / eps) k' / k, the inertial range's up to pi / size, or
    all of it, eps / nu, where the body is smaller than the smallest eddies.
    """
    k, epsilon = turbulence.k, turbulence.epsilon
    if k == 0.0:
        return SeenTurbulence(0.0, 0.0, 0.0, 0.0)
    if epsilon == 0.0:
        return SeenTurbulence(turbulence.velocity_rms, inf, 0.0, inf)
    kept = kept_energy(turbulence, size)
    inertial = k * small_eddies(turbulence, size) * (pi / size) ** 2
    vorticity = sqrt(kept / (1.0 / inertial + fluid.kinematic_viscosity / epsilon))
    return SeenTurbulence(
        velocity_rms=turbulence.velocity_rms * sqrt(kept),
        time_scale=lagrangian_time_scale(turbulence, fluid) * (2.0 - kept),
        rotation_rms=vorticity / sqrt(12.0),
        rotation_time_scale=VORTICITY_TIME / vorticity,
    )


def decay_over(step: float, time_scale: float) -> float:
    """exp(-step / T); 0 without a time scale, 1 with an endless one."""
    return exp(-step / time_scale) if time_scale > 0.0 else 0.0


def step_average(step: float, time_scale: float) -> float:
    """Ratio of the rms of an Ornstein-Uhlenbeck process averaged over a step to its own rms."""
    if time_scale == 0.0 or step / time_scale < 1e-3:
        return 1.0
    passed = step / time_scale
    return sqrt(2.0 * (passed - 1.0 + exp(-passed)) / passed**2)
