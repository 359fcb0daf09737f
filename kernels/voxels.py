"""Which cells of a grid lie inside a closed triangle mesh."""

import warp as wp

from warp_immersed.kernels.grid import Grid

wp.set_module_options({"enable_backward": False})


@wp.kernel
def mark_inside(mesh: wp.uint64, grid: Grid, reach: float, inside_out: wp.array3d(dtype=wp.int32)):
    """Set inside_out to 1 where the cell centre is inside the mesh (its generalized winding number is above 1/2)."""
    i, j, k = wp.tid()
    h = grid.spacing
    center = grid.lower + wp.vec3((float(i) + 0.5) * h[0], (float(j) + 0.5) * h[1], (float(k) + 0.5) * h[2])
    query = wp.mesh_query_point_sign_winding_number(mesh, center, reach)
    if query.result and query.sign < 0.0:
        inside_out[i, j, k] = 1
