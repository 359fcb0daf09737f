"""The classical fourth-order Runge-Kutta step of a body's state, for any of the laws in state_rates.py."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

# RK4 is accurate to 1 % where (fastest rate) * (substep) <= 1 with the rates of force_law.py, and dies near 3.
SUBSTEP_CRITERION = wp.constant(1.0)
# A body that asks for more in one frame is lost: it counts as failed.
MOST_SUBSTEPS = 100000


@wp.func
def orientation_rate(orientation: Any, angular_velocity: Any):
    """dq/dt = q (w, 0) / 2, with the angular velocity in body axes."""
    w = angular_velocity * angular_velocity.dtype(0.5)
    return orientation * type(orientation)(w[0], w[1], w[2], w.dtype(0.0))


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


def runge_kutta_4(rates):
    """The step for one law: a device function."""

    @wp.func
    def step(
        kind: Any,
        plates: wp.array(dtype=Any),
        p: Any,
        l: Any,
        q: Any,
        lift: Any,
        gravity: Any,
        turn: Any,
        h: Any,
        dp1: Any,
        dl1: Any,
        da1: Any,
        r: Any,
        w: Any,
    ):
        """Step of (momentum, angular momentum, orientation, lift) over h [s].

        dp1, dl1, da1, r, w: the rates and velocities at its start. Returns the new state and the displacement relative to
        the air (world axes) [m].
        """
        half = h * type(h)(0.5)
        third = h / type(h)(3.0)
        sixth = h / type(h)(6.0)
        dq1 = orientation_rate(q, w)
        dx = wp.quat_rotate(q, r) * sixth
        q_stage = q + dq1 * half
        dp2, dl2, da2, r, w, speed, spin = rates(
            kind, plates, p + dp1 * half, l + dl1 * half, q_stage, lift + da1 * half, gravity, turn
        )
        dq2 = orientation_rate(q_stage, w)
        dx += wp.quat_rotate(q_stage, r) * third
        q_stage = q + dq2 * half
        dp3, dl3, da3, r, w, speed, spin = rates(
            kind, plates, p + dp2 * half, l + dl2 * half, q_stage, lift + da2 * half, gravity, turn
        )
        dq3 = orientation_rate(q_stage, w)
        dx += wp.quat_rotate(q_stage, r) * third
        q_stage = q + dq3 * h
        dp4, dl4, da4, r, w, speed, spin = rates(kind, plates, p + dp3 * h, l + dl3 * h, q_stage, lift + da3 * h, gravity, turn)
        dq4 = orientation_rate(q_stage, w)
        dx += wp.quat_rotate(q_stage, r) * sixth
        return (
            p + (dp1 + dp4) * sixth + (dp2 + dp3) * third,
            l + (dl1 + dl4) * sixth + (dl2 + dl3) * third,
            wp.normalize(q + (dq1 + dq4) * sixth + (dq2 + dq3) * third),
            lift + (da1 + da4) * sixth + (da2 + da3) * third,
            dx,
        )

    return step
