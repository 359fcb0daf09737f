"""Mean flow on the voxel grid: gradients, implicit momentum, face fluxes with pressure-velocity coupling, projection.

Incompressible Reynolds-averaged equations, pressure over density p [m^2/s^2]:
    du/dt + u . grad u = -grad p + div((nu + nu_T) (grad u + grad u^T)),   div u = 0.
Sides x-, x+, y-, y+, z-, z+ are faces 0..5 of every cell; flux_x[i] is the velocity through the face between i-1 and i.
"""

import warp as wp

from warp_immersed.kernels.grid import (
    INLET,
    OBSTACLE,
    OPEN,
    OUTLET,
    SLIP,
    WALL,
    Grid,
    Side,
    Stencil,
    boundary_velocity,
    face_kind,
    is_solid,
    next_cell,
    previous_cell,
    red_black_cell,
    side_of,
)
from warp_immersed.kernels.k_epsilon import wall_viscosity

wp.set_module_options({"enable_backward": False})


@wp.func
def velocity_at_face(code: int, face: int, own: wp.vec3, other: wp.vec3, height: float, sides: wp.array(dtype=Side)) -> wp.vec3:
    """Mean velocity on a face [m/s]: interpolated, given, or continued."""
    kind = face_kind(code, face)
    if kind == OPEN:
        return 0.5 * (own + other)
    if kind == WALL or kind == OBSTACLE or kind == INLET:
        return boundary_velocity(sides[side_of(kind, face)], height)
    if kind == SLIP:
        inside = own
        inside[face >> 1] = 0.0
        return inside
    return own


@wp.func
def pressure_at_face(code: int, face: int, own: float, other: float) -> float:
    """Pressure on a face: interpolated, zero at an outlet, else continued."""
    if code == 0:
        return 0.5 * (own + other)
    kind = face_kind(code, face)
    if kind == OPEN:
        return 0.5 * (own + other)
    return wp.where(kind == OUTLET, 0.0, own)


@wp.kernel
def differentiate_velocity(
    grid: Grid,
    first_plane: int,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    velocity: wp.array3d(dtype=wp.vec3),
    dx_out: wp.array3d(dtype=wp.vec3),
    dy_out: wp.array3d(dtype=wp.vec3),
    dz_out: wp.array3d(dtype=wp.vec3),
):
    """d(velocity)/dx, /dy, /dz [1/s] of every fluid cell by Gauss's theorem with linear interpolation."""
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    inv = grid.inverse
    i0 = previous_cell(i, n[0], grid.wraps[0])
    i1 = next_cell(i, n[0], grid.wraps[0])
    j0 = previous_cell(j, n[1], grid.wraps[1])
    j1 = next_cell(j, n[1], grid.wraps[1])
    k0 = previous_cell(k, n[2], grid.wraps[2])
    k1 = next_cell(k, n[2], grid.wraps[2])
    if code == 0:
        dx_out[i, j, k] = 0.5 * inv[0] * (velocity[i1, j, k] - velocity[i0, j, k])
        dy_out[i, j, k] = 0.5 * inv[1] * (velocity[i, j1, k] - velocity[i, j0, k])
        dz_out[i, j, k] = 0.5 * inv[2] * (velocity[i, j, k1] - velocity[i, j, k0])
        return
    u = velocity[i, j, k]
    y = grid.lower[1] + (float(j) + 0.5) * grid.spacing[1]
    h = 0.5 * grid.spacing[1]
    dx_out[i, j, k] = inv[0] * (
        velocity_at_face(code, 1, u, velocity[i1, j, k], y, sides) - velocity_at_face(code, 0, u, velocity[i0, j, k], y, sides)
    )
    dy_out[i, j, k] = inv[1] * (
        velocity_at_face(code, 3, u, velocity[i, j1, k], y + h, sides)
        - velocity_at_face(code, 2, u, velocity[i, j0, k], y - h, sides)
    )
    if n[2] > 1:
        dz_out[i, j, k] = inv[2] * (
            velocity_at_face(code, 5, u, velocity[i, j, k1], y, sides)
            - velocity_at_face(code, 4, u, velocity[i, j, k0], y, sides)
        )


@wp.func
def limited_slope(back: float, step: float) -> float:
    """Slope from the differences on both sides (van Albada, van Leer and Roberts 1982): smooth, zero at extrema."""
    product = back * step
    if product <= 0.0:
        return 0.0
    return product * (back + step) / (back * back + step * step)


@wp.func
def upwind_correction(slope: wp.vec3, step: wp.vec3, limited: int) -> wp.vec3:
    """Value on the downwind face less the value of the upwind cell [m/s].

    slope: central difference across the upwind cell times its size; step: downwind less upwind value.
    """
    if limited == 0:
        return 0.5 * slope
    back = 2.0 * slope - step
    return 0.5 * wp.vec3(limited_slope(back[0], step[0]), limited_slope(back[1], step[1]), limited_slope(back[2], step[2]))


