"""Implicit transport of k and epsilon: limited second-order convection, nu_T diffusion, Patankar sources, red-black sweeps."""

import warp as wp

from warp_immersed.kernels.grid import (
    INLET,
    OPEN,
    Grid,
    Side,
    Stencil,
    boundary_turbulence,
    face_kind,
    is_solid,
    next_cell,
    previous_cell,
    red_black_cell,
)
from warp_immersed.kernels.k_epsilon import C_1, C_2, C_MU, FLOOR, SIGMA_EPSILON

wp.set_module_options({"enable_backward": False})


@wp.func
def limited_step(slope: wp.vec2, step: wp.vec2) -> wp.vec2:
    """Half the step to the downwind cell, limited to keep k and epsilon bounded: psi = max(0, min(2 r, 1)) (Sweby 1984).

    slope: central difference across the upwind cell times its size; step: downwind minus upwind value; r = 2 slope / step - 1.
    """
    return wp.vec2(limited_half(slope[0], step[0]), limited_half(slope[1], step[1]))


@wp.func
def limited_half(slope: float, step: float) -> float:
    """Half a step between cells, limited so that a face value makes no new extremum (limited linear scheme)."""
    back = 2.0 * slope - step
    if back * step <= 0.0:
        return 0.0
    if wp.abs(step) < 2.0 * wp.abs(back):
        return 0.5 * step
    return back


@wp.kernel
def difference_turbulence(
    grid: Grid,
    first_plane: int,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    turbulence: wp.array3d(dtype=wp.vec2),
    dx_out: wp.array3d(dtype=wp.vec2),
    dy_out: wp.array3d(dtype=wp.vec2),
    dz_out: wp.array3d(dtype=wp.vec2),
):
    """Central differences of (k, epsilon) across each cell along x, y, z (not divided by the spacing)."""
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    t = turbulence[i, j, k]
    y = grid.lower[1] + (float(j) + 0.5) * grid.spacing[1]
    i0 = previous_cell(i, n[0], grid.wraps[0])
    i1 = next_cell(i, n[0], grid.wraps[0])
    j0 = previous_cell(j, n[1], grid.wraps[1])
    j1 = next_cell(j, n[1], grid.wraps[1])
    dx_out[i, j, k] = difference_across(code, 0, t, turbulence[i0, j, k], turbulence[i1, j, k], y, y, sides)
    h = 0.5 * grid.spacing[1]
    dy_out[i, j, k] = difference_across(code, 2, t, turbulence[i, j0, k], turbulence[i, j1, k], y - h, y + h, sides)
    if n[2] > 1:
        k0 = previous_cell(k, n[2], grid.wraps[2])
        k1 = next_cell(k, n[2], grid.wraps[2])
        dz_out[i, j, k] = difference_across(code, 4, t, turbulence[i, j, k0], turbulence[i, j, k1], y, y, sides)


@wp.func
def difference_across(
    code: int, face: int, own: wp.vec2, before: wp.vec2, after: wp.vec2, y0: float, y1: float, sides: wp.array(dtype=Side)
) -> wp.vec2:
    """Difference of (k, epsilon) between the two faces of a cell along an axis."""
    return turbulence_at_face(code, face + 1, own, after, y1, sides) - turbulence_at_face(code, face, own, before, y0, sides)


@wp.func
def turbulence_at_face(code: int, face: int, own: wp.vec2, other: wp.vec2, height: float, sides: wp.array(dtype=Side)) -> wp.vec2:
    """(k, epsilon) at a cell face: the mean of both sides inside, the inlet's value, or the cell's own at other boundaries."""
    kind = face_kind(code, face)
    if kind == OPEN:
        return 0.5 * (own + other)
    if kind == INLET:
        return boundary_turbulence(sides[face], height)
    return own


