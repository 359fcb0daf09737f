"""Bodies as points: they fall and drift as the full model does on average, and tumble about an axis of their own.

`drift` has no inertia: a body moves with the air it sees and falls at its terminal speed. `point` has inertia with the mean
added mass, and drag in its exact response to a speed that is frozen for a substep, corrected once (second order, stable at any
step, exact at the terminal speed). Fall speed, drag and tumbling are those of the full model, measured on a pilot run
(`warp_immersed/pilot.py`).
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.ground import over_contact, part_before_contact, settle, turned, unit_y
from warp_immersed.kernels.integrate import FAST
from warp_immersed.kernels.langevin import as_floats, as_vector, next_air, released_air, uneven_air, uniform_air
from warp_immersed.kernels.philox import STREAM_TUMBLING_AXIS, gaussian_normals
from warp_immersed.kernels.rigid_body import FAILED, LANDED, MOVING, SETTLING, WAITING
from warp_immersed.kernels.runge_kutta import compensated_sum
from warp_immersed.kernels.sampling import FlowField

wp.set_module_options({"enable_backward": False})


# A body that does not turn keeps its axis in a spin that no one sees.
SMALLEST_SPIN = wp.constant(1.0e-6)
# Product of a step and the change of the drag rate within it, and steps that may be taken to keep to it.
LARGEST_CHANGE = wp.constant(0.2)
MOST_PIECES = wp.constant(16)
# Squares above this belong to a body that is lost.
LARGEST_SQUARE = wp.constant(1.0e30)


@wp.func
def drag_rate(kind: Any, speed: Any):
    """Drag over momentum at a speed [1/s]."""
    return kind.point_drag[0] + kind.point_drag[1] * wp.sqrt(speed) + kind.point_drag[2] * speed


@wp.func
def relaxed(start: Any, pull: Any, rate: Any, time: Any):
    """Velocity and displacement after a time [s] of dr/dt = pull - rate r, exact."""
    passed = rate * time
    # e^-x, its mean (1 - e^-x) / x and the remainder (1 - mean) / x, without cancellation where x is small
    remainder = type(rate)(0.5) - passed * type(rate)(1.0 / 6.0)
    mean = type(rate)(1.0) - passed * remainder
    decay = type(rate)(1.0) - passed * mean
    if passed > type(rate)(0.02):
        inverse = type(rate)(1.0) / passed
        decay = wp.exp(-passed)
        mean = (type(rate)(1.0) - decay) * inverse
        remainder = (type(rate)(1.0) - mean) * inverse
    return start * decay + pull * (mean * time), start * (mean * time) + pull * (remainder * time * time)


@wp.func
def tumbling_axis(spin: Any, random_key: wp.uint32, seed: wp.uint32, body: wp.int32):
    """Direction of a body's first spin, or a random one if it has none."""
    axis = spin
    if wp.length(spin) <= spin.dtype(0.0):
        axis = as_vector(spin, gaussian_normals(body, 0, STREAM_TUMBLING_AXIS, seed, random_key))
    return wp.normalize(axis)


@wp.func
def glide_across(kind: Any, axis: Any):
    """Sideways speed of a tumbling body over its speed: across its axis."""
    return wp.cross(unit_y(axis), axis) * kind.glide


@wp.func
def drift_start(kind: Any, velocity: Any, spin: Any, axis: Any):
    """Velocity through the air and spin of a body that drifts: its own for ever."""
    return kind.fall_velocity + glide_across(kind, axis) * kind.fall_speed, axis * (kind.tumbling * kind.fall_speed)


@wp.func
def drift_step(kind: Any, velocity: Any, spin: Any, pull: Any, time: Any):
    """Velocity, spin and displacement through the air after a time [s]."""
    return velocity, spin, velocity * time


@wp.func
def drift_velocity(kind: Any, velocity: Any, spin: Any):
    """Velocity through the air, glide included."""
    return velocity


@wp.func
def point_start(kind: Any, velocity: Any, spin: Any, axis: Any):
    """The velocity and spin of release; a spin that vanishes still has the axis to come."""
    return velocity, axis * wp.max(wp.length(spin), axis.dtype(SMALLEST_SPIN))


