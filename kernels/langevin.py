"""The air a body sees: the mean flow where it is, and a fluctuation that follows an Ornstein-Uhlenbeck process.

The fluctuation is u = sigma w, sigma = (2 k / 3)^(1/2) where the body is, and w has unit variance and the exact transition

    w(t + h) = e w(t) + T (1 - e) grad(sigma) + (1 - e^2)^(1/2) xi,    e = exp(-h / T):

no bias at any h (Uhlenbeck & Ornstein 1930). Scaling by sigma makes the variance follow a k that changes in time or along the
path; the drift T (1 - e) grad(sigma) keeps what is well mixed well mixed where k varies in space (Wilson, Legg & Thomson,
Boundary-Layer Meteorol. 27 (1983) 163; Thomson, J. Fluid Mech. 180 (1987) 529). Eddies smaller than the body are averaged
out, and turn it instead: its seen rotation is a second such process. `warp_immersed/seen_turbulence.py` has the same
statistics for homogeneous turbulence, and says where they come from.
"""

from typing import Any

import warp as wp

from warp_immersed.kernels.philox import (
    STREAM_INITIAL_ROTATION,
    STREAM_INITIAL_WIND,
    STREAM_SEEN_ROTATION,
    STREAM_SEEN_WIND,
    byte_sum_normals,
    gaussian_normals,
)
from warp_immersed.kernels.sampling import FlowField, sample_flow, sample_slope

wp.set_module_options({"enable_backward": False})

PI = wp.constant(3.14159265)
# Longest excursion of the unit process that is believed: beyond it, a body has left all but vanishing turbulence.
LARGEST_EXCURSION = wp.constant(6.0)


@wp.struct
class SeenTurbulence:
    """What turbulence is to a body of a certain size, and what a wind step does to it.

    sigma: rms of one component of the seen fluctuation [m/s], and its gradient [1/s]; decay: e; drift: T (1 - e) [s];
    rotation_sigma: rms of one component of the seen rotation [rad/s], averaged over a wind step; rotation_decay: its e.
    """

    sigma: wp.float32
    sigma_slope: wp.vec3
    decay: wp.float32
    drift: wp.float32
    rotation_sigma: wp.float32
    rotation_decay: wp.float32


@wp.func
def as_vector(like: Any, v: wp.vec3):
    """v in the precision of `like`."""
    return type(like)(like.dtype(v[0]), like.dtype(v[1]), like.dtype(v[2]))


@wp.func
def as_floats(v: Any):
    """v in single precision, in which flows are stored."""
    return wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))


@wp.func
def seen_turbulence(
    k: wp.float32,
    epsilon: wp.float32,
    k_slope: wp.vec3,
    epsilon_slope: wp.vec3,
    viscosity: wp.float32,
    size: wp.float32,
    step: wp.float32,
):
    """The turbulence that a body of a size [m] sees, from the local k and epsilon and their gradients."""
    seen = SeenTurbulence()
    if k <= 0.0:
        return seen
    seen.decay = 1.0
    seen.drift = step
    seen.rotation_decay = 1.0
    kept = float(1.0)
    lost_slope = wp.vec3()
    if epsilon > 0.0:
        # share of k in eddies larger than the body, exact for the inertial range where it is small
        eddy = wp.cbrt(epsilon * size / PI)
        small = 2.25 * eddy * eddy / k
        base = 1.0 + small / 4.5
        kept = 1.0 / (base * base * base * base * wp.sqrt(base))
        lost_slope = (small / base) * (k_slope - (2.0 / 3.0 * k / epsilon) * epsilon_slope)
        reynolds = k * wp.sqrt(20.0 / (3.0 * viscosity * epsilon))
        c0 = 6.5 * wp.pow(1.0 + 140.0 * wp.pow(reynolds, -4.0 / 3.0), -0.75)
        rate = 0.75 * c0 * epsilon / (k * (2.0 - kept))
        seen.decay = wp.exp(-rate * step)
        if rate * step > 1.0e-3:
            seen.drift = (1.0 - seen.decay) / rate
        wave_number = PI / size
        vorticity = wp.sqrt(kept / (1.0 / (k * small * wave_number * wave_number) + viscosity / epsilon))
        passed = vorticity * step / 5.0
        seen.rotation_decay = wp.exp(-passed)
        averaged = float(1.0)
        if passed > 0.05:
            averaged = 2.0 * (passed - 1.0 + seen.rotation_decay) / (passed * passed)
        seen.rotation_sigma = vorticity * wp.sqrt(averaged / 12.0)
    seen.sigma = wp.sqrt(2.0 / 3.0 * k * kept)
    seen.sigma_slope = (kept / (3.0 * wp.max(seen.sigma, 1.0e-12))) * (k_slope + lost_slope)
    return seen


