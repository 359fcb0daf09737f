"""The right-hand side of the equations of motion on its own, for integrators that live elsewhere: oracles and baselines."""

from typing import Any

import warp as wp

from warp_immersed.kernels.runge_kutta import orientation_rate
from warp_immersed.kernels.state_rates import quasi_steady_state_rates

wp.set_module_options({"enable_backward": False})


@wp.kernel
def body_rates(
    kinds: wp.array(dtype=Any),
    environments: wp.array(dtype=Any),
    kind_index: wp.array(dtype=wp.int32),
    state: wp.array2d(dtype=Any),
    rates_out: wp.array2d(dtype=Any),
    velocities_out: wp.array2d(dtype=Any),
):
    """Rates (N, 16) of states (N, 16) in still air: momentum, angular momentum (body axes, per unit mass), orientation, lift,
    position; and the velocities (N, 6) they stand for, body axes."""
    i = wp.tid()
    kind = kinds[kind_index[i]]
    gravity = environments[0].gravity
    p = type(gravity)(state[i, 0], state[i, 1], state[i, 2])
    l = type(gravity)(state[i, 3], state[i, 4], state[i, 5])
    q = wp.quaternion(state[i, 6], state[i, 7], state[i, 8], state[i, 9])
    lift = type(gravity)(state[i, 10], state[i, 11], state[i, 12])
    still = gravity - gravity  # the air does not turn
    dp, dl, da, r, w, speed, spin = quasi_steady_state_rates(kind, p, l, q, lift, gravity, still)
    dq = orientation_rate(q, w)
    dx = wp.quat_rotate(q, r)
    for j in range(3):
        rates_out[i, j] = dp[j]
        rates_out[i, 3 + j] = dl[j]
        rates_out[i, 10 + j] = da[j]
        rates_out[i, 13 + j] = dx[j]
        velocities_out[i, j] = r[j]
        velocities_out[i, 3 + j] = w[j]
    for j in range(4):
        rates_out[i, 6 + j] = dq[j]
