"""One thread is one body: a frame of its motion, its state in registers over as many substeps as it needs.

A kernel for each level of the ladder that turns in the flow, each in a module of its own, so that a scene compiles what it
uses only. The levels that do not turn are in point_mass.py; all kernels take the same arguments.
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.aerodynamics import fastest_rate
from warp_immersed.kernels.ground import lowest_point, over_contact, part_before_contact, settle, unit_y
from warp_immersed.kernels.langevin import as_floats, as_vector, half_curl, local_air, next_air, next_rotation, released_air
from warp_immersed.kernels.rigid_body import FAILED, LANDED, MOVING, SETTLING, WAITING, momenta, velocities
from warp_immersed.kernels.runge_kutta import MOST_SUBSTEPS, SUBSTEP_CRITERION, compensated_sum, is_finite, runge_kutta_4
from warp_immersed.kernels.sampling import FlowField
from warp_immersed.kernels.state_rates import kirchhoff_state_rates, plates_state_rates, quasi_steady_state_rates

wp.set_module_options({"enable_backward": False})

# Warp's own flags, with multiplications and additions fused and without its attempts at packing scalars into vectors:
# some 10 % faster.
FAST = {
    "enable_backward": False,
    "cpu_compiler_flags": "-march=native -ffp-contract=fast -fno-slp-vectorize -mllvm=-inline-threshold=9000",
}


@wp.func
def in_uneven_flow(kind: Any, orientation: Any, momentum: Any, velocity: Any, gradient: wp.mat33, time: Any):
    """Momentum after the air's own acceleration has pressed on a body for a time [s]; velocity r in body axes.

    The seen air accelerates as the body meets it; displaced and added mass feel how the air itself accelerates, which differs
    by -(grad U) r (Maxey & Riley, Phys. Fluids 26 (1983) 883).
    """
    shear = as_vector(velocity, gradient * as_floats(wp.quat_rotate(orientation, velocity)))
    slip = wp.quat_rotate_inv(orientation, shear)
    # added mass and displaced mass, over the body's own: M - 1 + (1 - net weight)
    return momentum - (kind.linear_inertia * slip - slip * kind.net_weight) * time


def frame_kernel(name, rates):
    """The frame kernel of one law."""
    step_state = runge_kutta_4(rates)

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
        rotation = seen_rotation[i]
        lift = circulatory_lift[i]
        wind_step = environment.wind_step
        zero = wind_step - wind_step
        frame_start = wp.float32(frame) * wp.float32(wind_step) * wp.float32(environment.wind_steps)
        has_ground = environment.has_ground + environment.has_ground_mesh > 0
        normal = unit_y(x)
        offset = environment.ground_height
        if environment.has_ground_mesh != 0:
            normal = ground_normal[i]
            offset = ground_offset[i]
        # part of the frame that lies before the body's release
        idle = zero
        released = wp.int32(0)
        if status == WAITING and release_frame[i] <= frame:
            status = MOVING
            released = 1
            idle = release_fraction[i] * wind_step * type(wind_step)(environment.wind_steps)

        displacement = x - x
        count = wp.int32(0)
        settling_time = zero  # what is left of the frame after touching the ground
        if status == MOVING:
            mean, gradient, seen = local_air(kind, environment, flow, x, frame_start)
            if released != 0:
                air, rotation = released_air(mean, seen, kind.random_key, environment.seed, body)
                p, l = momenta(kind, wp.quat_rotate_inv(q, p - air), wp.quat_rotate_inv(q, l))
            for j in range(environment.wind_steps):
                step = frame * environment.wind_steps + j
                ahead = x + displacement
                if environment.wind_varies != 0:
                    r, w = velocities(kind, p, l)
                    ahead = ahead + (wp.quat_rotate(q, r) + air) * wind_step
                now = frame_start + wp.float32(j + 1) * wp.float32(wind_step)
                next_mean, next_gradient, next_seen = local_air(kind, environment, flow, ahead, now)
                air_next = next_air(air, mean, seen, next_mean, next_seen, kind.random_key, environment.seed, body, step)
                turning = rotation
                if environment.wind_varies != 0:
                    turning = rotation + as_vector(rotation, half_curl(gradient))
                interval = wp.min(type(wind_step)(j + 1) * wind_step - idle, wind_step)
                if interval > zero and status == MOVING:
                    gust = (air_next - air) / interval
                    gravity = environment.gravity - gust
                    left = interval
                    while left > zero:
                        turn = wp.quat_rotate_inv(q, turning)
                        dp, dl, da, r, w, speed, spin = rates(kind, plates, p, l, q, lift, gravity, turn)
                        # the gust that the rest of the interval brings counts as speed
                        rate = fastest_rate(kind, speed + wp.length(gust) * left, spin)
                        pieces = wp.max(wp.ceil(left * rate / type(left)(SUBSTEP_CRITERION)), type(left)(1.0))
                        h = left / pieces
                        p_next, l_next, q_next, lift, moved = step_state(
                            kind, plates, p, l, q, lift, gravity, turn, h, dp, dl, da, r, w
                        )
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
                        if has_ground:
                            sinking = wp.dot(normal, moved)
                            height = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement) + sinking
                            part = part_before_contact(kind, supports, normal, height, sinking, q, q_next)
                            if part <= type(h)(1.0):
                                touched = 1
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
                    if environment.wind_varies != 0 and status == MOVING:
                        r, w = velocities(kind, p, l)
                        p = in_uneven_flow(kind, q, p, r, gradient, interval)
                air = air_next
                rotation = next_rotation(rotation, seen, kind.random_key, environment.seed, body, step)
                mean = next_mean
                gradient = next_gradient
                seen = next_seen
        elif status == SETTLING:
            settling_time = wind_step * type(wind_step)(environment.wind_steps)

        if status == FAILED or not is_finite(p, l, q, displacement, lift):
            status = FAILED
            q = orientation[i]
            displacement = x - x
        if status == SETTLING and settling_time > zero:
            height = (wp.dot(normal, x) - offset) + wp.dot(normal, displacement + residual)
            q, p, l, moved, at_rest = settle(kind, supports, rests, normal, height, q, p, l, settling_time)
            displacement += moved
            if at_rest:
                status = LANDED

        velocity = p
        angular_velocity = l
        if status == MOVING:
            r, w = velocities(kind, p, l)
            velocity = wp.quat_rotate(q, r) + air
            angular_velocity = wp.quat_rotate(q, w)
        elif status == SETTLING:
            velocity = over_contact(kind, supports, q, p, l, normal)
        else:
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
        seen_rotation[i] = rotation
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

    return advance


advance_kirchhoff = frame_kernel("advance_kirchhoff", kirchhoff_state_rates)
advance_quasi_steady = frame_kernel("advance_quasi_steady", quasi_steady_state_rates)
advance_plates = frame_kernel("advance_plates", plates_state_rates)


@wp.kernel
def advance_clock(clock: wp.array(dtype=wp.int32)):
    """Count one frame, after every body has had it."""
    clock[0] = clock[0] + 1