@wp.func
def momentum_face(
    code: int,
    face: int,
    flux: float,
    own: wp.vec3,
    other: wp.vec3,
    effective: float,
    effective_other: float,
    inverse: float,
    slope: wp.vec3,
    slope_other: wp.vec3,
    k: float,
    viscosity: float,
    height: float,
    limited: int,
    sides: wp.array(dtype=Side),
) -> wp.vec4:
    """One face's share: (residual [m/s^2], coefficient [1/s]).

    flux: velocity out of the cell over the cell size [1/s]; slopes: outward derivative times the cell size [m/s].
    """
    kind = face_kind(code, face)
    square = inverse * inverse
    inflow = wp.max(-flux, 0.0)
    if kind == OPEN:
        a = 0.5 * (effective + effective_other) * square + inflow
        step = other - own
        if flux > 0.0:
            part = a * step - flux * upwind_correction(slope, step, limited)
        else:
            part = a * step - flux * upwind_correction(-slope_other, -step, limited)
        return wp.vec4(part[0], part[1], part[2], a)
    if kind == WALL or kind == OBSTACLE:
        side = sides[side_of(kind, face)]
        a = 2.0 * square * wall_viscosity(k, 0.5 / inverse, side.roughness, viscosity)
        part = a * (side.velocity - own)
        return wp.vec4(part[0], part[1], part[2], a)
    if kind == INLET:
        a = 2.0 * square * effective + inflow
        part = a * (boundary_velocity(sides[face], height) - own)
        return wp.vec4(part[0], part[1], part[2], a)
    if kind == SLIP:
        a = 2.0 * square * effective
        part = wp.vec3(0.0, 0.0, 0.0)
        part[face >> 1] = -a * own[face >> 1]
        return wp.vec4(part[0], part[1], part[2], a)
    return wp.vec4(0.0, 0.0, 0.0, 0.0)


