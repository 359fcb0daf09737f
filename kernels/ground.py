"""Landing: a body that touches the ground topples onto the face of its hull below it, slides to a stop and rests.

Up is y. A body's hull is a list of support points and a list of rest directions (the outward normals of the hull's
faces that lie below the centre of mass when it stands on them), both in body axes.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# A body is at rest when less than this is left of its toppling: below what a picture or a half-float quaternion shows.
REST_ANGLE = wp.constant(5.0e-4)  # rad
REST_SPIN = wp.constant(5.0e-3)  # rad/s


@wp.func
def lowest_point(kind: Any, supports: wp.array(dtype=Any), orientation: Any):
    """Height of the lowest support point above the centre of mass (negative) [m]."""
    # the world's y axis in body axes
    up = wp.quat_rotate_inv(orientation, unit_y(supports[0]))
    lowest = wp.dot(up, supports[kind.first_support])
    for i in range(1, kind.support_count):
        lowest = wp.min(lowest, wp.dot(up, supports[kind.first_support + i]))
    return lowest


@wp.func
def unit_y(like: Any):
    """The world's up in the precision of `like`."""
    return type(like)(like.dtype(0.0), like.dtype(1.0), like.dtype(0.0))


@wp.func
def toppling_vector(kind: Any, rests: wp.array(dtype=Any), orientation: Any):
    """World rotation vector (horizontal) that brings the nearest rest direction straight down; zero if there is none."""
    up = unit_y(rests[0])
    vector = up - up
    if kind.rest_count > 0:
        down = wp.quat_rotate_inv(orientation, -up)
        best = wp.int32(0)
        for i in range(1, kind.rest_count):
            if wp.dot(down, rests[kind.first_rest + i]) > wp.dot(down, rests[kind.first_rest + best]):
                best = i
        direction = wp.quat_rotate(orientation, rests[kind.first_rest + best])
        axis = wp.cross(direction, -up)
        sine = wp.length(axis)
        cosine = -direction[1]
        if sine > type(sine)(1.0e-6):
            vector = axis * (wp.atan2(sine, cosine) / sine)
        elif cosine < type(sine)(0.0):
            vector = type(up)(type(sine)(3.14159265), type(sine)(0.0), type(sine)(0.0))
    return vector


@wp.func
def turned(orientation: Any, vector: Any):
    """The orientation after a rotation by `vector` [rad] in world axes."""
    half = wp.length(vector) * vector.dtype(0.5)
    scale = vector.dtype(0.5)
    if half > vector.dtype(1.0e-6):
        scale = vector.dtype(0.5) * wp.sin(half) / half
    v = vector * scale
    return wp.normalize(type(orientation)(v[0], v[1], v[2], wp.cos(half)) * orientation)


@wp.func
def topple(kind: Any, rests: wp.array(dtype=Any), orientation: Any, spin: Any, time: Any):
    """Turn a body that lies on the ground towards its rest for a time [s].

    Critically damped, in closed form: with e the rotation still to go, e'' + 2 s e' + s^2 e = 0, s the settling rate.
    spin: world angular velocity [rad/s]; its vertical part dies out at the same rate. Returns the new orientation,
    the new spin, and whether the body has come to rest.
    """
    rate = kind.settling_rate
    up = unit_y(spin)
    yaw = up * spin[1]
    to_go = toppling_vector(kind, rests, orientation)
    speed = yaw - spin  # d(to_go)/dt
    # a spin faster than this would swing the body through the ground and back: the impact takes the rest
    limit = rate * type(rate)(2.0)
    fastest = wp.length(speed)
    if fastest > limit:
        speed *= limit / fastest
    fade = wp.exp(-rate * time)
    drive = speed + to_go * rate
    left = (to_go + drive * time) * fade
    left_speed = (speed - drive * (rate * time)) * fade
    turn = to_go - left + yaw * ((type(rate)(1.0) - fade) / rate)
    at_rest = (
        wp.length(left) < type(rate)(REST_ANGLE)
        and wp.length(left_speed) < type(rate)(REST_SPIN)
        and wp.abs(yaw[1]) * fade < type(rate)(REST_SPIN)
    )
    if at_rest:
        turn += left
    new_orientation = turned(orientation, turn)
    new_spin = yaw * fade - left_speed
    return new_orientation, new_spin, at_rest


@wp.func
def slide(kind: Any, velocity: Any, time: Any):
    """Horizontal velocity after Coulomb friction has acted for a time [s], and the distance slid (vec3)."""
    flat = type(velocity)(velocity[0], velocity.dtype(0.0), velocity[2])
    speed = wp.length(flat)
    sliding = wp.min(time, speed / kind.friction)
    left = speed - kind.friction * sliding
    direction = flat / wp.max(speed, velocity.dtype(1.0e-12))
    return direction * left, direction * ((speed + left) * sliding * velocity.dtype(0.5))
