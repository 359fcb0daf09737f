"""The air a body sees: the mean flow where it is, and a fluctuation that follows an Ornstein-Uhlenbeck process.

The fluctuation is advanced by its exact transition, u(t + h) = e u(t) + sigma (1 - e^2)^(1/2) xi with e = exp(-h / T_L): no
bias at any h (Uhlenbeck & Ornstein 1930).
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.philox import (
    STREAM_INITIAL_WIND,
    STREAM_SEEN_WIND,
    byte_sum_normals,
    gaussian_normals,
)
from warp_immersed.kernels.sampling import FlowField, sample_flow

wp.set_module_options({"enable_backward": False})


@wp.func
def as_vector(like: Any, v: wp.vec3):
    """v in the precision of `like`."""
    return type(like)(like.dtype(v[0]), like.dtype(v[1]), like.dtype(v[2]))


@wp.func
def as_floats(v: Any):
    """v in single precision, in which flows are stored."""
    return wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))


@wp.func
def local_decay(k: wp.float32, epsilon: wp.float32, viscosity: wp.float32, step: wp.float32):
    """exp(-step / T_L), 1 / T_L = 3/4 C0 epsilon / k, C0 = 6.5 (1 + 140 R^(-4/3))^(-3/4), R = k (20 / (3 nu epsilon))^(1/2), as
    `warp_immersed.turbulence` has it for homogeneous turbulence; 0 without k, 1 without epsilon."""
    decay = float(0.0)
    if k > 0.0:
        decay = 1.0
        if epsilon > 0.0:
            reynolds = k * wp.sqrt(20.0 / (3.0 * viscosity * epsilon))
            c0 = 6.5 * wp.pow(1.0 + 140.0 * wp.pow(reynolds, -4.0 / 3.0), -0.75)
            decay = wp.exp(-0.75 * c0 * epsilon / k * step)
    return decay


@wp.func
def mean_air(environment: Any, flow: FlowField, position: Any, time: wp.float32):
    """Mean velocity [m/s] of the air at a position and time."""
    mean = environment.mean_wind
    if environment.wind_varies != 0:
        mean = as_vector(mean, sample_flow(flow, as_floats(position), time).velocity)
    return mean


@wp.func
def released_air(environment: Any, flow: FlowField, position: Any, time: wp.float32, random_key: wp.uint32, body: wp.int32):
    """The air seen at release: the mean and a stationary fluctuation, Gaussian with variance 2 k / 3 a component."""
    mean = environment.mean_wind
    sigma = environment.wind_sigma
    if environment.wind_varies != 0:
        sample = sample_flow(flow, as_floats(position), time)
        mean = as_vector(mean, sample.velocity)
        sigma = type(sigma)(wp.sqrt(2.0 / 3.0 * sample.k))
    normals = gaussian_normals(body, 0, STREAM_INITIAL_WIND, environment.seed, random_key)
    return mean + as_vector(mean, normals) * sigma


@wp.func
def next_air(
    environment: Any,
    flow: FlowField,
    air: Any,
    position: Any,
    next_position: Any,
    time: wp.float32,
    random_key: wp.uint32,
    body: wp.int32,
    step: wp.int32,
):
    """The air seen one wind step later, by a body that will then be at `next_position`."""
    mean = environment.mean_wind
    next_mean = environment.mean_wind
    decay = environment.wind_decay
    kick = environment.wind_kick
    if environment.wind_varies != 0:
        sample = sample_flow(flow, as_floats(position), time)
        mean = as_vector(mean, sample.velocity)
        local = local_decay(sample.k, sample.epsilon, wp.float32(environment.viscosity), wp.float32(environment.wind_step))
        decay = type(decay)(local)
        kick = type(kick)(wp.sqrt(2.0 / 3.0 * sample.k * wp.max(1.0 - local * local, 0.0)))
        next_mean = mean_air(environment, flow, next_position, time + wp.float32(environment.wind_step))
    normals = byte_sum_normals(body, step, STREAM_SEEN_WIND, environment.seed, random_key)
    return next_mean + (air - mean) * decay + as_vector(mean, normals) * kick