@wp.func
def point_step(kind: Any, velocity: Any, spin: Any, pull: Any, time: Any):
    """Velocity without glide, spin, and displacement through the air after a time [s]."""
    start = velocity
    moved = velocity - velocity
    rate = drag_rate(kind, wp.length(velocity))
    speed = wp.length(velocity)
    left = time
    way = time - time
    pieces = wp.int32(0)
    while left > type(left)(0.0):
        # the speed at its end to first order: implicit, for a stiff drag, and right at the terminal speed
        h = left
        speed = wp.length(start + pull * h) / (type(h)(1.0) + rate * h)
        last = drag_rate(kind, speed)
        # on the way to its terminal speed a body takes steps in which its drag does not change beyond recognition
        change = wp.abs(last - rate) * h
        if change > type(h)(LARGEST_CHANGE) and pieces < MOST_PIECES:
            h = h * type(h)(LARGEST_CHANGE) / change
            speed = wp.length(start + pull * h) / (type(h)(1.0) + rate * h)
            last = drag_rate(kind, speed)
        start, passed = relaxed(start, pull, (rate + last) * type(h)(0.5), h)
        moved += passed
        way += speed * h
        rate = last
        left = left - h
        pieces += 1
    # an initial spin gives way to tumbling in about the time that drag takes
    turning = wp.length(spin)
    passed_time = rate * time
    tumbling = (turning + kind.tumbling * speed * passed_time) / (type(time)(1.0) + passed_time)
    tumbling = wp.max(tumbling, type(time)(SMALLEST_SPIN))
    axis = spin * (type(time)(1.0) / turning)
    return start, axis * tumbling, moved + glide_across(kind, axis) * way


@wp.func
def point_velocity(kind: Any, velocity: Any, spin: Any):
    """Velocity through the air, glide included."""
    return velocity + glide_across(kind, spin) * (wp.length(velocity) / wp.length(spin))