@wp.func
def transport_face(
    code: int,
    face: int,
    flux: float,
    own: wp.vec2,
    other: wp.vec2,
    diffusion: float,
    eddy: float,
    eddy_other: float,
    inverse_square: float,
    slope: wp.vec2,
    slope_other: wp.vec2,
    height: float,
    sides: wp.array(dtype=Side),
) -> wp.vec4:
    """One face's share of the equations: coefficients of k and of epsilon [1/s], sources of k and of epsilon.

    flux: velocity out of the cell through the face over the cell size [1/s]; slopes point out of the cell; diffusion is nu.
    """
    kind = face_kind(code, face)
    inflow = wp.max(-flux, 0.0)
    if kind == OPEN:
        nu_t = 0.5 * (eddy + eddy_other)
        step = other - own
        if flux > 0.0:
            deferred = -flux * limited_step(slope, step)
        else:
            deferred = -flux * limited_step(-slope_other, -step)
        return wp.vec4(
            (diffusion + nu_t) * inverse_square + inflow,
            (diffusion + nu_t / SIGMA_EPSILON) * inverse_square + inflow,
            deferred[0],
            deferred[1],
        )
    if kind == INLET:
        given = boundary_turbulence(sides[face], height)
        a_k = 2.0 * (diffusion + eddy) * inverse_square + inflow
        a_e = 2.0 * (diffusion + eddy / SIGMA_EPSILON) * inverse_square + inflow
        return wp.vec4(a_k, a_e, a_k * given[0], a_e * given[1])
    return wp.vec4(0.0, 0.0, 0.0, 0.0)


@wp.kernel
def assemble_turbulence(
    grid: Grid,
    first_plane: int,
    viscosity: float,
    inverse_dt: float,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    turbulence: wp.array3d(dtype=wp.vec2),
    slope_x: wp.array3d(dtype=wp.vec2),
    slope_y: wp.array3d(dtype=wp.vec2),
    slope_z: wp.array3d(dtype=wp.vec2),
    eddy: wp.array3d(dtype=float),
    source: wp.array3d(dtype=wp.vec3),
    flux_x: wp.array3d(dtype=float),
    flux_y: wp.array3d(dtype=float),
    flux_z: wp.array3d(dtype=float),
    k_out: wp.array3d(dtype=Stencil),
    epsilon_out: wp.array3d(dtype=Stencil),
):
    """The implicit equations of k and epsilon of every fluid cell, with non-negative coefficients and right-hand sides.

    Sinks, and deferred corrections that are negative, go to the diagonal as a rate times the unknown (Patankar 1980,
    section 7.2), so that every sweep keeps k and epsilon positive. C_1 epsilon/k G is written C_1 C_mu k 2 S_ij S_ij.
    epsilon next to walls is fixed. A source of (0, 0, -1) means that the sources of the cell are dealt with elsewhere.
    """
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    inv = grid.inverse
    t = turbulence[i, j, k]
    nu = eddy[i, j, k]
    i0 = previous_cell(i, n[0], grid.wraps[0])
    i1 = next_cell(i, n[0], grid.wraps[0])
    j0 = previous_cell(j, n[1], grid.wraps[1])
    j1 = next_cell(j, n[1], grid.wraps[1])
    y = grid.lower[1] + (float(j) + 0.5) * grid.spacing[1]
    half = 0.5 * grid.spacing[1]

    g = slope_x[i, j, k]
    w = transport_face(code, 0, -flux_x[i, j, k] * inv[0], t, turbulence[i0, j, k], viscosity, nu, eddy[i0, j, k],
                       inv[0] * inv[0], -g, -slope_x[i0, j, k], y, sides)  # fmt: skip
    e = transport_face(code, 1, flux_x[i + 1, j, k] * inv[0], t, turbulence[i1, j, k], viscosity, nu, eddy[i1, j, k],
                       inv[0] * inv[0], g, slope_x[i1, j, k], y, sides)  # fmt: skip
    g = slope_y[i, j, k]
    s = transport_face(code, 2, -flux_y[i, j, k] * inv[1], t, turbulence[i, j0, k], viscosity, nu, eddy[i, j0, k],
                       inv[1] * inv[1], -g, -slope_y[i, j0, k], y - half, sides)  # fmt: skip
    m = transport_face(code, 3, flux_y[i, j + 1, k] * inv[1], t, turbulence[i, j1, k], viscosity, nu, eddy[i, j1, k],
                       inv[1] * inv[1], g, slope_y[i, j1, k], y + half, sides)  # fmt: skip
    b = wp.vec4(0.0, 0.0, 0.0, 0.0)
    f = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if n[2] > 1:
        k0 = previous_cell(k, n[2], grid.wraps[2])
        k1 = next_cell(k, n[2], grid.wraps[2])
        g = slope_z[i, j, k]
        b = transport_face(code, 4, -flux_z[i, j, k] * inv[2], t, turbulence[i, j, k0], viscosity, nu, eddy[i, j, k0],
                           inv[2] * inv[2], -g, -slope_z[i, j, k0], y, sides)  # fmt: skip
        f = transport_face(code, 5, flux_z[i, j, k + 1] * inv[2], t, turbulence[i, j, k1], viscosity, nu, eddy[i, j, k1],
                           inv[2] * inv[2], g, slope_z[i, j, k1], y, sides)  # fmt: skip

    total = w + e + s + m + b + f
    made = source[i, j, k]
    own_k = wp.max(t[0], FLOOR)
    rate = wp.where(made[2] < 0.0, 0.0, t[1] / own_k)
    diagonal = inverse_dt + total[0] + rate + wp.max(-total[2], 0.0) / own_k
    rhs = inverse_dt * t[0] + made[0] + wp.max(total[2], 0.0)
    if code != 0:
        w = wp.where(face_kind(code, 0) == OPEN, w, wp.vec4(0.0, 0.0, 0.0, 0.0))
        e = wp.where(face_kind(code, 1) == OPEN, e, wp.vec4(0.0, 0.0, 0.0, 0.0))
        s = wp.where(face_kind(code, 2) == OPEN, s, wp.vec4(0.0, 0.0, 0.0, 0.0))
        m = wp.where(face_kind(code, 3) == OPEN, m, wp.vec4(0.0, 0.0, 0.0, 0.0))
        b = wp.where(face_kind(code, 4) == OPEN, b, wp.vec4(0.0, 0.0, 0.0, 0.0))
        f = wp.where(face_kind(code, 5) == OPEN, f, wp.vec4(0.0, 0.0, 0.0, 0.0))
    k_out[i, j, k] = Stencil(w[0], e[0], s[0], m[0], b[0], f[0], 1.0 / diagonal, rhs)
    if made[2] > 0.0:
        epsilon_out[i, j, k] = Stencil(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, made[2])
        return
    diagonal = inverse_dt + total[1] + C_2 * rate + wp.max(-total[3], 0.0) / wp.max(t[1], FLOOR)
    rhs = inverse_dt * t[1] + C_1 * C_MU * t[0] * made[1] + wp.max(total[3], 0.0)
    epsilon_out[i, j, k] = Stencil(w[1], e[1], s[1], m[1], b[1], f[1], 1.0 / diagonal, rhs)


