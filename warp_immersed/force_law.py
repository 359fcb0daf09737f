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
from warp_immersed.mass_properties import triangle_moments
from warp_immersed.shape import Shape

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlateCoefficients:
    """Numbers of the plate law. Those of a disk were fitted by benchmarks/calibrate.py; docs/physics.md says to what.

    Drag: broadside, edge-on, what comes between them, and friction as a multiple of the Stokes drag edge-on. Lift:
    translational and rotational, the Reynolds number below which it dies out, its lag in radii travelled. What separation
    takes of the Munk moment, edge-on and broadside. Damping about the diameters: by speed at oblique incidence, by spin, and
    as a multiple of the Stokes torque; about the direction of flight (roll) and about the normal (yaw).
    """

    broadside_drag: float = 1.15
    edge_drag: float = 0.183
    oblique_drag: float = 1.1
    edge_friction: float = 3.03
    translational_lift: float = 1.39
    rotational_lift: float = 1.01
    lift_onset_reynolds: float = 81.1
    lift_lag: float = 0.862
    munk_cut_edge: float = 0.701
    munk_cut_broadside: float = 0.931
    damping_oblique: float = 0.0665
    damping_by_spin: float = 0.00344
    damping_viscous: float = 2.65
    # From slender-wing theory: C_lp = -pi AR / 32 (R. T. Jones, NACA Report 835, 1946). Without it a tumbling disk comes to
    # fall along its own axis, edge-on and twice too fast.
    roll_damping: float = np.pi / 8.0
    yaw_damping_by_speed: float = 0.02
    yaw_damping_by_spin: float = 0.01


CALIBRATED_PLATE = PlateCoefficients()

# Broadside at Re < 133: C_D = 64 / (pi Re) + 3.157 / Re^(1/2) + 0.742, times the ratio of the broadside drag to the 1.17
# of Clift, Grace & Weber, Bubbles, Drops and Particles (1978), whose disk drag it follows within 5 %.
DISK_ROOT_DRAG = 3.157
DISK_LOW_DRAG = 0.742
DISK_HIGH_DRAG = 1.17
# Spheres: C_D = 24 / Re + 4.9 / Re^(1/2) + 0.34, within 6 % of Schiller & Naumann up to Re 300 and 0.39 at Re 10^4.
SPHERE_ROOT_DRAG = 4.9
SPHERE_QUADRATIC_DRAG = 0.34


@dataclass(frozen=True)
class LoadCoefficients:
    """Coefficients of `quasi_steady_load` for one body, in SI units (not divided by mass), in its principal axes.

    pressure_center (3,) [m] from the centre of mass; drag_linear (3,) [kg/s], drag_root (3,) [kg/(m s)^(1/2)],
    drag_quadratic (3,), drag_oblique and drag_broadside [kg/m]; lift [kg/m], circulation (3,) [kg], lift_onset_cubed
    [m^3/s^3], lift_lag [1/m]; munk_cut_edge and munk_cut_swing [1]; damping_linear (3,) [kg m^2/s], damping_speed and
    damping_oblique (3,) [kg m], damping_spin (3,) [kg m^2], damping_roll [kg m].
    """

    pressure_center: Array
    drag_linear: Array
    drag_root: Array
    drag_quadratic: Array
    drag_oblique: float
    drag_broadside: float
    lift: float
    circulation: Array
    lift_onset_cubed: float
    lift_lag: float
    munk_cut_edge: float
    munk_cut_swing: float
    damping_linear: Array
    damping_speed: Array
    damping_oblique: Array
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


