"""The wind a body sees: an Ornstein-Uhlenbeck process, advanced by its exact transition."""

from typing import Any

import warp as wp

from warp_immersed.kernels.philox import (
    STREAM_INITIAL_WIND,
    STREAM_SEEN_WIND,
    byte_sum_normals,
    gaussian_normals,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def as_vector(like: Any, v: wp.vec3):
    """v in the precision of `like`."""
    return type(like)(like.dtype(v[0]), like.dtype(v[1]), like.dtype(v[2]))


@wp.func
def initial_seen_wind(environment: Any, random_key: wp.uint32, body: wp.int32):
    """A stationary fluctuation: Gaussian with variance 2 k / 3 a component."""
    normals = gaussian_normals(body, 0, STREAM_INITIAL_WIND, environment.seed, random_key)
    return as_vector(environment.gravity, normals) * environment.wind_sigma


@wp.func
def next_seen_wind(environment: Any, seen_wind: Any, random_key: wp.uint32, body: wp.int32, step: wp.int32):
    """u(t + h) = e u(t) + sigma (1 - e^2)^(1/2) xi with e = exp(-h / T_L): no bias at any h (Uhlenbeck & Ornstein 1930)."""
    normals = byte_sum_normals(body, step, STREAM_SEEN_WIND, environment.seed, random_key)
    return seen_wind * environment.wind_decay + as_vector(seen_wind, normals) * environment.wind_kick
