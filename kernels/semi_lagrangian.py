"""Convection along the paths of fluid parcels, for flows that change in time.

Values are fetched where the parcel that arrives at a cell centre was one step before: with cubic interpolation away from
walls (tensor product of third-order Lagrange polynomials), trilinear over fluid cells next to them.
"""

import warp as wp

from warp_immersed.kernels.grid import Grid, Side, boundary_turbulence, boundary_velocity, is_solid
from warp_immersed.kernels.k_epsilon import FLOOR, advance_sources

wp.set_module_options({"enable_backward": False})


@wp.func
def wrap(i: int, n: int, wraps: int) -> int:
    """Index brought into 0..n-1: around a periodic axis, else to the nearest end."""
    if wraps == 1:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def inside_axis(i: int, n: int, wraps: int) -> bool:
    """Whether an index lies within an axis of n cells, or the axis wraps around."""
    return wraps == 1 or (i >= 0 and i < n)


@wp.func
def trilinear_velocity(
    grid: Grid, faces: wp.array3d(dtype=int), field: wp.array3d(dtype=wp.vec3), x: wp.vec3, own: wp.vec3
) -> wp.vec3:
    """Trilinear over fluid cells at x (in cells from the first centre); `own` where all eight are solid."""
    n = grid.cells
    i = int(wp.floor(x[0]))
    j = int(wp.floor(x[1]))
    k = int(wp.floor(x[2]))
    f = wp.vec3(x[0] - float(i), x[1] - float(j), x[2] - float(k))
    total = wp.vec3(0.0, 0.0, 0.0)
    weight = float(0.0)
    for corner in range(8):
        a = wrap(i + (corner & 1), n[0], grid.wraps[0])
        b = wrap(j + ((corner >> 1) & 1), n[1], grid.wraps[1])
        c = wrap(k + (corner >> 2), n[2], grid.wraps[2])
        w = (
            wp.where((corner & 1) == 1, f[0], 1.0 - f[0])
            * wp.where((corner & 2) == 2, f[1], 1.0 - f[1])
            * wp.where(corner > 3, f[2], 1.0 - f[2])
        )
        if not is_solid(faces[a, b, c]):
            total += w * field[a, b, c]
            weight += w
    if weight > 1.0e-6:
        return total / weight
    return own


@wp.func
def cubic_weight(f: float, m: int) -> float:
    """Weight of point m = 0..3 at -1, 0, 1, 2 for a point f in 0..1 (Lagrange)."""
    if m == 0:
        return -f * (f - 1.0) * (f - 2.0) / 6.0
    if m == 1:
        return 0.5 * (f + 1.0) * (f - 1.0) * (f - 2.0)
    if m == 2:
        return -0.5 * (f + 1.0) * f * (f - 2.0)
    return (f + 1.0) * f * (f - 1.0) / 6.0


@wp.func
def surrounded(grid: Grid, faces: wp.array3d(dtype=int), i: int, j: int, k: int) -> bool:
    """Whether all cells that cubic interpolation from cell (i, j, k) reads exist and hold fluid."""
    n = grid.cells
    flat = n[2] == 1
    if not (inside_axis(i - 1, n[0], grid.wraps[0]) and inside_axis(i + 2, n[0], grid.wraps[0])):
        return False
    if not (inside_axis(j - 1, n[1], grid.wraps[1]) and inside_axis(j + 2, n[1], grid.wraps[1])):
        return False
    if not flat and not (inside_axis(k - 1, n[2], grid.wraps[2]) and inside_axis(k + 2, n[2], grid.wraps[2])):
        return False
    for a in range(i - 1, i + 3):
        for b in range(j - 1, j + 3):
            x = wrap(a, n[0], grid.wraps[0])
            y = wrap(b, n[1], grid.wraps[1])
            if flat:
                if is_solid(faces[x, y, 0]):
                    return False
            else:
                for c in range(k - 1, k + 3):
                    if is_solid(faces[x, y, wrap(c, n[2], grid.wraps[2])]):
                        return False
    return True


