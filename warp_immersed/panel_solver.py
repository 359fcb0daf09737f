"""The added-mass tensor of one given triangle mesh, by linear Galerkin boundary elements.

The flow about a moving surface is that of a layer of doublets of strength mu, the jump of potential across it. With mu linear on
the faces its energy is that of the vortex sheet curl mu, (1 / 4 pi) int int curl mu . curl mu / r (the hypersingular operator in
curl-curl form: Nedelec, Int. J. Eng. Sci. 20, 1982), which needs nothing but integrals of 1/r over pairs of triangles. A sheet's
tensor is a Gram matrix of that energy; a closed body's needs the potential on its outer side.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_matrix

from warp_immersed.fluid_sectors import FluidSectors, fluid_sectors
from warp_immersed.kernels import panels

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[str, float], None]

NEAR = 2.0  # longest edges; nearer pairs are integrated analytically
ROWS_PER_SLICE = 32
GPU_LANES = 128
ASYMMETRY_LIMIT = 0.1  # measured: 0.004 for 80 faces, 1e-4 for 1280


class UnresolvedError(ArithmeticError):
    """A mesh is too coarse or too distorted for its own shape: the flow on it has no positive energy."""


@dataclass(frozen=True)
class SurfaceTensor:
    """Result on one mesh.

    matrix: (6, 6) about the origin for a fluid of 1 kg/m^3, linear then angular, symmetric and positive semidefinite.
    correction: the relative change that made it so. jumps: (F, 3, 6) of the potential at the corners of the faces (solids only).
    """

    matrix: Array
    correction: float
    jumps: Array | None


def surface_tensor(
    vertices: Array,
    faces: Indices,
    closed: bool,
    device: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceTensor:
    """Added mass of a surface in a fluid of density 1 kg/m^3, about the origin, linear then angular.

    vertices: (V, 3) [m]; faces: (F, 3), outward if closed. closed: the flow outside counts; otherwise that on both sides does.
    threads: for the CPU, all cores if None; the result is the same for any number. progress: called with a label and a fraction.
    """
    size = float(np.abs(vertices).max())
    scaled = vertices / size
    sectors = fluid_sectors(scaled, faces)
    corners = scaled[faces]
    edges = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # opposite to each corner
    normals = np.cross(edges[:, 0], edges[:, 1])
    doubled = np.linalg.norm(normals, axis=1)
    normals /= doubled[:, None]
    areas = doubled / 2.0
    geometry = device_faces(corners, edges, normals, areas, device)
    report = progress or silent
    report("integrals", 0.0)
    potentials = pair_potentials(geometry, device, threads)
    report("solution", 0.6)
    energy = energy_matrix(sectors, edges / doubled[:, None, None], potentials)
    loads = corner_loads(corners, normals, areas)
    right = add_corners(sectors, loads)
    chambers = sectors.chambers
    energy += np.trace(energy) / max(sectors.count, 1) * chambers @ chambers.T
    try:
        jumps = cho_solve(cho_factor(energy, overwrite_a=True, check_finite=False), right, check_finite=False)
    except LinAlgError as error:
        raise UnresolvedError(f"the energy of the flow is not positive on {len(faces)} faces") from error
    if closed:
        report("trace", 0.8)
        at_corners = corner_jumps(sectors, jumps)
        outside = exterior_potentials(geometry, at_corners, device, threads)
        points = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6.0
        flux = normal_velocities(np.einsum("pk,fki->fpi", points, corners), normals) * (areas / 3.0)[:, None, None]
        tensor = np.tensordot(outside, flux, axes=((0, 1), (0, 1)))
    else:
        tensor = right.T @ jumps
        at_corners = None
    tensor, correction = positive_symmetric(tensor)
    if not correction < ASYMMETRY_LIMIT:
        raise UnresolvedError(f"the tensor came out {100.0 * correction:.3g} % unsymmetric or negative on {len(faces)} faces")
    dimensions = size ** np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    return SurfaceTensor(tensor * np.outer(dimensions, dimensions), correction, at_corners)


def silent(label: str, fraction: float) -> None:
    """No progress wanted."""


def device_faces(corners: Array, edges: Array, normals: Array, areas: Array, device: str) -> list[wp.array]:
    """The arrays of faces that the kernels take: corners, centroid, normal, area, longest edge, second moment over area."""
    centroids = corners.mean(axis=1)
    arms = corners - centroids[:, None]
    moments = np.einsum("fki,fkj->fij", arms, arms) / 12.0
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    columns: list[tuple[Array, object]] = [(corners[:, k], wp.vec3d) for k in range(3)]
    columns += [(centroids, wp.vec3d), (normals, wp.vec3d)]
    columns += [(areas, wp.float64), (longest, wp.float64), (moments, wp.mat33d)]
    return [wp.array(np.ascontiguousarray(values), dtype=dtype, device=device) for values, dtype in columns]


def launch_rows(
    kernel: wp.Kernel, rows: int, columns: int, inputs: list[object], output: wp.array, device: str, threads: int | None
) -> None:
    """Launch a kernel over (rows, columns): at once on a GPU, in slices of rows on threads on the CPU.

    The kernel's first argument is the first row of the slice. Warp runs a CPU launch on one thread but without the
    interpreter lock, and every row has its own place in the output, so the threads do not change the result.
    """
    wp.load_module(panels, device=device)  # before the threads: first loads must not run side by side

    def launch(first: int, count: int) -> None:
        wp.launch(kernel, dim=(count, columns), inputs=[first, *inputs], outputs=[output], device=device)

    threads = threads or available_cores()
    if not wp.get_device(device).is_cpu or threads == 1 or rows <= ROWS_PER_SLICE:
        launch(0, rows)
        return
    with ThreadPoolExecutor(threads) as pool:
        slices = [pool.submit(launch, first, min(ROWS_PER_SLICE, rows - first)) for first in range(0, rows, ROWS_PER_SLICE)]
        for done in slices:
            done.result()


def available_cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def pair_potentials(geometry: list[wp.array], device: str, threads: int | None) -> Array:
    """int_f int_g 1/r for all pairs of faces, (F, F)."""
    rows = len(geometry[5])
    result = wp.empty((rows, rows), dtype=wp.float64, device=device)
    lanes = 1 if wp.get_device(device).is_cpu else GPU_LANES
    launch_rows(panels.pair_potentials, rows, lanes, [lanes, wp.float64(NEAR), *geometry], result, device, threads)
    return result.numpy()


def exterior_potentials(geometry: list[wp.array], jumps: Array, device: str, threads: int | None) -> Array:
    """Potentials (F, 3, 6) outside a closed surface at three points of each face; jumps: (F, 3, 6) at the corners."""
    rows = len(geometry[5])
    corners = [wp.array(np.ascontiguousarray(jumps[:, k]), dtype=panels.vec6d, device=device) for k in range(3)]
    result = wp.empty((rows, 3), dtype=panels.vec6d, device=device)
    launch_rows(panels.exterior_trace, rows, 3, [wp.float64(NEAR), *geometry, *corners], result, device, threads)
    return result.numpy()


def energy_matrix(sectors: FluidSectors, curls: Array, potentials: Array) -> Array:
    """Energy (count, count) of the unknowns: sum over faces f, g of curl_f . curl_g V_fg / 4 pi; curls: (F, 3 corners, 3)."""
    faces = len(curls)
    rows = np.concatenate([sectors.front.ravel(), sectors.back.ravel()])
    columns = np.tile(np.repeat(np.arange(faces), 3), 2)
    used = rows >= 0
    energy = np.zeros((sectors.count, sectors.count))
    for axis in range(3):
        values = np.concatenate([curls[:, :, axis].ravel(), -curls[:, :, axis].ravel()])
        curl = csr_matrix((values[used], (rows[used], columns[used])), (sectors.count, faces))
        if curl.data.any():
            energy += curl @ (curl @ potentials).T
    return energy / (4.0 * np.pi)


def normal_velocities(points: Array, normals: Array) -> Array:
    """Normal velocities (F, P, 6) of points (F, P, 3) of faces with normals (F, 3) in the six rigid motions about the origin."""
    along = np.broadcast_to(normals[:, None], points.shape)
    return np.concatenate([along, np.cross(points, along)], axis=2)


def corner_loads(corners: Array, normals: Array, areas: Array) -> Array:
    """int hat q dA (F, 3, 6) for the normal velocities q of the six rigid motions, exactly (q is linear on each face)."""
    velocities = normal_velocities(corners, normals)
    return (areas / 12.0)[:, None, None] * (velocities + velocities.sum(axis=1, keepdims=True))


def add_corners(sectors: FluidSectors, values: Array) -> Array:
    """Sum corner values (F, 3, C) into the unknowns, (count, C): plus in front, minus at the back."""
    total = np.zeros((sectors.count + 1, values.shape[2]))
    np.add.at(total, sectors.front, values)
    np.subtract.at(total, sectors.back, values)
    return total[: sectors.count]


def corner_jumps(sectors: FluidSectors, unknowns: Array) -> Array:
    """Jumps (F, 3, C) at the corners from the unknowns (count, C)."""
    padded = np.vstack([unknowns, np.zeros((1, unknowns.shape[1]))])
    return padded[sectors.front] - padded[sectors.back]


def positive_symmetric(tensor: Array) -> tuple[Array, float]:
    """The nearest symmetric positive semidefinite tensor to one in units of the body's size, and the relative change.

    A sheet's tensor needs rounding errors only; a closed body's trace step leaves an asymmetry that shrinks with the mesh.
    """
    if not np.isfinite(tensor).all():
        return tensor, float("inf")
    scale = np.abs(tensor).max()
    values, vectors = np.linalg.eigh((tensor + tensor.T) / 2.0)
    nearest = (vectors * np.maximum(values, 0.0)) @ vectors.T
    nearest = (nearest + nearest.T) / 2.0
    return nearest, float(np.abs(nearest - tensor).max() / scale) if scale > 0.0 else 0.0