def point_kernel(name, start, advance_state, full_velocity, has_inertia, wind_varies):
    """The frame kernel of a point model, for a wind that varies in space or not; arguments as in integrate.frame_kernel.

    While a body moves, `momentum` holds its velocity relative to the seen air and `angular_momentum` its angular velocity, both
    in world axes.
    """
    air_at = uneven_air if wind_varies else uniform_air

    @wp.kernel(name=name, module="unique", module_options=FAST)
    def advance(
        first: wp.int32,
        kinds: wp.array(dtype=Any),
        plates: wp.array(dtype=Any),
        environments: wp.array(dtype=Any),
        flow: FlowField,
        supports: wp.array(dtype=Any),
        rests: wp.array(dtype=Any),
        clock: wp.array(dtype=wp.int32),
        kind_index: wp.array(dtype=wp.int32),
        release_frame: wp.array(dtype=wp.int32),
        release_fraction: wp.array(dtype=Any),
        ground_normal: wp.array(dtype=Any),
        ground_offset: wp.array(dtype=Any),
        state: wp.array(dtype=wp.uint8),
        position: wp.array(dtype=Any),
        position_residual: wp.array(dtype=Any),
        orientation: wp.array(dtype=Any),
        momentum: wp.array(dtype=Any),
        angular_momentum: wp.array(dtype=Any),
        seen_air: wp.array(dtype=Any),
        seen_rotation: wp.array(dtype=Any),
        circulatory_lift: wp.array(dtype=Any),
        position_out: wp.array(dtype=Any),
        orientation_out: wp.array(dtype=Any),
        velocity_out: wp.array(dtype=Any),
        angular_velocity_out: wp.array(dtype=Any),
        state_out: wp.array(dtype=wp.uint8),
        substeps_out: wp.array(dtype=wp.int32),
    ):
        """Advance bodies first, first + 1, ... by the frame number clock[0]."""
        i = first + wp.tid()
        status = wp.int32(state[i])
        x = position[i]
        if status == LANDED or status == FAILED:
            position_out[i] = x
            orientation_out[i] = orientation[i]
            velocity_out[i] = x - x
            angular_velocity_out[i] = x - x
            state_out[i] = state[i]
            substeps_out[i] = 0
            return
        # loaded once more in rare branches, or else the common path pays for their share
        kind = kinds[kind_index[i]]
        environment = environments[0]
        frame = clock[0]
        body = i - kind.first_body
        residual = position_residual[i]
        q = orientation[i]
        r = momentum[i]
        w = angular_momentum[i]
        air = seen_air[i]
        wind_step = environment.wind_step
        zero = wind_step - wind_step
        one = zero + type(zero)(1.0)
        frame_start = wp.float32(frame) * wp.float32(wind_step) * wp.float32(environment.wind_steps)
        has_ground = environment.has_ground + environment.has_ground_mesh > 0
        normal = unit_y(x)
        offset = environment.ground_height
        if environment.has_ground_mesh != 0:
            normal = ground_normal[i]
            offset = ground_offset[i]
        idle = zero
        released = wp.int32(0)
        if status == WAITING and release_frame[i] <= frame:
            status = MOVING
            released = 1
            idle = release_fraction[i] * wind_step * type(wind_step)(environment.wind_steps)

        displacement = x - x
        settling_time = zero
        turn = x - x
        if status == MOVING:
            mean, gradient, seen = air_at(kind, environment, flow, x, frame_start)
            if released != 0:
                air, rotation = released_air(mean, seen, kind.random_key, environment.seed, body)
                axis = tumbling_axis(w, kind.random_key, environment.seed, body)
                r, w = start(kind, r - air, w, axis)
            for j in range(environment.wind_steps):
                step = frame * environment.wind_steps + j
                ahead = x + displacement
                if wind_varies:
                    ahead = ahead + (full_velocity(kind, r, w) + air) * wind_step
                now = frame_start + wp.float32(j + 1) * wp.float32(wind_step)
                next_mean, next_gradient, next_seen = air_at(kind, environment, flow, ahead, now)
                air_next = next_air(air, mean, seen, next_mean, next_seen, kind.random_key, environment.seed, body, step)
                interval = wp.min(type(wind_step)(j + 1) * wind_step - idle, wind_step)
                if interval > zero and status == MOVING:
                    pull = r - r
                    if has_inertia:
                        share = kind.net_weight / kind.point_inertia
                        pull = (environment.gravity - (air_next - air) * (one / interval)) * share
                        if wind_varies:
                            pull -= as_vector(r, gradient * as_floats(r)) * (one - share)
                    r, w, moved = advance_state(kind, r, w, pull, interval)
                    moved += (air + air_next) * (type(zero)(0.5) * interval)
                    part = one
                    if has_ground:
                        sinking = wp.dot(normal, moved)
                        height = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement) + sinking
                        if height < kind.bounding_radius:
                            q = turned(q, turn)
                            turn = x - x
                            standing = kinds[kind_index[i]]
                            part = part_before_contact(standing, supports, normal, height, sinking, q, turned(q, w * interval))
                            if part <= one and kind.net_weight * environment.gravity[1] < zero:
                                status = SETTLING
                                settling_time = interval * (one - part)
                                settling_time += type(zero)(environment.wind_steps - 1 - j) * wind_step
                            elif part <= one and has_inertia:
                                # a buoyant body is pushed down onto the ground: it keeps off it
                                r = r - normal * wp.min(wp.dot(normal, r + air_next), zero)
                            part = wp.min(part, one)
                    displacement += moved * part
                    turn += w * (interval * part)
                if status == SETTLING:
                    r = full_velocity(kind, r, w) + air_next
                    air = air_next
                    break
                air = air_next
                mean = next_mean
                gradient = next_gradient
                seen = next_seen
            q = turned(q, turn)
        elif status == SETTLING:
            settling_time = wind_step * type(wind_step)(environment.wind_steps)

        # a comparison, which infinite and undefined numbers fail: isfinite is a call on the CPU
        if not (wp.dot(r, r) + wp.dot(displacement, displacement) + q[3] * q[3] < type(zero)(LARGEST_SQUARE)):
            status = FAILED
            q = orientation[i]
            displacement = x - x
        if status == SETTLING and settling_time > zero:
            height = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement + residual)
            standing = kinds[kind_index[i]]
            q, r, w, moved, at_rest = settle(standing, supports, rests, normal, height, q, r, w, settling_time)
            displacement += moved
            if at_rest:
                status = LANDED

        velocity = r
        angular_velocity = w
        substeps = wp.int32(0)
        if status == MOVING:
            velocity = full_velocity(kind, r, w) + air
            substeps = environment.wind_steps
        elif status == SETTLING:
            velocity = over_contact(kind, supports, q, r, w, normal)
        else:
            velocity = x - x
            angular_velocity = x - x
        if status == LANDED or status == FAILED:
            r = x - x
            w = x - x
        if status != WAITING:
            x, residual = compensated_sum(x, residual, displacement)
        position[i] = x
        position_residual[i] = residual
        orientation[i] = q
        momentum[i] = r
        angular_momentum[i] = w
        seen_air[i] = air
        substeps_out[i] = substeps
        position_out[i] = x
        orientation_out[i] = q
        velocity_out[i] = velocity
        angular_velocity_out[i] = angular_velocity
        state[i] = wp.uint8(status)
        if status == SETTLING:
            status = MOVING
        state_out[i] = wp.uint8(status)

    return advance


advance_drift = point_kernel("advance_drift", drift_start, drift_step, drift_velocity, False, False)
advance_point = point_kernel("advance_point", point_start, point_step, point_velocity, True, False)
advance_drift_uneven = point_kernel("advance_drift_uneven", drift_start, drift_step, drift_velocity, False, True)
advance_point_uneven = point_kernel("advance_point_uneven", point_start, point_step, point_velocity, True, True)