@wp.func
def cubic_velocity(
    grid: Grid, faces: wp.array3d(dtype=int), field: wp.array3d(dtype=wp.vec3), x: wp.vec3, own: wp.vec3
) -> wp.vec3:
    """Cubic interpolation at x (in cells from the first centre); trilinear next to walls."""
    n = grid.cells
    a = int(wp.floor(x[0]))
    b = int(wp.floor(x[1]))
    c = int(wp.floor(x[2]))
    if not surrounded(grid, faces, a, b, c):
        return trilinear_velocity(grid, faces, field, x, own)
    total = wp.vec3(0.0, 0.0, 0.0)
    first = wp.where(n[2] == 1, 0, c - 1)
    last = wp.where(n[2] == 1, 1, c + 3)
    for p in range(a - 1, a + 3):
        for q in range(b - 1, b + 3):
            w = cubic_weight(x[0] - float(a), p - a + 1) * cubic_weight(x[1] - float(b), q - b + 1)
            for r in range(first, last):
                v = w
                if n[2] > 1:
                    v = w * cubic_weight(x[2] - float(c), r - c + 1)
                total += v * field[wrap(p, n[0], grid.wraps[0]), wrap(q, n[1], grid.wraps[1]), wrap(r, n[2], grid.wraps[2])]
    return total


@wp.func
def inlet_passed(grid: Grid, inlets: int, x: wp.vec3) -> int:
    """The inlet side (0..5) that a departure point lies behind, or -1; bit s of `inlets` is set where side s is an inlet."""
    for axis in range(3):
        if x[axis] < -0.5 and ((inlets >> (2 * axis)) & 1) == 1:
            return 2 * axis
        if x[axis] > float(grid.cells[axis]) - 0.5 and ((inlets >> (2 * axis + 1)) & 1) == 1:
            return 2 * axis + 1
    return -1


