"""The standard k-epsilon model: closure, wall functions, and sources.

Launder and Spalding (1974) with C_mu .09, C_1 1.44, C_2 1.92, sigma_k 1.0, sigma_epsilon 1.3, kappa .41, E 9.8.
k and epsilon travel together as wp.vec2 (k [m^2/s^2], epsilon [m^2/s^3]).
"""

import warp as wp

from warp_immersed.kernels.grid import OBSTACLE, VON_KARMAN, WALL, Grid, Side, face_kind, is_solid, side_of

wp.set_module_options({"enable_backward": False})

C_MU = wp.constant(0.09)
C_MU_25 = wp.constant(0.5477225575051661)  # C_mu^(1/4)
C_MU_75 = wp.constant(0.1643167672515498)  # C_mu^(3/4)
C_1 = wp.constant(1.44)
C_2 = wp.constant(1.92)
SIGMA_EPSILON = wp.constant(1.3)
SMOOTH_WALL = wp.constant(9.8)  # E of the logarithmic law
LAMINAR_Y_PLUS = wp.constant(11.53)  # where y+ = ln(E y+) / kappa
FLOOR = wp.constant(1.0e-12)
CEILING = wp.constant(1.0e18)  # keeps k^2 finite in single precision


@wp.func
def wall_viscosity(k: float, distance: float, roughness: float, viscosity: float) -> float:
    """nu + nu_T at a wall face [m^2/s] by the wall law in k^(1/2) (Launder and Spalding 1974); ln((y + z0) / z0) if rough."""
    u = C_MU_25 * wp.sqrt(k)
    y_plus = u * distance / viscosity
    if roughness > 0.0:
        return wp.max(viscosity, VON_KARMAN * u * distance / wp.log(1.0 + distance / roughness))
    if y_plus > LAMINAR_Y_PLUS:
        return viscosity * VON_KARMAN * y_plus / wp.log(SMOOTH_WALL * y_plus)
    return viscosity


@wp.func
def eddy_viscosity(k: float, epsilon: float, cap: float) -> float:
    """nu_T = C_mu k^2 / epsilon [m^2/s], no more than cap."""
    return wp.min(C_MU * k * k / wp.max(epsilon, FLOOR), cap)


@wp.func
def add_wall(
    wall: wp.vec3, code: int, face: int, half: float, velocity: wp.vec3, k: float, viscosity: float, sides: wp.array(dtype=Side)
) -> wp.vec3:
    """Add one face's share to (number of walls, production, epsilon) if it is a wall; half is the distance to it [m]."""
    kind = face_kind(code, face)
    if kind != WALL and kind != OBSTACLE:
        return wall
    side = sides[side_of(kind, face)]
    shear = wp.length(velocity - side.velocity) / half
    rate = C_MU_25 * wp.sqrt(k) / (VON_KARMAN * half)
    production = wall_viscosity(k, half, side.roughness, viscosity) * shear * rate
    return wall + wp.vec3(1.0, production, C_MU_75 * k * wp.sqrt(k) / (VON_KARMAN * half))


@wp.func
def log_bracket(x: float, slope: float) -> float:
    """ln(cosh x + slope sinh(x) / x), without overflow; x >= 0, slope >= 0."""
    shrink = wp.exp(-2.0 * x)
    ratio = 1.0 - x + 2.0 / 3.0 * x * x  # e^-x sinh(x) / x for small x
    if x > 0.02:
        ratio = 0.5 * (1.0 - shrink) / x
    return x + wp.log(0.5 * (1.0 + shrink) + slope * ratio)


@wp.func
def advance_sources(t: wp.vec2, strain: float, dt: float) -> wp.vec2:
    """(k, epsilon) after dt [s] of production and dissipation alone, exactly, at any dt; strain = 2 S_ij S_ij [1/s^2], held.

    chi = epsilon/k obeys d chi/dt = a - b chi^2 with a = (C_1 - 1) C_mu strain, b = C_2 - 1; k and chi follow in closed form.
    """
    chi = t[1] / t[0]
    a = (C_1 - 1.0) * C_MU * strain
    b = C_2 - 1.0
    x = wp.sqrt(a * b) * dt
    gain = log_bracket(x, a * dt / chi)
    loss = log_bracket(x, b * dt * chi)
    growth = wp.min(gain / (C_1 - 1.0) - loss / b, 60.0)
    k = wp.clamp(t[0] * wp.exp(growth), FLOOR, CEILING)
    return wp.vec2(k, wp.clamp(k * chi * wp.exp(gain - loss), FLOOR, CEILING))


@wp.kernel
def advance_decay(dt: float, strain: float, turbulence: wp.array(dtype=wp.vec2)):
    """`advance_sources` for many values in place."""
    i = wp.tid()
    turbulence[i] = advance_sources(turbulence[i], strain, dt)


@wp.kernel
def close_model(
    grid: Grid,
    first_plane: int,
    viscosity: float,
    cap: float,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    velocity: wp.array3d(dtype=wp.vec3),
    turbulence: wp.array3d(dtype=wp.vec2),
    velocity_dx: wp.array3d(dtype=wp.vec3),
    velocity_dy: wp.array3d(dtype=wp.vec3),
    velocity_dz: wp.array3d(dtype=wp.vec3),
    eddy_out: wp.array3d(dtype=float),
    source_out: wp.array3d(dtype=wp.vec3),
):
    """nu_T and the sources of every fluid cell.

    source_out: (production of k G, 2 S_ij S_ij, 0), or next to walls (G of the wall law, 0, epsilon of the wall law).
    """
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    t = turbulence[i, j, k]
    nu_t = eddy_viscosity(t[0], t[1], cap)
    eddy_out[i, j, k] = nu_t
    half = 0.5 * grid.spacing
    if code != 0:
        wall = wp.vec3(0.0, 0.0, 0.0)
        u = velocity[i, j, k]
        for face in range(6):
            wall = add_wall(wall, code, face, half[face >> 1], u, t[0], viscosity, sides)
        if wall[0] > 0.0:
            source_out[i, j, k] = wp.vec3(wall[1] / wall[0], 0.0, wp.max(wall[2] / wall[0], FLOOR))
            return
    dx = velocity_dx[i, j, k]
    dy = velocity_dy[i, j, k]
    dz = velocity_dz[i, j, k]
    xy = dx[1] + dy[0]
    xz = dx[2] + dz[0]
    yz = dy[2] + dz[1]
    strain = 2.0 * (dx[0] * dx[0] + dy[1] * dy[1] + dz[2] * dz[2]) + xy * xy + xz * xz + yz * yz
    source_out[i, j, k] = wp.vec3(nu_t * strain, strain, 0.0)
