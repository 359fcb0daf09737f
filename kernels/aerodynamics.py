"""Quasi-steady fluid loads on a body: drag, lift, rotational circulation and rotational damping.

The plate law of Andersen, Pesavento & Wang, J. Fluid Mech. 541 (2005) 65, carried over to three dimensions: the lift
plane is that of the velocity and the plate's normal z, the drag coefficient depends on the angle through the squares
of the direction cosines, and each axis has its own damping. Per unit mass, in body axes, acting at the centre of
pressure. `warp_immersed/force_law.py` gives the coefficients of a shape.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# Guards the division by the speed: all loads vanish with it.
SMALLEST_SPEED = wp.constant(1.0e-9)


@wp.func
def quasi_steady_load(kind: Any, velocity: Any, angular_velocity: Any):
    """Force and torque about the centre of mass for a body moving with (velocity, angular_velocity) through the air."""
    local = velocity + wp.cross(angular_velocity, kind.pressure_center)
    speed = wp.length(local)
    inverse_speed = type(speed)(1.0) / wp.max(speed, type(speed)(SMALLEST_SPEED))
    along = local * inverse_speed
    squares = wp.cw_mul(along, along)
    drag = wp.dot(kind.drag_quadratic, squares) * speed + wp.dot(kind.drag_root, squares) * wp.sqrt(speed)
    normal = local[2]
    lift = kind.lift * normal * inverse_speed
    force = (
        wp.cross(wp.cw_mul(kind.circulation, angular_velocity), local)
        - drag * local
        - wp.cw_mul(kind.drag_linear, local)
    )
    force += type(local)(
        lift * normal * local[0],
        lift * normal * local[1],
        -lift * (local[0] * local[0] + local[1] * local[1]),
    )
    spin = wp.length(angular_velocity)
    damping = kind.damping_linear + speed * kind.damping_speed + spin * kind.damping_spin
    torque = wp.cross(kind.pressure_center, force) - wp.cw_mul(damping, angular_velocity)
    return force, torque


@wp.func
def fastest_rate(kind: Any, velocity: Any, angular_velocity: Any, gust: Any):
    """Fastest rate [1/s] at which the body's state can change, for the substep rule.

    gust: change of the seen wind [m/s] that the coming interval will bring.
    """
    speed = wp.length(velocity + wp.cross(angular_velocity, kind.pressure_center)) + gust
    moving = kind.rate_linear + kind.rate_root * wp.sqrt(speed) + kind.rate_speed * speed
    return wp.max(moving, kind.rate_start) + kind.rate_spin * wp.length(angular_velocity)
