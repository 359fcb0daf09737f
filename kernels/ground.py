"""Landing: a body that touches the ground topples onto the face of its hull below it, slides to a stop and rests.

The ground is a plane, y = height, or the surface of a mesh above it; under each body it counts as the plane through the
point straight below. A body's hull is a list of support points and a list of rest directions (the outward normals of the hull's
faces that lie below the centre of mass when it stands on them), both in body axes.
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.rigid_body import FAILED, LANDED

wp.set_module_options({"enable_backward": False})

# A body is at rest when less than this is left of its toppling: below what a picture or a half-float quaternion shows.
REST_ANGLE = wp.constant(5.0e-4)  # rad
REST_SPIN = wp.constant(5.0e-3)  # rad/s


@wp.func
def lowest_point(kind: Any, supports: wp.array(dtype=Any), orientation: Any, normal: Any):
    """Distance along the ground's normal from the centre of mass to the lowest support point (negative) [m]."""
    up = wp.quat_rotate_inv(orientation, normal)
    lowest = wp.dot(up, supports[kind.first_support])
    for i in range(1, kind.support_count):
        lowest = wp.min(lowest, wp.dot(up, supports[kind.first_support + i]))
    return lowest


@wp.func
def unit_y(like: Any):
    """The world's up in the precision of `like`."""
    return type(like)(like.dtype(0.0), like.dtype(1.0), like.dtype(0.0))


@wp.func
def toppling_vector(kind: Any, rests: wp.array(dtype=Any), orientation: Any, up: Any):
    """World rotation vector that turns the nearest rest direction against the ground's normal; zero if there is none."""
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
        cosine = -wp.dot(direction, up)
        if sine > type(sine)(1.0e-6):
            vector = axis * (wp.atan2(sine, cosine) / sine)
        elif cosine < type(sine)(0.0):
            # any axis across the normal will do
            aside = type(up)(type(sine)(1.0), type(sine)(0.0), type(sine)(0.0))
            vector = wp.normalize(aside - up * up[0]) * type(sine)(3.14159265)
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
def topple(kind: Any, rests: wp.array(dtype=Any), orientation: Any, spin: Any, up: Any, time: Any):
    """Turn a body that lies on the ground towards its rest for a time [s].

    Critically damped, in closed form: with e the rotation still to go, e'' + 2 s e' + s^2 e = 0, s the settling rate.
    spin: world angular velocity [rad/s]; its part about the normal `up` dies out at the same rate. Returns the new orientation,
    the new spin, and whether the body has come to rest.
    """
    rate = kind.settling_rate
    yaw = up * wp.dot(spin, up)
    to_go = toppling_vector(kind, rests, orientation, up)
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
        and wp.length(yaw) * fade < type(rate)(REST_SPIN)
    )
    if at_rest:
        turn += left
    new_orientation = turned(orientation, turn)
    new_spin = yaw * fade - left_speed
    return new_orientation, new_spin, at_rest


@wp.func
def slide(kind: Any, velocity: Any, up: Any, time: Any):
    """Velocity along the ground after Coulomb friction has acted for a time [s], and the distance slid (vec3)."""
    flat = velocity - up * wp.dot(velocity, up)
    speed = wp.length(flat)
    sliding = wp.min(time, speed / kind.friction)
    left = speed - kind.friction * sliding
    direction = flat / wp.max(speed, velocity.dtype(1.0e-12))
    return direction * left, direction * ((speed + left) * sliding * velocity.dtype(0.5))


@wp.func
def part_before_contact(
    kind: Any, supports: wp.array(dtype=Any), normal: Any, height: Any, sinking: Any, orientation: Any, next_orientation: Any
):
    """Part of a step [0, 1] before a body's lowest point meets the ground, by linear interpolation; 2 if it does not.

    height: of the centre of mass above the ground plane at the step's end [m], sinking: its change over the step.
    """
    part = type(height)(2.0)
    if height < kind.bounding_radius:
        below = height + lowest_point(kind, supports, next_orientation, normal)
        if below < type(height)(0.0):
            above = height - sinking + lowest_point(kind, supports, orientation, normal)
            span = wp.max(above - below, type(height)(1.0e-12))
            part = wp.clamp(above / span, type(height)(0.0), type(height)(1.0))
    return part


@wp.func
def settle(
    kind: Any,
    supports: wp.array(dtype=Any),
    rests: wp.array(dtype=Any),
    normal: Any,
    height: Any,
    orientation: Any,
    velocity: Any,
    angular_velocity: Any,
    time: Any,
):
    """Topple and slide a body that touches the ground for a time [s]; height [m] of its centre above the ground plane.

    Returns its orientation, velocity, angular velocity and displacement (world axes), and whether it has come to rest.
    """
    turned_to, spin, at_rest = topple(kind, rests, orientation, angular_velocity, normal, time)
    left, moved = slide(kind, velocity, normal, time)
    gap = height + wp.dot(normal, moved) + lowest_point(kind, supports, turned_to, normal)
    moved += unit_y(velocity) * (-gap / normal[1])
    return turned_to, left, spin, moved, at_rest and wp.length(left) <= type(height)(0.0)


@wp.kernel
def find_ground(
    first: wp.int32,
    environments: wp.array(dtype=Any),
    mesh: wp.uint64,
    state: wp.array(dtype=wp.uint8),
    position: wp.array(dtype=Any),
    normal_out: wp.array(dtype=Any),
    offset_out: wp.array(dtype=Any),
):
    """The ground under bodies first, first + 1, ... as a plane each: unit normal, and its offset (normal . point on it) [m].

    The surface of the mesh straight below, where it is higher than the plane y = height. A launch of its own keeps the ray
    query out of the frame kernel of scenes that have no mesh. Bodies at rest are passed over.
    """
    i = first + wp.tid()
    status = wp.int32(state[i])
    if status == LANDED or status == FAILED:
        return
    environment = environments[0]
    x = position[i]
    normal = unit_y(x)
    offset = environment.ground_height
    start = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))
    hit = wp.mesh_query_ray(mesh, start, wp.vec3(0.0, -1.0, 0.0), 1.0e6)
    depth = x.dtype(hit.t)
    if hit.result and (x[1] - depth > offset or environment.has_ground == 0):
        upward = hit.normal
        if upward[1] < 0.0:
            upward = -upward
        # a wall is no place to lie: nearly upright faces count as level
        if upward[1] > 0.2:
            normal = type(x)(x.dtype(upward[0]), x.dtype(upward[1]), x.dtype(upward[2]))
        offset = wp.dot(normal, x) - normal[1] * depth
    elif environment.has_ground == 0:
        offset = x.dtype(-1.0e30)
    normal_out[i] = normal
    offset_out[i] = offset