@wp.kernel
def assemble_momentum(
    grid: Grid,
    first_plane: int,
    viscosity: float,
    inverse_dt: float,
    limited: int,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    velocity: wp.array3d(dtype=wp.vec3),
    velocity_dx: wp.array3d(dtype=wp.vec3),
    velocity_dy: wp.array3d(dtype=wp.vec3),
    velocity_dz: wp.array3d(dtype=wp.vec3),
    turbulence: wp.array3d(dtype=wp.vec2),
    eddy: wp.array3d(dtype=float),
    pressure: wp.array3d(dtype=float),
    flux_x: wp.array3d(dtype=float),
    flux_y: wp.array3d(dtype=float),
    flux_z: wp.array3d(dtype=float),
    stencil_out: wp.array3d(dtype=Stencil),
    residual_out: wp.array3d(dtype=wp.vec3),
    gradient_out: wp.array3d(dtype=wp.vec3),
    change_out: wp.array3d(dtype=wp.vec3),
):
    """Residual of the steady momentum equation [m/s^2], the implicit equation of its change, grad p, and a first guess.

    Convection is in the form u . grad u, so that a flux that is not yet divergence-free makes no momentum; second order
    as a deferred correction (linear upwind, limited).
    """
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    inv = grid.inverse
    h = grid.spacing
    u = velocity[i, j, k]
    t = turbulence[i, j, k][0]
    p = pressure[i, j, k]
    own = eddy[i, j, k]
    nu = viscosity + own
    y = grid.lower[1] + (float(j) + 0.5) * h[1]
    half = 0.5 * h[1]
    i0 = previous_cell(i, n[0], grid.wraps[0])
    i1 = next_cell(i, n[0], grid.wraps[0])
    j0 = previous_cell(j, n[1], grid.wraps[1])
    j1 = next_cell(j, n[1], grid.wraps[1])

    dx = velocity_dx[i, j, k]
    e0 = eddy[i0, j, k]
    e1 = eddy[i1, j, k]
    g = h[0] * dx
    w = momentum_face(code, 0, -flux_x[i, j, k] * inv[0], u, velocity[i0, j, k], nu, viscosity + e0, inv[0],
                      -g, -h[0] * velocity_dx[i0, j, k], t, viscosity, y, limited, sides)  # fmt: skip
    e = momentum_face(code, 1, flux_x[i + 1, j, k] * inv[0], u, velocity[i1, j, k], nu, viscosity + e1, inv[0],
                      g, h[0] * velocity_dx[i1, j, k], t, viscosity, y, limited, sides)  # fmt: skip
    px = inv[0] * (pressure_at_face(code, 1, p, pressure[i1, j, k]) - pressure_at_face(code, 0, p, pressure[i0, j, k]))
    nux = inv[0] * (eddy_at_face(code, 1, own, e1) - eddy_at_face(code, 0, own, e0))

    dy = velocity_dy[i, j, k]
    e0 = eddy[i, j0, k]
    e1 = eddy[i, j1, k]
    g = h[1] * dy
    s = momentum_face(code, 2, -flux_y[i, j, k] * inv[1], u, velocity[i, j0, k], nu, viscosity + e0, inv[1],
                      -g, -h[1] * velocity_dy[i, j0, k], t, viscosity, y - half, limited, sides)  # fmt: skip
    m = momentum_face(code, 3, flux_y[i, j + 1, k] * inv[1], u, velocity[i, j1, k], nu, viscosity + e1, inv[1],
                      g, h[1] * velocity_dy[i, j1, k], t, viscosity, y + half, limited, sides)  # fmt: skip
    py = inv[1] * (pressure_at_face(code, 3, p, pressure[i, j1, k]) - pressure_at_face(code, 2, p, pressure[i, j0, k]))
    nuy = inv[1] * (eddy_at_face(code, 3, own, e1) - eddy_at_face(code, 2, own, e0))

    b = wp.vec4(0.0, 0.0, 0.0, 0.0)
    f = wp.vec4(0.0, 0.0, 0.0, 0.0)
    pz = float(0.0)
    nuz = float(0.0)
    dz = wp.vec3(0.0, 0.0, 0.0)
    if n[2] > 1:
        k0 = previous_cell(k, n[2], grid.wraps[2])
        k1 = next_cell(k, n[2], grid.wraps[2])
        dz = velocity_dz[i, j, k]
        e0 = eddy[i, j, k0]
        e1 = eddy[i, j, k1]
        g = h[2] * dz
        b = momentum_face(code, 4, -flux_z[i, j, k] * inv[2], u, velocity[i, j, k0], nu, viscosity + e0, inv[2],
                          -g, -h[2] * velocity_dz[i, j, k0], t, viscosity, y, limited, sides)  # fmt: skip
        f = momentum_face(code, 5, flux_z[i, j, k + 1] * inv[2], u, velocity[i, j, k1], nu, viscosity + e1, inv[2],
                          g, h[2] * velocity_dz[i, j, k1], t, viscosity, y, limited, sides)  # fmt: skip
        pz = inv[2] * (pressure_at_face(code, 5, p, pressure[i, j, k1]) - pressure_at_face(code, 4, p, pressure[i, j, k0]))
        nuz = inv[2] * (eddy_at_face(code, 5, own, e1) - eddy_at_face(code, 4, own, e0))

    total = w + e + s + m + b + f
    gradient = wp.vec3(px, py, pz)
    slope_nu = wp.vec3(nux, nuy, nuz)
    residual = wp.vec3(
        total[0] - px + wp.dot(slope_nu, dx), total[1] - py + wp.dot(slope_nu, dy), total[2] - pz + wp.dot(slope_nu, dz)
    )
    inverse_diagonal = 1.0 / (inverse_dt + total[3])
    if code != 0:
        zero = wp.vec4(0.0, 0.0, 0.0, 0.0)
        w = wp.where(face_kind(code, 0) == OPEN, w, zero)
        e = wp.where(face_kind(code, 1) == OPEN, e, zero)
        s = wp.where(face_kind(code, 2) == OPEN, s, zero)
        m = wp.where(face_kind(code, 3) == OPEN, m, zero)
        b = wp.where(face_kind(code, 4) == OPEN, b, zero)
        f = wp.where(face_kind(code, 5) == OPEN, f, zero)
    stencil_out[i, j, k] = Stencil(w[3], e[3], s[3], m[3], b[3], f[3], inverse_diagonal, 0.0)
    residual_out[i, j, k] = residual
    gradient_out[i, j, k] = gradient
    change_out[i, j, k] = inverse_diagonal * residual


@wp.func
def eddy_at_face(code: int, face: int, own: float, other: float) -> float:
    """Eddy viscosity [m^2/s] at a cell face: the mean of both sides inside, the cell's own at a boundary."""
    if face_kind(code, face) == OPEN:
        return 0.5 * (own + other)
    return own


@wp.kernel
def sweep_momentum(
    grid: Grid,
    first_plane: int,
    color: int,
    stencil: wp.array3d(dtype=Stencil),
    residual: wp.array3d(dtype=wp.vec3),
    change: wp.array3d(dtype=wp.vec3),
):
    """One half of a red-black Gauss-Seidel sweep of the change of velocity [m/s], in place."""
    a, b, c = wp.tid()
    cell = red_black_cell(first_plane, a, b, c, color, grid.cells)
    i = cell[0]
    j = cell[1]
    k = cell[2]
    n = grid.cells
    if j >= n[1] or k >= n[2]:
        return
    p = stencil[i, j, k]
    total = (
        residual[i, j, k]
        + p[0] * change[previous_cell(i, n[0], grid.wraps[0]), j, k]
        + p[1] * change[next_cell(i, n[0], grid.wraps[0]), j, k]
        + p[2] * change[i, previous_cell(j, n[1], grid.wraps[1]), k]
        + p[3] * change[i, next_cell(j, n[1], grid.wraps[1]), k]
    )
    if n[2] > 1:
        total += p[4] * change[i, j, previous_cell(k, n[2], grid.wraps[2])]
        total += p[5] * change[i, j, next_cell(k, n[2], grid.wraps[2])]
    change[i, j, k] = p[6] * total
