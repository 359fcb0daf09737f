"""Sums in a fixed order: one thread a plane, so that they do not depend on the number of threads."""

import warp as wp

from warp_immersed.kernels.grid import is_solid

wp.set_module_options({"enable_backward": False})

Sums = wp.types.vector(length=8, dtype=wp.float64)


@wp.kernel
def measure_change(
    first_plane: int,
    faces: wp.array3d(dtype=int),
    velocity: wp.array3d(dtype=wp.vec3),
    turbulence: wp.array3d(dtype=wp.vec2),
    velocity_before: wp.array3d(dtype=wp.vec3),
    turbulence_before: wp.array3d(dtype=wp.vec2),
    divergence: wp.array3d(dtype=float),
    sums_out: wp.array2d(dtype=Sums),
):
    """Per row (i, j): sums of |du|^2, |dk|, k, |depsilon|, epsilon, |u|^2, and the largest |divergence| and |u|^2.

    A value that is not finite makes the sum not finite.
    """
    i, j = wp.tid()
    i += first_plane
    s = Sums()
    for k in range(velocity.shape[2]):
        if not is_solid(faces[i, j, k]):
            u = velocity[i, j, k]
            t = turbulence[i, j, k]
            du = u - velocity_before[i, j, k]
            dt = t - turbulence_before[i, j, k]
            s[0] = s[0] + wp.float64(wp.dot(du, du))
            s[1] = s[1] + wp.float64(wp.abs(dt[0]))
            s[2] = s[2] + wp.float64(t[0])
            s[3] = s[3] + wp.float64(wp.abs(dt[1]))
            s[4] = s[4] + wp.float64(t[1])
            s[5] = s[5] + wp.float64(wp.dot(u, u))
            s[6] = wp.max(s[6], wp.float64(wp.abs(divergence[i, j, k])))
            s[7] = wp.max(s[7], wp.float64(wp.dot(u, u)))
    sums_out[i, j] = s