@wp.func
def uniform_air(kind: Any, environment: Any, flow: FlowField, position: Any, time: wp.float32):
    """Mean velocity [m/s], its gradient [1/s], and the turbulence a body sees where they are the same everywhere."""
    seen = SeenTurbulence()
    seen.sigma = kind.wind_sigma
    seen.decay = kind.wind_decay
    seen.rotation_sigma = kind.rotation_sigma
    seen.rotation_decay = kind.rotation_decay
    return environment.mean_wind, wp.mat33(), seen


@wp.func
def uneven_air(kind: Any, environment: Any, flow: FlowField, position: Any, time: wp.float32):
    """The same at a position and time in a flow."""
    place = as_floats(position)
    sample = sample_flow(flow, place, time)
    slope = sample_slope(flow, place, time)
    seen = seen_turbulence(
        sample.k,
        sample.epsilon,
        slope.k,
        slope.epsilon,
        wp.float32(environment.viscosity),
        kind.eddy_size,
        wp.float32(environment.wind_step),
    )
    return as_vector(environment.mean_wind, sample.velocity), slope.velocity, seen


@wp.func
def local_air(kind: Any, environment: Any, flow: FlowField, position: Any, time: wp.float32):
    """The same in either case."""
    if environment.wind_varies == 0:
        mean, gradient, seen = uniform_air(kind, environment, flow, position, time)
    else:
        mean, gradient, seen = uneven_air(kind, environment, flow, position, time)
    return mean, gradient, seen


@wp.func
def half_curl(gradient: wp.mat33):
    """Rotation rate of a flow from the gradient of its velocity [rad/s]."""
    return 0.5 * wp.vec3(
        gradient[2, 1] - gradient[1, 2],
        gradient[0, 2] - gradient[2, 0],
        gradient[1, 0] - gradient[0, 1],
    )


@wp.func
def released_air(mean: Any, seen: SeenTurbulence, kind_key: wp.uint32, seed: wp.uint32, body: wp.int32):
    """The air seen at release, a stationary Gaussian fluctuation about the mean, and its fluctuating rotation."""
    normals = gaussian_normals(body, 0, STREAM_INITIAL_WIND, seed, kind_key)
    turns = gaussian_normals(body, 0, STREAM_INITIAL_ROTATION, seed, kind_key)
    return mean + as_vector(mean, seen.sigma * normals), as_vector(mean, seen.rotation_sigma * turns)


@wp.func
def next_air(
    air: Any,
    mean: Any,
    seen: SeenTurbulence,
    next_mean: Any,
    next_seen: SeenTurbulence,
    kind_key: wp.uint32,
    seed: wp.uint32,
    body: wp.int32,
    step: wp.int32,
):
    """The air seen one wind step later, from means and turbulence here and where the body will be."""
    next_value = next_mean
    if next_seen.sigma > 0.0:
        noise = byte_sum_normals(body, step, STREAM_SEEN_WIND, seed, kind_key)
        kick = wp.sqrt(wp.max(1.0 - seen.decay * seen.decay, 0.0)) * noise
        kick += 0.5 * seen.drift * (seen.sigma_slope + next_seen.sigma_slope)
        next_value = next_mean + as_vector(mean, next_seen.sigma * kick)
        if seen.sigma > 0.0:
            fluctuation = air - mean
            largest = LARGEST_EXCURSION * seen.sigma
            if wp.dot(fluctuation, fluctuation) > mean.dtype(largest * largest):
                fluctuation = wp.normalize(fluctuation) * mean.dtype(largest)
            next_value += fluctuation * mean.dtype(seen.decay * next_seen.sigma / seen.sigma)
    return next_value


@wp.func
def next_rotation(rotation: Any, seen: SeenTurbulence, kind_key: wp.uint32, seed: wp.uint32, body: wp.int32, step: wp.int32):
    """The fluctuating rotation seen one wind step later [rad/s]."""
    next_value = rotation - rotation
    if seen.rotation_sigma > 0.0:
        noise = byte_sum_normals(body, step, STREAM_SEEN_ROTATION, seed, kind_key)
        kick = seen.rotation_sigma * wp.sqrt(wp.max(1.0 - seen.rotation_decay * seen.rotation_decay, 0.0))
        next_value = rotation * rotation.dtype(seen.rotation_decay) + as_vector(rotation, kick * noise)
    return next_value
