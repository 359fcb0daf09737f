"""Obstacles as solid cells: boxes, and any watertight mesh."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

from warp_immersed.boundaries import Vector
from warp_immersed.errors import InputError
from warp_immersed.kernels import grid as device_grid
from warp_immersed.kernels import voxels
from warp_immersed.shape import load_mesh

Mask = NDArray[np.bool_]


def cell_centers(lower: Vector, upper: Vector, cells: tuple[int, int, int]) -> list[NDArray[np.float64]]:
    """Coordinates of the cell centres along x, y and z [m]."""
    return [low + (np.arange(n) + 0.5) * (high - low) / n for low, high, n in zip(lower, upper, cells, strict=True)]


def box_mask(lower: Vector, upper: Vector, cells: tuple[int, int, int], box: Sequence[Sequence[float]]) -> Mask:
    """(nx, ny, nz) bool: cells whose centre is in the box of two corners (2, 3) [m]; along an axis of one cell, all."""
    parts = []
    for x, n, a, b in zip(cell_centers(lower, upper, cells), cells, *box, strict=True):
        parts.append(np.ones(1, dtype=bool) if n == 1 else (x >= min(a, b)) & (x < max(a, b)))
    return parts[0][:, None, None] & parts[1][None, :, None] & parts[2][None, None, :]


def mesh_mask(
    lower: Vector, upper: Vector, cells: tuple[int, int, int], mesh: str | Path | trimesh.Trimesh, device: str = "cpu"
) -> Mask:
    """(nx, ny, nz) bool: cells whose centre is inside a watertight mesh in metres, in the coordinates of the domain.

    Raises:
        InputError: the mesh cannot be read or is not watertight.
    """
    name = "mesh" if isinstance(mesh, trimesh.Trimesh) else f"mesh {str(mesh)!r}"
    surface = load_mesh(mesh)
    surface.merge_vertices()
    if not surface.is_watertight:
        raise InputError(f"{name}: is not watertight, so it has no inside; close its holes")
    if surface.volume < 0.0:
        surface.invert()
    grid = device_grid.Grid()
    grid.cells = wp.vec3i(*cells)
    grid.lower = wp.vec3(*lower)
    grid.spacing = wp.vec3(*((b - a) / n for a, b, n in zip(lower, upper, cells, strict=True)))
    points = wp.array(surface.vertices.astype(np.float32), dtype=wp.vec3, device=device)
    indices = wp.array(surface.faces.astype(np.int32).ravel(), dtype=int, device=device)
    body = wp.Mesh(points, indices, support_winding_number=True)
    inside = wp.zeros(cells, dtype=wp.int32, device=device)
    corners = np.vstack([surface.vertices, lower, upper])
    reach = 2.0 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    wp.launch(voxels.mark_inside, cells, [body.id, grid, reach], [inside], device=device)
    return inside.numpy().astype(bool)
