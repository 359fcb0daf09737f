"""Coupling of pressure and velocity: face fluxes, their divergence, and the projection that removes it."""

import warp as wp

from warp_immersed.kernels.grid import (
    INLET,
    OPEN,
    OUTLET,
    Grid,
    Side,
    boundary_velocity,
    face_kind,
    is_solid,
    next_cell,
    previous_cell,
)

wp.set_module_options({"enable_backward": False})


@wp.func
def face_flux(
    code: int,
    face: int,
    own: wp.vec3,
    other: wp.vec3,
    gradient: wp.vec3,
    gradient_other: wp.vec3,
    p: float,
    p_other: float,
    inverse: float,
    coupling: float,
    height: float,
    sides: wp.array(dtype=Side),
) -> float:
    """Velocity along +axis through a face of a cell [m/s].

    Between cells it is interpolated with the pressure difference across the face in place of the interpolated pressure
    gradient (Rhie and Chow 1983); coupling [s] does not depend on the time step, so neither does the steady state.
    """
    kind = face_kind(code, face)
    axis = face >> 1
    if kind == OPEN:
        sign = wp.where((face & 1) == 1, 1.0, -1.0)
        difference = sign * (p_other - p) * inverse
        return 0.5 * (own[axis] + other[axis]) + coupling * (0.5 * (gradient[axis] + gradient_other[axis]) - difference)
    if kind == INLET:
        return boundary_velocity(sides[face], height)[axis]
    if kind == OUTLET:
        return own[axis]
    return 0.0


@wp.kernel
def predict_fluxes(
    grid: Grid,
    first_plane: int,
    coupling: float,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    velocity: wp.array3d(dtype=wp.vec3),
    change: wp.array3d(dtype=wp.vec3),
    gradient: wp.array3d(dtype=wp.vec3),
    pressure: wp.array3d(dtype=float),
    flux_x: wp.array3d(dtype=float),
    flux_y: wp.array3d(dtype=float),
    flux_z: wp.array3d(dtype=float),
):
    """Fluxes of velocity + change through the + faces of every fluid cell, and through its - faces at the sides of the domain.

    Fluxes of faces between solid cells are zero and never written.
    """
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    inv = grid.inverse
    u = velocity[i, j, k] + change[i, j, k]
    g = gradient[i, j, k]
    p = pressure[i, j, k]
    y = grid.lower[1] + (float(j) + 0.5) * grid.spacing[1]
    half = 0.5 * grid.spacing[1]
    o = next_cell(i, n[0], grid.wraps[0])
    flux_x[i + 1, j, k] = face_flux(code, 1, u, velocity[o, j, k] + change[o, j, k], g, gradient[o, j, k],
                                    p, pressure[o, j, k], inv[0], coupling, y, sides)  # fmt: skip
    o = next_cell(j, n[1], grid.wraps[1])
    flux_y[i, j + 1, k] = face_flux(code, 3, u, velocity[i, o, k] + change[i, o, k], g, gradient[i, o, k],
                                    p, pressure[i, o, k], inv[1], coupling, y + half, sides)  # fmt: skip
    if n[2] > 1:
        o = next_cell(k, n[2], grid.wraps[2])
        flux_z[i, j, k + 1] = face_flux(code, 5, u, velocity[i, j, o] + change[i, j, o], g, gradient[i, j, o],
                                        p, pressure[i, j, o], inv[2], coupling, y, sides)  # fmt: skip
    if i == 0:
        o = previous_cell(i, n[0], grid.wraps[0])
        flux_x[i, j, k] = face_flux(code, 0, u, velocity[o, j, k] + change[o, j, k], g, gradient[o, j, k],
                                    p, pressure[o, j, k], inv[0], coupling, y, sides)  # fmt: skip
    if j == 0:
        o = previous_cell(j, n[1], grid.wraps[1])
        flux_y[i, j, k] = face_flux(code, 2, u, velocity[i, o, k] + change[i, o, k], g, gradient[i, o, k],
                                    p, pressure[i, o, k], inv[1], coupling, y - half, sides)  # fmt: skip
    if k == 0 and n[2] > 1:
        o = previous_cell(k, n[2], grid.wraps[2])
        flux_z[i, j, k] = face_flux(code, 4, u, velocity[i, j, o] + change[i, j, o], g, gradient[i, j, o],
                                    p, pressure[i, j, o], inv[2], coupling, y, sides)  # fmt: skip


