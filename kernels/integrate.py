"""One thread is one body: a frame of its motion, its state in registers over as many substeps as it needs."""

from typing import Any

import warp as wp

from warp_immersed.kernels.aerodynamics import fastest_rate, quasi_steady_load
from warp_immersed.kernels.ground import lowest_point, slide, topple, unit_y
from warp_immersed.kernels.langevin import next_air, released_air
from warp_immersed.kernels.rigid_body import (
    FAILED,
    LANDED,
    MOVING,
    SETTLING,
    WAITING,
    buoyant_load,
    kirchhoff_rates,
    momenta,
    orientation_rate,
    velocities,
)
from warp_immersed.kernels.sampling import FlowField

# Warp's own flags, with multiplications and additions fused and without its attempts at packing scalars into vectors:
# some 10 % faster.
wp.set_module_options(
    {
        "enable_backward": False,
        "cpu_compiler_flags": "-march=native -ffp-contract=fast -fno-slp-vectorize -mllvm=-inline-threshold=9000",
    }
)

# RK4 is accurate to 1 % where (fastest rate) * (substep) <= 1 with the rates of force_law.py, and dies near 3.
SUBSTEP_CRITERION = wp.constant(1.0)
# A body that asks for more in one frame is lost: it counts as failed.
MOST_SUBSTEPS = 20000


@wp.func
def state_rates(kind: Any, momentum: Any, angular_momentum: Any, orientation: Any, lift: Any, gravity: Any):
    """dp/dt, dl/dt, dL/dt, the relative velocity and the angular velocity, speed and spin; gravity in world axes,
    less the acceleration of the seen air."""
    velocity, angular_velocity = velocities(kind, momentum, angular_momentum)
    inertial, inertial_moment = kirchhoff_rates(momentum, angular_momentum, velocity, angular_velocity)
    load, load_moment, lift_rate, speed, spin = quasi_steady_load(kind, velocity, angular_velocity, lift)
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
def runge_kutta_4(
    kind: Any, p: Any, l: Any, q: Any, lift: Any, gravity: Any, h: Any, dp1: Any, dl1: Any, da1: Any, r: Any, w: Any
):
    """Classical fourth-order Runge-Kutta step of (momentum, angular momentum, orientation, lift) over h [s].

    dp1, dl1, da1, r, w: the rates and velocities at its start. Returns the new state and the displacement relative to
    the air (world axes) [m].
    """
    half = h * type(h)(0.5)
    third = h / type(h)(3.0)
    sixth = h / type(h)(6.0)
    dq1 = orientation_rate(q, w)
    dx = wp.quat_rotate(q, r) * sixth
    q_stage = q + dq1 * half
    dp2, dl2, da2, r, w, speed, spin = state_rates(kind, p + dp1 * half, l + dl1 * half, q_stage, lift + da1 * half, gravity)
    dq2 = orientation_rate(q_stage, w)
    dx += wp.quat_rotate(q_stage, r) * third
    q_stage = q + dq2 * half
    dp3, dl3, da3, r, w, speed, spin = state_rates(kind, p + dp2 * half, l + dl2 * half, q_stage, lift + da2 * half, gravity)
    dq3 = orientation_rate(q_stage, w)
    dx += wp.quat_rotate(q_stage, r) * third
    q_stage = q + dq3 * h
    dp4, dl4, da4, r, w, speed, spin = state_rates(kind, p + dp3 * h, l + dl3 * h, q_stage, lift + da3 * h, gravity)
    dq4 = orientation_rate(q_stage, w)
    dx += wp.quat_rotate(q_stage, r) * sixth
    return (
        p + (dp1 + dp4) * sixth + (dp2 + dp3) * third,
        l + (dl1 + dl4) * sixth + (dl2 + dl3) * third,
        wp.normalize(q + (dq1 + dq4) * sixth + (dq2 + dq3) * third),
        lift + (da1 + da4) * sixth + (da2 + da3) * third,
        dx,
    )


