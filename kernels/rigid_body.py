"""What a body is to the device, and Kirchhoff's equations in the velocity relative to the seen air.

Everything is divided by the body's own mass, so that a snow flake and a boulder sit in the same range of float32:
"momentum" is [m/s], "angular momentum" [m^2/s], "force" [m/s^2], "torque" [m^2/s^2]. Body axes throughout.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# What a body is doing. A settling body touches the ground but has not come to rest.
WAITING = 0
MOVING = 1
LANDED = 2
FAILED = 3
SETTLING = 4


def _structs(real):
    vec3 = wp.types.vector(3, real)
    mat33 = wp.types.matrix((3, 3), real)

    @wp.struct
    class Loads:  # aerodynamics.py
        pressure_center: vec3  # where they act [m]
        drag_linear: vec3  # [1/s]
        drag_root: vec3  # [1/(m s)^(1/2)]
        drag_quadratic: vec3  # [1/m]
        drag_oblique: real  # [1/m], at angles between edge-on and broadside
        drag_broadside: real  # [1/m], least quadratic drag along z
        lift: real  # [1/m]
        circulation: vec3  # [1]
        lift_onset_cubed: real  # cube of the speed below which viscosity takes the lift [m^3/s^3]
        lift_lag: real  # lift follows within 1 / (lag V) [1/m]; 0: at once
        munk_mass: vec3  # added mass along the axes [1]
        munk_cut_edge: real  # part of its Munk moment that separation takes, edge-on ...
        munk_cut_swing: real  # ... and how much more broadside
        damping_linear: vec3  # [m^2/s]
        damping_speed: vec3  # [m]
        damping_oblique: vec3  # [m]
        damping_spin: vec3  # [m^2]
        damping_roll: real  # of the spin about the direction of flight [m]

    @wp.struct
    class Plate:
        axes: mat33  # its axes as columns, in those of the body; the normal is the third
        loads: Loads  # in its own axes

    @wp.struct
    class BodyKind:
        # mass + added mass, about the centre of mass, over the mass: p = M r + D w, l = D^T r + J w
        linear_inertia: mat33  # M
        coupling: mat33  # D
        angular_inertia: mat33  # J
        # blocks of the inverse: r = A p + B l, w = B^T p + C l
        inverse_linear: mat33  # A
        inverse_coupling: mat33  # B
        inverse_angular: mat33  # C
        net_weight: real  # 1 - rho V / m, what gravity keeps after buoyancy
        buoyancy_arm: vec3  # -rho V / m times the centre of buoyancy [m]
        loads: Loads  # of the whole as one plate or solid
        # plates of a body that is not flat (state_rates.py)
        first_plate: wp.int32
        plate_count: wp.int32
        # fastest rates, for the substep rule: linear + root * V^(1/2) + speed * V + spin * |w|
        rate_linear: real  # [1/s]
        rate_root: real  # [1/(m s)^(1/2)]
        rate_speed: real  # [1/m]
        rate_spin: real  # [1]
        rate_start: real  # [1/s], for a body at rest that gravity is about to move
        # the air it sees (langevin.py): its size, and in homogeneous turbulence what a wind step does
        eddy_size: wp.float32  # eddies smaller than this are averaged out [m]
        wind_sigma: wp.float32  # [m/s]
        wind_decay: wp.float32
        rotation_sigma: wp.float32  # [rad/s]
        rotation_decay: wp.float32
        # as a point (point_mass.py)
        point_inertia: real  # mass and mean added mass
        point_drag: vec3  # per speed, its root and its square: [1/s], [1/(m s)^(1/2)], [1/m]
        tumbling: real  # spin per relative speed [1/m]
        fall_speed: real  # terminal [m/s]
        fall_velocity: vec3
        glide: real  # sideways speed over speed, across the axis of tumbling
        # resting on the ground (ground.py)
        bounding_radius: real  # [m]
        settling_rate: real  # [1/s]
        friction: real  # deceleration of a sliding body [m/s^2]
        first_support: wp.int32
        support_count: wp.int32
        first_rest: wp.int32
        rest_count: wp.int32
        first_body: wp.int32
        random_key: wp.uint32

    @wp.struct
    class Environment:
        gravity: vec3  # [m/s^2]
        mean_wind: vec3  # [m/s]
        wind_step: real  # time between updates of the seen wind [s]
        wind_steps: wp.int32  # updates in a frame
        wind_varies: wp.int32  # whether mean and turbulence depend on the place
        viscosity: real  # kinematic [m^2/s]
        has_ground: wp.int32
        has_ground_mesh: wp.int32
        ground_height: real  # [m]
        seed: wp.uint32

    return BodyKind, Plate, Environment


BodyKind, Plate, Environment = _structs(wp.float32)
BodyKind64, Plate64, Environment64 = _structs(wp.float64)


@wp.func
def velocities(kind: Any, momentum: Any, angular_momentum: Any):
    """Relative velocity [m/s] and angular velocity [rad/s] from the momenta."""
    velocity = kind.inverse_linear * momentum + kind.inverse_coupling * angular_momentum
    angular_velocity = wp.transpose(kind.inverse_coupling) * momentum + kind.inverse_angular * angular_momentum
    return velocity, angular_velocity


@wp.func
def momenta(kind: Any, velocity: Any, angular_velocity: Any):
    """Momentum and angular momentum, added mass included, from the velocities."""
    momentum = kind.linear_inertia * velocity + kind.coupling * angular_velocity
    angular_momentum = wp.transpose(kind.coupling) * velocity + kind.angular_inertia * angular_velocity
    return momentum, angular_momentum


@wp.func
def kirchhoff_rates(momentum: Any, angular_momentum: Any, velocity: Any, angular_velocity: Any):
    """Inertial part of dp/dt and dl/dt (Lamb, Hydrodynamics, 6th ed., art. 124): p x w and l x w + p x v."""
    return (
        wp.cross(momentum, angular_velocity),
        wp.cross(angular_momentum, angular_velocity) + wp.cross(momentum, velocity),
    )


@wp.func
def buoyant_load(kind: Any, gravity: Any):
    """Force and torque of gravity and buoyancy; gravity in body axes, less the acceleration of the seen air."""
    return kind.net_weight * gravity, wp.cross(kind.buoyancy_arm, gravity)