@wp.kernel
def diverge(
    grid: Grid,
    first_plane: int,
    faces: wp.array3d(dtype=int),
    flux_x: wp.array3d(dtype=float),
    flux_y: wp.array3d(dtype=float),
    flux_z: wp.array3d(dtype=float),
    divergence_out: wp.array3d(dtype=float),
):
    """Divergence of the face fluxes of every fluid cell [1/s]."""
    i, j, k = wp.tid()
    i += first_plane
    if is_solid(faces[i, j, k]):
        return
    inv = grid.inverse
    total = (flux_x[i + 1, j, k] - flux_x[i, j, k]) * inv[0] + (flux_y[i, j + 1, k] - flux_y[i, j, k]) * inv[1]
    if grid.cells[2] > 1:
        total += (flux_z[i, j, k + 1] - flux_z[i, j, k]) * inv[2]
    divergence_out[i, j, k] = total


@wp.func
def potential_at_face(code: int, face: int, own: float, other: float) -> float:
    """Pressure increment at a cell face: the mean of both sides inside, zero at an outlet, the cell's own at other boundaries."""
    kind = face_kind(code, face)
    if kind == OPEN:
        return 0.5 * (own + other)
    return wp.where(kind == OUTLET, 0.0, own)


@wp.func
def potential_step(code: int, face: int, own: float, other: float) -> float:
    """Difference of the potential over one cell size, outward through a face that lets fluid through; else zero."""
    kind = face_kind(code, face)
    if kind == OPEN:
        return other - own
    return wp.where(kind == OUTLET, -2.0 * own, 0.0)


@wp.kernel
def project(
    grid: Grid,
    first_plane: int,
    pressure_factor: float,
    faces: wp.array3d(dtype=int),
    potential: wp.array3d(dtype=float),
    velocity: wp.array3d(dtype=wp.vec3),
    change: wp.array3d(dtype=wp.vec3),
    pressure: wp.array3d(dtype=float),
    flux_x: wp.array3d(dtype=float),
    flux_y: wp.array3d(dtype=float),
    flux_z: wp.array3d(dtype=float),
):
    """velocity += change - grad(potential), fluxes likewise, pressure += pressure_factor * potential.

    potential [m^2/s], pressure_factor [1/s].
    """
    i, j, k = wp.tid()
    i += first_plane
    code = faces[i, j, k]
    if is_solid(code):
        return
    n = grid.cells
    inv = grid.inverse
    q = potential[i, j, k]
    q0 = potential[previous_cell(i, n[0], grid.wraps[0]), j, k]
    q1 = potential[next_cell(i, n[0], grid.wraps[0]), j, k]
    gx = inv[0] * (potential_at_face(code, 1, q, q1) - potential_at_face(code, 0, q, q0))
    flux_x[i + 1, j, k] = flux_x[i + 1, j, k] - inv[0] * potential_step(code, 1, q, q1)
    if i == 0:
        flux_x[i, j, k] = flux_x[i, j, k] + inv[0] * potential_step(code, 0, q, q0)
    q0 = potential[i, previous_cell(j, n[1], grid.wraps[1]), k]
    q1 = potential[i, next_cell(j, n[1], grid.wraps[1]), k]
    gy = inv[1] * (potential_at_face(code, 3, q, q1) - potential_at_face(code, 2, q, q0))
    flux_y[i, j + 1, k] = flux_y[i, j + 1, k] - inv[1] * potential_step(code, 3, q, q1)
    if j == 0:
        flux_y[i, j, k] = flux_y[i, j, k] + inv[1] * potential_step(code, 2, q, q0)
    gz = float(0.0)
    if n[2] > 1:
        q0 = potential[i, j, previous_cell(k, n[2], grid.wraps[2])]
        q1 = potential[i, j, next_cell(k, n[2], grid.wraps[2])]
        gz = inv[2] * (potential_at_face(code, 5, q, q1) - potential_at_face(code, 4, q, q0))
        flux_z[i, j, k + 1] = flux_z[i, j, k + 1] - inv[2] * potential_step(code, 5, q, q1)
        if k == 0:
            flux_z[i, j, k] = flux_z[i, j, k] + inv[2] * potential_step(code, 4, q, q0)
    velocity[i, j, k] = velocity[i, j, k] + change[i, j, k] - wp.vec3(gx, gy, gz)
    pressure[i, j, k] = pressure[i, j, k] + pressure_factor * q
