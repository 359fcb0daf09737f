"""The right-hand side of the equations of motion on its own, for integrators that live elsewhere: oracles and baselines."""

import warp as wp

from warp_immersed.kernels.rigid_body import BodyKind64, Environment64, Plate64
from warp_immersed.kernels.runge_kutta import orientation_rate
from warp_immersed.kernels.state_rates import plates_state_rates, quasi_steady_state_rates

wp.set_module_options({"enable_backward": False})

PlateLifts = wp.types.vector(12, wp.float64)


@wp.kernel
def body_rates(
    kinds: wp.array(dtype=BodyKind64),
    plates: wp.array(dtype=Plate64),
    environments: wp.array(dtype=Environment64),
    kind_index: wp.array(dtype=wp.int32),
    state: wp.array2d(dtype=wp.float64),
    rates_out: wp.array2d(dtype=wp.float64),
    velocities_out: wp.array2d(dtype=wp.float64),
):
    """Rates (N, 25) of states (N, 25) in still air: momentum, angular momentum (body axes, per unit mass), orientation,
    position, lift of up to four plates; and the velocities (N, 6) they stand for, body axes."""
    i = wp.tid()
    kind = kinds[kind_index[i]]
    gravity = environments[0].gravity
    still = gravity - gravity  # the air does not turn
    p = wp.vec3d(state[i, 0], state[i, 1], state[i, 2])
    l = wp.vec3d(state[i, 3], state[i, 4], state[i, 5])
    q = wp.quatd(state[i, 6], state[i, 7], state[i, 8], state[i, 9])
    r = still
    w = still
    dp = still
    dl = still
    if kind.plate_count > 0:
        lifts = PlateLifts()
        for j in range(12):
            lifts[j] = state[i, 13 + j]
        dp, dl, lift_rates, r, w, speed, spin = plates_state_rates(kind, plates, p, l, q, lifts, gravity, still)
        for j in range(12):
            rates_out[i, 13 + j] = lift_rates[j]
    else:
        lift = wp.vec3d(state[i, 13], state[i, 14], state[i, 15])
        dp, dl, lift_rate, r, w, speed, spin = quasi_steady_state_rates(kind, plates, p, l, q, lift, gravity, still)
        for j in range(3):
            rates_out[i, 13 + j] = lift_rate[j]
    dq = orientation_rate(q, w)
    dx = wp.quat_rotate(q, r)
    for j in range(3):
        rates_out[i, j] = dp[j]
        rates_out[i, 3 + j] = dl[j]
        rates_out[i, 10 + j] = dx[j]
        velocities_out[i, j] = r[j]
        velocities_out[i, 3 + j] = w[j]
    for j in range(4):
        rates_out[i, 6 + j] = dq[j]
