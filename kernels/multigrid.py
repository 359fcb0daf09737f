"""Geometric multigrid for the Poisson equation of the projection, with obstacles as closed face fractions.

Every level has cells of a uniform grid and an equation sum_f w_f (x_f - x) - w_out x = b a cell, w_f = open fraction of the
face over the cell size squared [1/m^2]; the stencil holds the six w_f, 1 / (sum + w_out) and (sum + w_out).
"""

import warp as wp

from warp_immersed.kernels.grid import Grid, Stencil, next_cell, previous_cell, red_black_cell

wp.set_module_options({"enable_backward": False})


@wp.func
def neighbour_sum(grid: Grid, p: Stencil, x: wp.array3d(dtype=float), i: int, j: int, k: int) -> float:
    """sum_f w_f x_f."""
    n = grid.cells
    total = (
        p[0] * x[previous_cell(i, n[0], grid.wraps[0]), j, k]
        + p[1] * x[next_cell(i, n[0], grid.wraps[0]), j, k]
        + p[2] * x[i, previous_cell(j, n[1], grid.wraps[1]), k]
        + p[3] * x[i, next_cell(j, n[1], grid.wraps[1]), k]
    )
    if n[2] > 1:
        total += p[4] * x[i, j, previous_cell(k, n[2], grid.wraps[2])]
        total += p[5] * x[i, j, next_cell(k, n[2], grid.wraps[2])]
    return total


@wp.kernel
def start_smoothing(
    first_plane: int, stencil: wp.array3d(dtype=Stencil), b: wp.array3d(dtype=float), x_out: wp.array3d(dtype=float)
):
    """One Jacobi step from zero. (The black half is overwritten by the sweep that follows.)"""
    i, j, k = wp.tid()
    i += first_plane
    x_out[i, j, k] = -b[i, j, k] * stencil[i, j, k][6]


@wp.kernel
def smooth(
    grid: Grid,
    first_plane: int,
    color: int,
    stencil: wp.array3d(dtype=Stencil),
    b: wp.array3d(dtype=float),
    x: wp.array3d(dtype=float),
):
    """One half of a red-black Gauss-Seidel sweep, in place; solid cells keep zero."""
    a, c, d = wp.tid()
    cell = red_black_cell(first_plane, a, c, d, color, grid.cells)
    i = cell[0]
    j = cell[1]
    k = cell[2]
    if j >= grid.cells[1] or k >= grid.cells[2]:
        return
    p = stencil[i, j, k]
    x[i, j, k] = (neighbour_sum(grid, p, x, i, j, k) - b[i, j, k]) * p[6]


@wp.kernel
def restrict_residual(
    grid: Grid,
    first_plane: int,
    factor: wp.vec3i,
    stencil: wp.array3d(dtype=Stencil),
    b: wp.array3d(dtype=float),
    x: wp.array3d(dtype=float),
    coarse_out: wp.array3d(dtype=float),
):
    """Mean residual of the fine cells in each coarse cell; grid is the fine one, factor the fine cells a coarse cell and axis."""
    a, c, d = wp.tid()
    a += first_plane
    total = float(0.0)
    for i in range(a * factor[0], wp.min((a + 1) * factor[0], grid.cells[0])):
        for j in range(c * factor[1], wp.min((c + 1) * factor[1], grid.cells[1])):
            for k in range(d * factor[2], wp.min((d + 1) * factor[2], grid.cells[2])):
                p = stencil[i, j, k]
                if p[6] > 0.0:
                    total += b[i, j, k] - neighbour_sum(grid, p, x, i, j, k) + p[7] * x[i, j, k]
    coarse_out[a, c, d] = total / float(factor[0] * factor[1] * factor[2])


@wp.func
def second_parent(i: int, parent: int, factor: int, n: int, wraps: int) -> int:
    """The coarse cell next nearest to fine cell i along an axis; the parent itself where there is none."""
    if factor == 1:
        return parent
    if (i & 1) == 1:
        return next_cell(parent, n, wraps)
    return previous_cell(parent, n, wraps)


@wp.kernel
def prolong(
    grid: Grid,
    first_plane: int,
    factor: wp.vec3i,
    stencil: wp.array3d(dtype=Stencil),
    coarse_stencil: wp.array3d(dtype=Stencil),
    coarse: wp.array3d(dtype=float),
    x: wp.array3d(dtype=float),
):
    """x += coarse, trilinear (3/4 and 1/4 an axis) over the coarse cells that hold fluid; grid is the coarse one."""
    i, j, k = wp.tid()
    i += first_plane
    if stencil[i, j, k][6] == 0.0:
        return
    a = i / factor[0]
    c = j / factor[1]
    d = k / factor[2]
    a2 = second_parent(i, a, factor[0], grid.cells[0], grid.wraps[0])
    c2 = second_parent(j, c, factor[1], grid.cells[1], grid.wraps[1])
    d2 = second_parent(k, d, factor[2], grid.cells[2], grid.wraps[2])
    total = float(0.0)
    weight = float(0.0)
    for s in range(8):
        if d2 == d and s > 3:
            break
        o = wp.where((s & 1) == 1, a2, a)
        q = wp.where((s & 2) == 2, c2, c)
        r = wp.where(s > 3, d2, d)
        if coarse_stencil[o, q, r][6] > 0.0:
            v = wp.where((s & 1) == 1, 0.25, 0.75) * wp.where((s & 2) == 2, 0.25, 0.75) * wp.where(s > 3, 0.25, 0.75)
            total += v * coarse[o, q, r]
            weight += v
    if weight > 0.0:
        x[i, j, k] = x[i, j, k] + total / weight
