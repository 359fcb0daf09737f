"""Fluid loads on a body: drag, lagged circulatory lift, rotational damping, and what separation takes of the Munk moment.

The plate law of Andersen, Pesavento & Wang, J. Fluid Mech. 541 (2005) 65, carried over to three dimensions (the lift
plane is that of the velocity and the plate's normal z; drag depends on the angle through the direction
cosines; each axis has its own damping), with three changes that measured paper disks ask for: the lift follows its
quasi-steady value with a lag, dies out at small Reynolds numbers, and the Munk moment is cut because the centre of
pressure of separated flow lies near the middle. Per unit mass, in body axes, acting at the centre of pressure.
`warp_immersed/force_law.py` gives the coefficients of a shape and their sources.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# Guards divisions by the square of the speed: all loads vanish with it.
SMALLEST_SQUARE = wp.constant(1.0e-30)


@wp.func
def drag_load(kind: Any, velocity: Any, angular_velocity: Any, air_rotation: Any):
    """Force and torque of drag alone, the loads of the `kirchhoff` level; and speed and spin. Arguments as below."""
    local = velocity + wp.cross(angular_velocity, kind.pressure_center)
    square = wp.cw_mul(local, local)
    speed_squared = square[0] + square[1] + square[2]
    speed = wp.sqrt(speed_squared)
    root = wp.sqrt(speed)
    drag_x = kind.drag_root[0] * root + kind.drag_quadratic[0] * speed
    drag_y = kind.drag_root[1] * root + kind.drag_quadratic[1] * speed
    drag_z = wp.max(kind.drag_root[2] * root + kind.drag_quadratic[2] * speed, kind.drag_broadside * speed - kind.drag_linear[2])
    drag = drag_x * square[0] + drag_y * square[1] + drag_z * square[2]
    drag = drag / wp.max(speed_squared, type(speed)(SMALLEST_SQUARE))
    force = -drag * local - wp.cw_mul(kind.drag_linear, local)
    spin = wp.length(angular_velocity)
    damping = kind.damping_linear + speed * kind.damping_speed + spin * kind.damping_spin
    torque = wp.cross(kind.pressure_center, force) - wp.cw_mul(damping, angular_velocity - air_rotation)
    return force, torque, speed, spin


@wp.func
def quasi_steady_load(kind: Any, velocity: Any, angular_velocity: Any, lift: Any, air_rotation: Any):
    """Force and torque about the centre of mass for a body that moves with (velocity, angular_velocity) through air that
    turns with air_rotation, and carries the circulatory lift `lift`; the rate of change of that lift; and speed and spin."""
    local = velocity + wp.cross(angular_velocity, kind.pressure_center)
    square = wp.cw_mul(local, local)
    speed_squared = square[0] + square[1] + square[2]
    # the square root and the division do not wait for each other
    speed = wp.sqrt(speed_squared)
    inverse_squared = type(speed)(1.0) / wp.max(speed_squared, type(speed)(SMALLEST_SQUARE))

    root = wp.sqrt(speed)
    drag_x = kind.drag_root[0] * root + kind.drag_quadratic[0] * speed
    drag_y = kind.drag_root[1] * root + kind.drag_quadratic[1] * speed
    drag_z = wp.max(kind.drag_root[2] * root + kind.drag_quadratic[2] * speed, kind.drag_broadside * speed - kind.drag_linear[2])
    drag = (drag_x * square[0] + drag_y * square[1] + drag_z * square[2]) * inverse_squared
    normal = local[2]
    drag += kind.drag_oblique * wp.abs(normal) * (type(speed)(1.0) - wp.abs(normal) * speed * inverse_squared)

    # the quasi-steady lift: translational, normal to the velocity in the plane of velocity and normal, and rotational
    # V^3 / (V^3 + onset^3), over V
    onset = speed_squared / wp.max(speed_squared * speed + kind.lift_onset_cubed, type(speed)(SMALLEST_SQUARE))
    broadside = square[2] * inverse_squared  # 1 broadside on, 0 edge-on
    strength = onset * kind.lift * normal
    target = wp.cross(wp.cw_mul(kind.circulation, angular_velocity), local) * (onset * speed) + type(local)(
        strength * normal * local[0], strength * normal * local[1], -strength * (square[0] + square[1])
    )
    follow = kind.lift_lag * speed
    # in body axes a lift that keeps its direction in space turns against the spin about the normal
    spin_normal = angular_velocity[2]
    lift_rate = (target - lift) * follow + type(lift)(spin_normal * lift[1], -spin_normal * lift[0], type(speed)(0.0))
    acting = lift
    if kind.lift_lag == type(speed)(0.0):
        acting = target

    force = acting - drag * local - wp.cw_mul(kind.drag_linear, local)
    spin = wp.length(angular_velocity)
    oblique = type(speed)(4.0) * broadside * (type(speed)(1.0) - broadside)
    damping = kind.damping_linear + speed * (kind.damping_speed + oblique * kind.damping_oblique) + spin * kind.damping_spin
    roll = kind.damping_roll * (angular_velocity[0] * local[0] + angular_velocity[1] * local[1])
    roll *= speed * inverse_squared
    cut = kind.munk_cut_edge + kind.munk_cut_swing * broadside
    torque = (
        wp.cross(kind.pressure_center, force)
        - wp.cw_mul(damping, angular_velocity - air_rotation)
        - type(local)(roll * local[0], roll * local[1], type(speed)(0.0))
        - cut * wp.cross(wp.cw_mul(kind.munk_mass, local), local)
    )
    return force, torque, lift_rate, speed, spin


@wp.func
def fastest_rate(kind: Any, speed: Any, spin: Any):
    """Fastest rate [1/s] at which the state of a body with this speed and spin can change, for the substep rule."""
    moving = kind.rate_linear + kind.rate_root * wp.sqrt(speed) + kind.rate_speed * speed
    return wp.max(moving, kind.rate_start) + kind.rate_spin * spin