@wp.kernel
def convect(
    grid: Grid,
    first_plane: int,
    dt: float,
    inlets: int,
    faces: wp.array3d(dtype=int),
    sides: wp.array(dtype=Side),
    velocity: wp.array3d(dtype=wp.vec3),
    midway: wp.array3d(dtype=wp.vec3),
    residual: wp.array3d(dtype=wp.vec3),
    turbulence: wp.array3d(dtype=wp.vec2),
    velocity_out: wp.array3d(dtype=wp.vec3),
    turbulence_out: wp.array3d(dtype=wp.vec2),
):
    """velocity + dt/2 residual, and (k, epsilon), at the departure point of every fluid cell.

    midway: velocity extrapolated to the middle of the step; the path follows it by the midpoint rule.
    residual [m/s^2] is viscous stress less grad p: half of it acts where the parcel left, half where it arrives.
    """
    i, j, k = wp.tid()
    i += first_plane
    if is_solid(faces[i, j, k]):
        return
    n = grid.cells
    own = velocity[i, j, k]
    here = wp.vec3(float(i), float(j), float(k))
    u = midway[i, j, k]
    u = cubic_velocity(grid, faces, midway, here - 0.5 * dt * wp.cw_mul(u, grid.inverse), u)
    x = here - dt * wp.cw_mul(u, grid.inverse)
    side = inlet_passed(grid, inlets, x)
    if side >= 0:
        y = grid.lower[1] + (x[1] + 0.5) * grid.spacing[1]
        velocity_out[i, j, k] = boundary_velocity(sides[side], y)
        turbulence_out[i, j, k] = boundary_turbulence(sides[side], y)
        return
    a = int(wp.floor(x[0]))
    b = int(wp.floor(x[1]))
    c = int(wp.floor(x[2]))
    if n[2] == 1:
        c = 0
    f = wp.vec3(x[0] - float(a), x[1] - float(b), x[2] - float(c))
    u = wp.vec3(0.0, 0.0, 0.0)
    t = wp.vec2(0.0, 0.0)
    low = wp.vec2(1.0e30, 1.0e30)
    high = wp.vec2(0.0, 0.0)
    if surrounded(grid, faces, a, b, c):
        for p in range(a - 1, a + 3):
            for q in range(b - 1, b + 3):
                w = cubic_weight(f[0], p - a + 1) * cubic_weight(f[1], q - b + 1)
                xi = wrap(p, n[0], grid.wraps[0])
                yi = wrap(q, n[1], grid.wraps[1])
                first = wp.where(n[2] == 1, 0, c - 1)
                last = wp.where(n[2] == 1, 1, c + 3)
                for r in range(first, last):
                    zi = wrap(r, n[2], grid.wraps[2])
                    v = w
                    if n[2] > 1:
                        v = w * cubic_weight(f[2], r - c + 1)
                    u += v * (velocity[xi, yi, zi] + 0.5 * dt * residual[xi, yi, zi])
                    t += v * turbulence[xi, yi, zi]
                    low = wp.min(low, turbulence[xi, yi, zi])
                    high = wp.max(high, turbulence[xi, yi, zi])
        t = wp.max(wp.min(t, high), low)
    else:
        weight = float(0.0)
        for corner in range(8):
            xi = wrap(a + (corner & 1), n[0], grid.wraps[0])
            yi = wrap(b + ((corner >> 1) & 1), n[1], grid.wraps[1])
            zi = wrap(c + (corner >> 2), n[2], grid.wraps[2])
            w = (
                wp.where((corner & 1) == 1, f[0], 1.0 - f[0])
                * wp.where((corner & 2) == 2, f[1], 1.0 - f[1])
                * wp.where(corner > 3, f[2], 1.0 - f[2])
            )
            if not is_solid(faces[xi, yi, zi]):
                u += w * (velocity[xi, yi, zi] + 0.5 * dt * residual[xi, yi, zi])
                t += w * turbulence[xi, yi, zi]
                weight += w
        if weight > 1.0e-6:
            u = u / weight
            t = t / weight
        else:
            u = own
            t = turbulence[i, j, k]
    velocity_out[i, j, k] = u
    turbulence_out[i, j, k] = t


@wp.kernel
def exchange_turbulence(
    grid: Grid,
    first_plane: int,
    dt: float,
    faces: wp.array3d(dtype=int),
    convected: wp.array3d(dtype=wp.vec2),
    source: wp.array3d(dtype=wp.vec3),
    turbulence_out: wp.array3d(dtype=wp.vec2),
    source_out: wp.array3d(dtype=wp.vec3),
):
    """Sources of k and epsilon over one step, exactly, away from walls; there the transport step keeps them (wall law)."""
    i, j, k = wp.tid()
    i += first_plane
    if is_solid(faces[i, j, k]):
        return
    t = convected[i, j, k]
    s = source[i, j, k]
    if s[2] > 0.0:
        turbulence_out[i, j, k] = t
        source_out[i, j, k] = s
        return
    turbulence_out[i, j, k] = advance_sources(wp.vec2(wp.max(t[0], FLOOR), wp.max(t[1], FLOOR)), s[1], dt)
    source_out[i, j, k] = wp.vec3(0.0, 0.0, -1.0)


@wp.kernel
def clear(first_plane: int, field: wp.array3d(dtype=wp.vec3)):
    """Set a field to zero."""
    i, j, k = wp.tid()
    field[first_plane + i, j, k] = wp.vec3(0.0, 0.0, 0.0)


@wp.kernel
def accept(
    first_plane: int,
    latest: wp.array3d(dtype=wp.vec3),
    velocity: wp.array3d(dtype=wp.vec3),
    midway_out: wp.array3d(dtype=wp.vec3),
):
    """Shift time: the latest becomes velocity; midway is extrapolated to the middle of the coming step."""
    i, j, k = wp.tid()
    i += first_plane
    midway_out[i, j, k] = 1.5 * latest[i, j, k] - 0.5 * velocity[i, j, k]
    velocity[i, j, k] = latest[i, j, k]