@wp.kernel
def sweep_turbulence(
    grid: Grid,
    first_plane: int,
    color: int,
    k_equation: wp.array3d(dtype=Stencil),
    epsilon_equation: wp.array3d(dtype=Stencil),
    turbulence: wp.array3d(dtype=wp.vec2),
):
    """One half of a red-black Gauss-Seidel sweep, in place; the floor keeps both positive."""
    a, b, c = wp.tid()
    cell = red_black_cell(first_plane, a, b, c, color, grid.cells)
    i = cell[0]
    j = cell[1]
    k = cell[2]
    n = grid.cells
    if j >= n[1] or k >= n[2]:
        return
    p = k_equation[i, j, k]
    q = epsilon_equation[i, j, k]
    w = turbulence[previous_cell(i, n[0], grid.wraps[0]), j, k]
    e = turbulence[next_cell(i, n[0], grid.wraps[0]), j, k]
    s = turbulence[i, previous_cell(j, n[1], grid.wraps[1]), k]
    m = turbulence[i, next_cell(j, n[1], grid.wraps[1]), k]
    sum_k = p[7] + p[0] * w[0] + p[1] * e[0] + p[2] * s[0] + p[3] * m[0]
    sum_e = q[7] + q[0] * w[1] + q[1] * e[1] + q[2] * s[1] + q[3] * m[1]
    if n[2] > 1:
        d = turbulence[i, j, previous_cell(k, n[2], grid.wraps[2])]
        f = turbulence[i, j, next_cell(k, n[2], grid.wraps[2])]
        sum_k += p[4] * d[0] + p[5] * f[0]
        sum_e += q[4] * d[1] + q[5] * f[1]
    turbulence[i, j, k] = wp.vec2(wp.max(sum_k * p[6], FLOOR), wp.max(sum_e * q[6], FLOOR))
