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
def over_contact(kind: Any, supports: wp.array(dtype=Any), orientation: Any, velocity: Any, spin: Any, normal: Any):
    """Velocity of the centre of a body that slides with `velocity` and topples with `spin` on its lowest point."""
    up = wp.quat_rotate_inv(orientation, normal)
    lowest = wp.int32(0)
    for i in range(1, kind.support_count):
        if wp.dot(up, supports[kind.first_support + i]) < wp.dot(up, supports[kind.first_support + lowest]):
            lowest = i
    lever = wp.quat_rotate(orientation, supports[kind.first_support + lowest])
    return velocity - unit_y(velocity) * (wp.dot(wp.cross(spin, lever), normal) / normal[1])


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


SideHeights = wp.types.vector(length=8, dtype=wp.float32)
# How far below a surface, besides its own radius, a body may have got in a frame and still be put back onto it.
FOOTHOLD = wp.constant(0.05)  # m
# 2^32 over the golden ratio: its multiples fill the circle evenly
GOLDEN = wp.constant(wp.uint32(2654435769))


@wp.func
def layer_fraction(body: wp.int32):
    """A number in [0, 1) that is a body's own, spread evenly over any run of bodies (golden ratio)."""
    return wp.float32((wp.uint32(body) * GOLDEN) >> wp.uint32(8)) * wp.float32(5.9604645e-8)


@wp.func
def surface_below(mesh: wp.uint64, place: wp.vec3, above: wp.float32):
    """Whether there is a surface below a place raised by `above` [m], its height and its upward normal. A wall is no place to
    lie: nearly upright faces count as level."""
    hit = wp.mesh_query_ray(mesh, place + wp.vec3(0.0, above, 0.0), wp.vec3(0.0, -1.0, 0.0), 1.0e6)
    found = wp.int32(0)
    normal = wp.vec3(0.0, 1.0, 0.0)
    height = wp.float32(0.0)
    if hit.result:
        found = 1
        height = place[1] + above - hit.t
        if wp.abs(hit.normal[1]) > 0.2:
            normal = hit.normal * wp.sign(hit.normal[1])
    return found, height, normal


@wp.func
def side_direction(side: wp.int32):
    """One of eight horizontal directions."""
    angle = wp.float32(side) * wp.float32(0.78539816)
    return wp.vec3(wp.cos(angle), 0.0, wp.sin(angle))


@wp.func
def footing(mesh: wp.uint64, place: wp.vec3, above: wp.float32, radius: wp.float32, top: wp.float32, face: wp.vec3):
    """The plane that a body of this radius [m] near an uneven surface can lie on: normal, and how far it passes over the surface
    straight below, which is at height `top` and has the normal `face`. It has the slope of the surface across the body and
    lies on its highest point there, so that nothing pokes through; steps higher than the body is long are no part of it.
    """
    rise = SideHeights()  # of the surface over `top`, around the body
    known = SideHeights()
    tilt = wp.vec3(0.0)
    count = wp.float32(0.0)
    for side in range(8):
        step = side_direction(side) * radius
        found, height, normal = surface_below(mesh, place + step, above)
        if found != 0 and wp.abs(height - top) < 2.0 * radius:
            rise[side] = height - top
            known[side] = 1.0
            count += 1.0
            tilt += step * (height - top)
    slope = wp.vec3(-face[0] / face[1], 0.0, -face[2] / face[1])
    if count > 7.5:
        slope = tilt / (4.0 * radius * radius)  # least squares
    raised = wp.float32(0.0)
    for side in range(8):
        raised = wp.max(raised, known[side] * (rise[side] - wp.dot(slope, side_direction(side)) * radius))
    return wp.normalize(wp.vec3(-slope[0], 1.0, -slope[2])), raised


@wp.kernel
def find_ground(
    first: wp.int32,
    kinds: wp.array(dtype=Any),
    kind_index: wp.array(dtype=wp.int32),
    environments: wp.array(dtype=Any),
    mesh: wp.uint64,
    layering: wp.float32,
    state: wp.array(dtype=wp.uint8),
    position: wp.array(dtype=Any),
    normal_out: wp.array(dtype=Any),
    offset_out: wp.array(dtype=Any),
):
    """The ground under bodies first, first + 1, ... as a plane each: unit normal, and its offset (normal . point on it) [m].

    The surface of the mesh (if there is one) straight below, where it is higher than the plane y = height; raised by the
    body's own part of `layering` [m]. A launch of its own keeps the ray query out of the frame kernel of scenes on a bare
    plane. Bodies at rest are passed over.
    """
    i = first + wp.tid()
    status = wp.int32(state[i])
    if status == LANDED or status == FAILED:
        return
    environment = environments[0]
    x = position[i]
    normal = unit_y(x)
    offset = environment.ground_height
    if environment.has_ground == 0:
        offset = x.dtype(-1.0e30)
    if mesh != wp.uint64(0):
        radius = wp.float32(kinds[kind_index[i]].bounding_radius)
        place = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))
        above = radius + FOOTHOLD
        found, top, face = surface_below(mesh, place, above)
        if found != 0 and (x.dtype(top) > offset or environment.has_ground == 0):
            upward = face
            raised = wp.float32(0.0)
            if place[1] - top < above + radius:
                upward, raised = footing(mesh, place, above, radius, top, face)
            normal = type(x)(x.dtype(upward[0]), x.dtype(upward[1]), x.dtype(upward[2]))
            offset = wp.dot(normal, x) + normal[1] * (x.dtype(top + raised) - x[1])
    normal_out[i] = normal
    offset_out[i] = offset + normal[1] * x.dtype(layering * layer_fraction(i))


@wp.kernel
def park_outside(first: wp.int32, lower: wp.vec3, upper: wp.vec3, position: wp.array(dtype=Any), state: wp.array(dtype=wp.uint8)):
    """Stop bodies first, first + 1, ... that are outside the box, for good: they count as landed where they are."""
    i = first + wp.tid()
    x = position[i]
    outside = wp.int32(0)
    for axis in range(3):
        if wp.float32(x[axis]) < lower[axis] or wp.float32(x[axis]) > upper[axis]:
            outside = 1
    if outside != 0 and wp.int32(state[i]) != FAILED:
        state[i] = wp.uint8(LANDED)