@wp.func
def is_finite(p: Any, l: Any, q: Any, x: Any, lift: Any):
    """Whether a body's whole state is finite."""
    return (
        wp.isfinite(wp.dot(p, p))
        and wp.isfinite(wp.dot(l, l))
        and wp.isfinite(wp.dot(x, x))
        and wp.isfinite(wp.dot(lift, lift))
        and wp.isfinite(q[0] + q[3])
    )


@wp.func
def compensated_sum(total: Any, residual: Any, increment: Any):
    """total + residual + increment as a rounded sum and what rounding lost (Knuth's two-sum): float32 positions that
    keep their small steps however far from the origin."""
    addend = increment + residual
    rounded = total + addend
    back = rounded - total
    return rounded, (total - (rounded - back)) + (addend - back)


@wp.kernel
def advance_quasi_steady(
    first: wp.int32,
    kinds: wp.array(dtype=Any),
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
    circulatory_lift: wp.array(dtype=Any),
    position_out: wp.array(dtype=Any),
    orientation_out: wp.array(dtype=Any),
    velocity_out: wp.array(dtype=Any),
    angular_velocity_out: wp.array(dtype=Any),
    state_out: wp.array(dtype=wp.uint8),
    substeps_out: wp.array(dtype=wp.int32),
):
    """Advance bodies first, first + 1, ... by the frame number clock[0] and write how they stand at its end.

    While a body waits, `momentum` and `angular_momentum` hold its initial velocity and angular velocity in world
    axes; while it settles, its velocity and angular velocity in world axes.
    """
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
    kind = kinds[kind_index[i]]
    environment = environments[0]
    frame = clock[0]
    body = i - kind.first_body
    residual = position_residual[i]
    q = orientation[i]
    p = momentum[i]
    l = angular_momentum[i]
    air = seen_air[i]
    lift = circulatory_lift[i]
    wind_step = environment.wind_step
    zero = wind_step - wind_step
    frame_time = wp.float32(wind_step) * wp.float32(environment.wind_steps)
    normal = unit_y(x)
    offset = environment.ground_height
    if environment.has_ground_mesh != 0:
        normal = ground_normal[i]
        offset = ground_offset[i]
    # part of the frame that lies before the body's release
    idle = zero
    if status == WAITING and release_frame[i] <= frame:
        status = MOVING
        idle = release_fraction[i] * wind_step * type(wind_step)(environment.wind_steps)
        air = released_air(environment, flow, x, wp.float32(frame) * frame_time, kind.random_key, body)
        p, l = momenta(kind, wp.quat_rotate_inv(q, p - air), wp.quat_rotate_inv(q, l))

    displacement = x - x
    count = wp.int32(0)
    settling_time = zero  # what is left of the frame after touching the ground
    if status == MOVING:
        for j in range(environment.wind_steps):
            step = frame * environment.wind_steps + j
            here = x + displacement
            ahead = here
            if environment.wind_varies != 0:
                r, w = velocities(kind, p, l)
                ahead = here + (wp.quat_rotate(q, r) + air) * wind_step
            now = wp.float32(step) * wp.float32(wind_step)
            air_next = next_air(environment, flow, air, here, ahead, now, kind.random_key, body, step)
            interval = wp.min(type(wind_step)(j + 1) * wind_step - idle, wind_step)
            if interval > zero and status == MOVING:
                gust = (air_next - air) / interval
                gravity = environment.gravity - gust
                left = interval
                while left > zero:
                    dp, dl, da, r, w, speed, spin = state_rates(kind, p, l, q, lift, gravity)
                    # the gust that the rest of the interval brings counts as speed
                    rate = fastest_rate(kind, speed + wp.length(gust) * left, spin)
                    pieces = wp.max(wp.ceil(left * rate / type(left)(SUBSTEP_CRITERION)), type(left)(1.0))
                    h = left / pieces
                    p_next, l_next, q_next, lift, moved = runge_kutta_4(kind, p, l, q, lift, gravity, h, dp, dl, da, r, w)
                    elapsed = interval - left
                    moved += (air + gust * (elapsed + h * type(h)(0.5))) * h
                    count += 1
                    left = left - h
                    if pieces < type(left)(1.5):
                        left = zero
                    if count > MOST_SUBSTEPS:
                        status = FAILED
                        left = zero
                    touched = wp.int32(0)
                    if environment.has_ground + environment.has_ground_mesh > 0:
                        sinking = wp.dot(normal, moved)
                        height = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement) + sinking
                        if height < kind.bounding_radius:
                            below = height + lowest_point(kind, supports, q_next, normal)
                            if below < zero:
                                touched = 1
                                above = height - sinking + lowest_point(kind, supports, q, normal)
                                part = wp.clamp(above / wp.max(above - below, type(h)(1.0e-12)), zero, type(h)(1.0))
                                moved = moved * part
                                q_next = wp.normalize(q + (q_next - q) * part)
                                left = left + h * (type(h)(1.0) - part)
                    displacement += moved
                    q = q_next
                    p = p_next
                    l = l_next
                    if touched != 0:
                        r, w = velocities(kind, p, l)
                        air_now = air + gust * (interval - left)
                        p = wp.quat_rotate(q, r) + air_now
                        l = wp.quat_rotate(q, w)
                        if status == MOVING and kind.net_weight * environment.gravity[1] < zero:
                            status = SETTLING
                            settling_time = left + type(h)(environment.wind_steps - 1 - j) * wind_step
                            left = zero
                        elif status == MOVING:
                            # a buoyant body is pushed down onto the ground: it keeps off it
                            p = type(p)(p[0], wp.max(p[1], zero), p[2])
                            gap = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement)
                            gap += lowest_point(kind, supports, q, normal)
                            displacement += type(p)(zero, -gap / normal[1], zero)
                            p, l = momenta(kind, wp.quat_rotate_inv(q, p - air_now), wp.quat_rotate_inv(q, l))
            air = air_next
    elif status == SETTLING:
        settling_time = wind_step * type(wind_step)(environment.wind_steps)

    if status == FAILED or not is_finite(p, l, q, displacement, lift):
        status = FAILED
        q = orientation[i]
        displacement = x - x
    if status == SETTLING and settling_time > zero:
        q, l, at_rest = topple(kind, rests, q, l, normal, settling_time)
        p, slid = slide(kind, p, normal, settling_time)
        displacement += slid
        gap = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement + residual)
        gap += lowest_point(kind, supports, q, normal)
        displacement += type(p)(zero, -gap / normal[1], zero)
        if at_rest and wp.length(p) <= zero:
            status = LANDED

    velocity = p
    angular_velocity = l
    if status == MOVING:
        r, w = velocities(kind, p, l)
        velocity = wp.quat_rotate(q, r) + air
        angular_velocity = wp.quat_rotate(q, w)
    elif status != SETTLING:
        velocity = x - x
        angular_velocity = x - x
    if status == LANDED or status == FAILED:
        p = x - x
        l = x - x
    if status != WAITING:
        x, residual = compensated_sum(x, residual, displacement)
    position[i] = x
    position_residual[i] = residual
    orientation[i] = q
    momentum[i] = p
    angular_momentum[i] = l
    seen_air[i] = air
    circulatory_lift[i] = lift
    substeps_out[i] = count
    position_out[i] = x
    orientation_out[i] = q
    velocity_out[i] = velocity
    angular_velocity_out[i] = angular_velocity
    state[i] = wp.uint8(status)
    if status == SETTLING:
        status = MOVING
    state_out[i] = wp.uint8(status)


@wp.kernel
def advance_clock(clock: wp.array(dtype=wp.int32)):
    """Count one frame, after every body has had it."""
    clock[0] = clock[0] + 1
