"""Coefficients of the quasi-steady fluid loads of a shape in a fluid (see kernels/aerodynamics.py for the law).

Flat bodies follow the plate law of Andersen, Pesavento & Wang, J. Fluid Mech. 541 (2005) 65, carried over to ellipses
by integrating it over strips; compact bodies follow the sphere's drag; `flatness` blends between the two. At small
Reynolds numbers every body has the exact Stokes resistance of its ellipsoid.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import elliprd, elliprf

from warp_immersed.fluid import Fluid
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

# Plates: C_D = A - B cos(2 angle), between A - B edge-on and A + B broadside.
PLATE_DRAG_MEAN = 0.64
PLATE_DRAG_SWING = 0.53
TRANSLATIONAL_LIFT = 0.9
ROTATIONAL_LIFT = 1.5
DAMPING_BY_SPEED = 0.05
DAMPING_BY_SPIN = 0.05
YAW_DAMPING_BY_SPEED = 0.02
YAW_DAMPING_BY_SPIN = 0.01
# Spheres: C_D = 24 / Re + 4.4 / Re^(1/2) + 0.36, within 5 % of Schiller & Naumann up to Re 800 and 0.41 at 10^4.
SPHERE_ROOT_DRAG = 4.4
SPHERE_QUADRATIC_DRAG = 0.36


@dataclass(frozen=True)
class LoadCoefficients:
    """Coefficients of `quasi_steady_load` for one body, in SI units (not divided by mass), in its principal axes.

    drag_linear (3,) [kg/s], drag_root (3,) [kg/(m s)^(1/2)], drag_quadratic (3,) [kg/m], lift [kg/m],
    circulation (3,) [kg], damping_linear (3,) [kg m^2/s], damping_speed (3,) [kg m], damping_spin (3,) [kg m^2];
    pressure_center (3,) [m] from the centre of mass.
    """

    pressure_center: Array
    drag_linear: Array
    drag_root: Array
    drag_quadratic: Array
    lift: float
    circulation: Array
    damping_linear: Array
    damping_speed: Array
    damping_spin: Array


def stokes_resistance(semi_axes: ArrayLike, dynamic_viscosity: float) -> tuple[Array, Array]:
    """Exact creeping-flow resistance of an ellipsoid: drag per speed (3,) [kg/s], torque per spin (3,) [kg m^2/s].

    Oberbeck (1876), Edwardes (1892); Happel & Brenner, Low Reynolds Number Hydrodynamics, sec. 5-11. semi_axes (3,) [m].
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
    rho = fluid.density
    plate = flatness(shape)
    compact = 1.0 - plate
    drag_linear, damping_linear = stokes_resistance(shape.semi_axes, fluid.dynamic_viscosity)
    planform = np.pi * a * b
    frontal = np.pi * np.array([b * c, a * c, a * b])
    edge, broadside = PLATE_DRAG_MEAN - PLATE_DRAG_SWING, PLATE_DRAG_MEAN + PLATE_DRAG_SWING
    plate_drag = planform * np.array([edge, edge, broadside])
    diameter = 2.0 * (a * b * c) ** (1.0 / 3.0)
    root = SPHERE_ROOT_DRAG * np.sqrt(fluid.kinematic_viscosity / diameter)
    yaw = 0.5 * a * b * (a**2 + b**2)
    flap = 16.0 * np.pi / 15.0 * plate
    radius = np.sqrt((a**2 + b**2) / 2.0)
    return LoadCoefficients(
        pressure_center=shape.geometric_center,
        drag_linear=drag_linear,
        drag_root=0.5 * rho * compact * root * frontal,
        drag_quadratic=0.5 * rho * (plate * plate_drag + compact * SPHERE_QUADRATIC_DRAG * frontal),
        lift=rho * plate * TRANSLATIONAL_LIFT * planform,
        circulation=rho * plate * ROTATIONAL_LIFT * 8.0 / 3.0 * np.array([a * b**2, b * a**2, 0.0]),
        damping_linear=damping_linear,
        damping_speed=rho
        * (flap * DAMPING_BY_SPEED * np.array([a * b**3, b * a**3, 0.0]) + YAW_DAMPING_BY_SPEED * yaw * np.array([compact, compact, 1.0])),
        damping_spin=rho
        * (
            flap * DAMPING_BY_SPIN * np.array([a * b**4, b * a**4, 0.0])
            + YAW_DAMPING_BY_SPIN * yaw * radius * np.array([compact, compact, 1.0])
        ),
    )
