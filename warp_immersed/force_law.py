"""Coefficients of the fluid loads of a shape in a fluid (see kernels/aerodynamics.py for the law).

Flat bodies follow a plate law calibrated on falling paper disks; it is carried over to ellipses by integrating it over
strips. Compact bodies follow the sphere's drag. `flatness` blends between the two. At small Reynolds numbers a
compact body has the exact Stokes resistance of its ellipsoid, and so has a plate broadside.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import elliprd, elliprf

from warp_immersed.fluid import Fluid
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

# Disks: fitted to 442 stereo-tracked drops of paper disks (Howison, Hughes & Iida, Nature Machine Intelligence 2020)
# and to the regime map of Field et al., Nature 388 (1997) 252.
BROADSIDE_DRAG = 1.221
EDGE_DRAG = 0.230
EDGE_FRICTION = 2.593  # times the Stokes drag edge-on
TRANSLATIONAL_LIFT = 1.141
ROTATIONAL_LIFT = 0.938
LIFT_ONSET_REYNOLDS = 68.8
LIFT_LAG = 0.666  # radii travelled
MUNK_CUT_EDGE = 0.706
MUNK_CUT_BROADSIDE = 0.961
DAMPING_BY_SPEED = 0.038
DAMPING_BY_SPIN = 0.025
DAMPING_VISCOUS = 1.636  # times the Stokes torque about a diameter
# Spin about the direction of flight, from slender-wing theory: C_lp = -pi AR / 32 (R. T. Jones, NACA Report 835, 1946).
# Without it a tumbling disk comes to fall along its own axis, edge-on and twice too fast.
ROLL_DAMPING = np.pi / 8.0
YAW_DAMPING_BY_SPEED = 0.02
YAW_DAMPING_BY_SPIN = 0.01
# Broadside at Re < 133: C_D = 64 / (pi Re) + 3.157 / Re^(1/2) + 0.742, times the ratio of BROADSIDE_DRAG to the 1.17
# of Clift, Grace & Weber, Bubbles, Drops and Particles (1978), whose disk drag it follows within 5 %.
DISK_ROOT_DRAG = 3.157
DISK_LOW_DRAG = 0.742
DISK_HIGH_DRAG = 1.17
# Spheres: C_D = 24 / Re + 4.4 / Re^(1/2) + 0.36, within 5 % of Schiller & Naumann up to Re 300 and 0.41 at Re 10^4.
SPHERE_ROOT_DRAG = 4.4
SPHERE_QUADRATIC_DRAG = 0.36


@dataclass(frozen=True)
class LoadCoefficients:
    """Coefficients of `quasi_steady_load` for one body, in SI units (not divided by mass), in its principal axes.

    pressure_center (3,) [m] from the centre of mass; drag_linear (3,) [kg/s], drag_root (3,) [kg/(m s)^(1/2)],
    drag_quadratic (3,) [kg/m], drag_broadside [kg/m]; lift [kg/m], circulation (3,) [kg], lift_onset_cubed [m^3/s^3], lift_lag
    [1/m]; munk_cut_edge and munk_cut_swing [1]; damping_linear (3,) [kg m^2/s], damping_speed (3,) [kg m], damping_spin
    (3,) [kg m^2], damping_roll [kg m].
    """

    pressure_center: Array
    drag_linear: Array
    drag_root: Array
    drag_quadratic: Array
    drag_broadside: float
    lift: float
    circulation: Array
    lift_onset_cubed: float
    lift_lag: float
    munk_cut_edge: float
    munk_cut_swing: float
    damping_linear: Array
    damping_speed: Array
    damping_spin: Array
    damping_roll: float


def stokes_resistance(semi_axes: ArrayLike, dynamic_viscosity: float) -> tuple[Array, Array]:
    """Exact creeping-flow resistance of an ellipsoid: drag per speed (3,) [kg/s], torque per spin (3,) [kg m^2/s].

    Oberbeck (1876), Edwardes (1892); Happel & Brenner, Low Reynolds Number Hydrodynamics, sec. 5-11. semi_axes (3,) [m],
    dynamic_viscosity [Pa s].
    """
    axes = np.asarray(semi_axes, dtype=np.float64)
    squares = axes**2
    chi = 2.0 * elliprf(*squares)
    integrals = np.array([2.0 / 3.0 * elliprd(*np.delete(squares, i), squares[i]) for i in range(3)])
    drag = 16.0 * np.pi * dynamic_viscosity / (chi + integrals * squares)
    torque = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moment = squares[j] * integrals[j] + squares[k] * integrals[k]
        torque[i] = 16.0 / 3.0 * np.pi * dynamic_viscosity * (squares[j] + squares[k]) / moment
    return drag, torque


def flatness(shape: Shape) -> float:
    """1 for an infinitely thin plate, 0 for a sphere or a body of revolution about its long axis: 1 - c / b."""
    _, b, c = shape.semi_axes
    return float(np.clip(1.0 - c / b, 0.0, 1.0))


def quasi_steady_coefficients(shape: Shape, fluid: Fluid) -> LoadCoefficients:
    """Load coefficients of a shape in a fluid, from the ellipse or ellipsoid that stands for it (`Shape.semi_axes`)."""
    a, b, c = shape.semi_axes
    rho, nu = fluid.density, fluid.kinematic_viscosity
    plate = flatness(shape)
    compact = 1.0 - plate
    planform, frontal = np.pi * a * b, np.pi * np.array([b * c, a * c, a * b])
    # the disk's radius: that of the disk itself, 2^(1/2) times the short semi-axis of a long ellipse
    radius = a * b / np.sqrt((a**2 + b**2) / 2.0)
    stokes_drag, stokes_torque = stokes_resistance(shape.semi_axes, fluid.dynamic_viscosity)
    friction = np.array([EDGE_FRICTION, EDGE_FRICTION, 1.0])
    viscous = np.array([DAMPING_VISCOUS, DAMPING_VISCOUS, 1.0])
    low = BROADSIDE_DRAG / DISK_HIGH_DRAG
    disk_root = np.array([0.0, 0.0, low * DISK_ROOT_DRAG]) * np.sqrt(nu / (2.0 * radius)) * planform
    sphere_root = SPHERE_ROOT_DRAG * np.sqrt(nu / (2.0 * (a * b * c) ** (1.0 / 3.0))) * frontal
    disk_quadratic = np.array([EDGE_DRAG, EDGE_DRAG, low * DISK_LOW_DRAG]) * planform
    flap = 16.0 * np.pi / 15.0 * plate
    yaw = 0.5 * a * b * (a**2 + b**2) * np.array([compact, compact, 1.0])
    return LoadCoefficients(
        pressure_center=shape.geometric_center,
        drag_linear=stokes_drag * (plate * friction + compact),
        drag_root=0.5 * rho * (plate * disk_root + compact * sphere_root),
        drag_quadratic=0.5 * rho * (plate * disk_quadratic + compact * SPHERE_QUADRATIC_DRAG * frontal),
        drag_broadside=0.5 * rho * planform * plate * BROADSIDE_DRAG,
        lift=rho * plate * TRANSLATIONAL_LIFT * planform,
        circulation=rho * plate * ROTATIONAL_LIFT * 8.0 / 3.0 * np.array([a * b**2, b * a**2, 0.0]),
        lift_onset_cubed=(LIFT_ONSET_REYNOLDS * nu / (2.0 * radius)) ** 3,
        lift_lag=1.0 / (LIFT_LAG * radius),
        munk_cut_edge=plate * MUNK_CUT_EDGE,
        munk_cut_swing=plate * (MUNK_CUT_BROADSIDE - MUNK_CUT_EDGE),
        damping_linear=stokes_torque * (plate * viscous + compact),
        damping_speed=rho * (flap * DAMPING_BY_SPEED * np.array([a * b**3, b * a**3, 0.0]) + YAW_DAMPING_BY_SPEED * yaw),
        damping_spin=rho * (flap * DAMPING_BY_SPIN * np.array([a * b**4, b * a**4, 0.0]) + YAW_DAMPING_BY_SPIN * yaw * radius),
        damping_roll=rho * plate * ROLL_DAMPING * a**2 * b**2,
    )