def outline_spread(shape: Shape) -> float:
    """Second moment of a sheet's outline about its centre over that of the ellipse of equal area: 1 for an ellipse, 1.05 for a
    square, 1.21 for a triangle; at most 1.5."""
    if shape.form != "mesh" or not shape.is_sheet:
        return 1.0
    triangles = shape.mesh.triangles
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area, first, second = triangle_moments(triangles, np.abs(normals[:, 2]) / np.linalg.norm(normals, axis=1))
    spread = np.diag(second) / area - (first / area) ** 2
    a, b, _ = shape.semi_axes
    return float(np.clip((spread[0] + spread[1]) / ((a**2 + b**2) / 4.0), 1.0, 1.5))


def quasi_steady_coefficients(shape: Shape, fluid: Fluid, law: PlateCoefficients = CALIBRATED_PLATE) -> LoadCoefficients:
    """Load coefficients of a shape in a fluid, from the ellipse or ellipsoid that stands for it (`Shape.semi_axes`)."""
    a, b, c = shape.semi_axes
    rho, nu = fluid.density, fluid.kinematic_viscosity
    plate = flatness(shape)
    compact = 1.0 - plate
    planform, frontal = np.pi * a * b, np.pi * np.array([b * c, a * c, a * b])
    # the disk's radius: that of the disk itself, 2^(1/2) times the short semi-axis of a long ellipse
    radius = a * b / np.sqrt((a**2 + b**2) / 2.0)
    stokes_drag, stokes_torque = stokes_resistance(shape.semi_axes, fluid.dynamic_viscosity)
    friction = np.array([law.edge_friction, law.edge_friction, 1.0])
    viscous = np.array([law.damping_viscous, law.damping_viscous, 1.0])
    low = law.broadside_drag / DISK_HIGH_DRAG
    disk_root = np.array([0.0, 0.0, low * DISK_ROOT_DRAG]) * np.sqrt(nu / (2.0 * radius)) * planform
    sphere_root = SPHERE_ROOT_DRAG * np.sqrt(nu / (2.0 * (a * b * c) ** (1.0 / 3.0))) * frontal
    disk_quadratic = np.array([law.edge_drag, law.edge_drag, low * DISK_LOW_DRAG]) * planform
    # Strip integrals of the ellipse. Polygons of one paper turn as fast as disks of their area although their inertia is
    # larger, so what lies beyond the ellipse is taken off the damping.
    flap = 16.0 * np.pi / 15.0 * plate / outline_spread(shape) ** 2
    by_speed, by_spin = flap * np.array([a * b**3, b * a**3, 0.0]), flap * np.array([a * b**4, b * a**4, 0.0])
    yaw = 0.5 * a * b * (a**2 + b**2) * np.array([compact, compact, 1.0])
    return LoadCoefficients(
        pressure_center=shape.geometric_center,
        drag_linear=stokes_drag * (plate * friction + compact),
        drag_root=0.5 * rho * (plate * disk_root + compact * sphere_root),
        drag_quadratic=0.5 * rho * (plate * disk_quadratic + compact * SPHERE_QUADRATIC_DRAG * frontal),
        drag_oblique=0.5 * rho * planform * plate * law.oblique_drag,
        drag_broadside=0.5 * rho * planform * plate * law.broadside_drag,
        lift=rho * plate * law.translational_lift * planform,
        circulation=rho * plate * law.rotational_lift * 8.0 / 3.0 * np.array([a * b**2, b * a**2, 0.0]),
        lift_onset_cubed=(law.lift_onset_reynolds * nu / (2.0 * radius)) ** 3,
        lift_lag=1.0 / (law.lift_lag * radius),
        munk_cut_edge=plate * law.munk_cut_edge,
        munk_cut_swing=plate * (law.munk_cut_broadside - law.munk_cut_edge),
        damping_linear=stokes_torque * (plate * viscous + compact),
        damping_speed=rho * law.yaw_damping_by_speed * yaw,
        damping_oblique=rho * law.damping_oblique * by_speed,
        damping_spin=rho * (law.damping_by_spin * by_spin + law.yaw_damping_by_spin * radius * yaw),
        damping_roll=rho * plate * law.roll_damping * a**2 * b**2,
    )
