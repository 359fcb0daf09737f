"""Rates of a body's state at the levels of the ladder that turn in the flow: Kirchhoff's equations with their loads.

Each takes (kind, plates, momentum, angular momentum, orientation, lift, gravity, air_rotation), gravity [m/s^2] in world
axes less the acceleration of the seen air, air_rotation [rad/s] in body axes, and returns dp/dt, dl/dt, dL/dt, the
relative velocity, the angular velocity, speed and spin.
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.aerodynamics import drag_load, quasi_steady_load
from warp_immersed.kernels.rigid_body import buoyant_load, kirchhoff_rates, velocities

wp.set_module_options({"enable_backward": False})


@wp.func
def kirchhoff_state_rates(
    kind: Any,
    plates: wp.array(dtype=Any),
    momentum: Any,
    angular_momentum: Any,
    orientation: Any,
    lift: Any,
    gravity: Any,
    air_rotation: Any,
):
    """Added mass and drag; no lift."""
    velocity, angular_velocity = velocities(kind, momentum, angular_momentum)
    inertial, inertial_moment = kirchhoff_rates(momentum, angular_momentum, velocity, angular_velocity)
    load, load_moment, speed, spin = drag_load(kind.loads, velocity, angular_velocity, air_rotation)
    weight, weight_moment = buoyant_load(kind, wp.quat_rotate_inv(orientation, gravity))
    return (
        inertial + load + weight,
        inertial_moment + load_moment + weight_moment,
        lift - lift,
        velocity,
        angular_velocity,
        speed,
        spin,
    )


@wp.func
def quasi_steady_state_rates(
    kind: Any,
    plates: wp.array(dtype=Any),
    momentum: Any,
    angular_momentum: Any,
    orientation: Any,
    lift: Any,
    gravity: Any,
    air_rotation: Any,
):
    """Added mass and the plate law."""
    velocity, angular_velocity = velocities(kind, momentum, angular_momentum)
    inertial, inertial_moment = kirchhoff_rates(momentum, angular_momentum, velocity, angular_velocity)
    load, load_moment, lift_rate, speed, spin = quasi_steady_load(kind.loads, velocity, angular_velocity, lift, air_rotation)
    weight, weight_moment = buoyant_load(kind, wp.quat_rotate_inv(orientation, gravity))
    return (
        inertial + load + weight,
        inertial_moment + load_moment + weight_moment,
        lift_rate,
        velocity,
        angular_velocity,
        speed,
        spin,
    )


@wp.func
def plates_state_rates(
    kind: Any,
    plates: wp.array(dtype=Any),
    momentum: Any,
    angular_momentum: Any,
    orientation: Any,
    lift: Any,
    gravity: Any,
    air_rotation: Any,
):
    """Added mass, and the plate law for each plate of a curved or folded body in the flow that it meets.

    lift (12,): circulatory lift of up to four plates, each in its own axes.
    """
    velocity, angular_velocity = velocities(kind, momentum, angular_momentum)
    inertial, inertial_moment = kirchhoff_rates(momentum, angular_momentum, velocity, angular_velocity)
    weight, weight_moment = buoyant_load(kind, wp.quat_rotate_inv(orientation, gravity))
    force = inertial + weight
    moment = inertial_moment + weight_moment
    lift_rate = lift - lift
    for i in range(kind.plate_count):
        plate = plates[kind.first_plate + i]
        into = wp.transpose(plate.axes)
        carried = type(velocity)(lift[3 * i], lift[3 * i + 1], lift[3 * i + 2])
        load, load_moment, carried_rate, _, _ = quasi_steady_load(
            plate.loads, into * velocity, into * angular_velocity, carried, into * air_rotation
        )
        force += plate.axes * load
        moment += plate.axes * load_moment
        lift_rate[3 * i] = carried_rate[0]
        lift_rate[3 * i + 1] = carried_rate[1]
        lift_rate[3 * i + 2] = carried_rate[2]
    return force, moment, lift_rate, velocity, angular_velocity, wp.length(velocity), wp.length(angular_velocity)
