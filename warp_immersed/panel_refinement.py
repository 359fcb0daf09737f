"""Added mass of a body to a wanted accuracy: which meshes to solve on, what their results say together, how sure that is."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.mass_properties import closed_integrals
from warp_immersed.mesh_checks import clean_surface
from warp_immersed.panel_mesh import Surface, coarse_mesh, folded_faces_of, graded_mesh, surface_from
from warp_immersed.panel_solver import SurfaceTensor, UnresolvedError, positive_symmetric, surface_tensor
from warp_immersed.remesh import PatchMesh, face_normals

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[str, float], None]
Solve = Callable[[Array, Indices], SurfaceTensor]

FACE_LIMIT = 6000  # of one mesh: 3 GB would be 20,000, a minute of one core 10,000
EXTRAPOLATION = 0.35  # what Richardson's extrapolation leaves of the change it makes, at worst (measured 0.05 to 0.31)
DIRECT = (300, 5200)  # closed meshes with so many good faces are solved as they are
SHAPE_LOSS = 4.0  # error of rotations over that of second moments: they go with differences of these
DECIMATED = 2500.0  # faces of a solid with too many
SHAPELY = 0.01  # twice the area of a good face over the square of its longest side, at least
EXTRAPOLATED = "panels, two graded meshes extrapolated"
# Error over unresolved energy: of smooth solids (measured 1/100 to 1/20,000) and of sharp ones (1/26 to 1/86).
KINKS = (1.0 / 200.0, 1.0 / 25.0)
HALVES = (1, 2, 3, 4, 6, 8)  # parts of a coarse edge, on the coarser of two meshes
LOST = 0.2  # of the tolerance: area that a coarse mesh may lose
MINOR = 0.02  # modes with less than this of the largest added mass count as if they had so much


@dataclass(frozen=True)
class MeshTensor:
    """Added mass (6, 6) for a fluid of 1 kg/m^3 about the origin, its estimated relative error, faces solved on in all."""

    matrix: Array
    error_estimate: float
    faces: int
    method: str


def relative_difference(one: Array, other: Array, size: float) -> float:
    """Largest |one - other|_ij / sqrt(K_ii K_jj) of two tensors; size [m] makes rotations comparable with translations."""
    units = np.array([1.0, 1.0, 1.0, size, size, size])
    diagonal = np.diag(one) / units**2
    scale = units * np.sqrt(np.maximum(diagonal, MINOR * diagonal.max()))
    return float((np.abs(one - other) / np.outer(scale, scale)).max())


def mesh_tensor(
    vertices: Array,
    faces: Indices,
    closed: bool,
    volume: float | None = None,
    tolerance: float = 0.01,
    face_budget: int | None = None,
    as_given: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
    name: str = "mesh",
) -> MeshTensor:
    """Added mass of a triangle mesh about the origin of its coordinates.

    vertices: (V, 3) [m]; faces: (F, 3). closed: a solid; otherwise sheets. volume: the true one [m^3], if the mesh only
    approximates it. tolerance: relative error wanted. face_budget: faces to spend in all, instead of a tolerance.
    as_given: solve on the given triangles, whatever their quality. Raises InputError for a mesh that cannot be used.
    """
    vertices, faces = clean_surface(vertices, faces, closed, name)
    center = vertices.mean(axis=0)
    size = float(np.abs(vertices - center).max())
    scaled = (vertices - center) / size
    true_volume = 1.0
    if closed:
        true_volume = enclosed_volume(scaled, faces) if volume is None else volume / size**3

    def solve(vertices: Array, faces: Indices) -> SurfaceTensor:
        if closed:
            vertices = vertices * (true_volume / enclosed_volume(vertices, faces)) ** (1.0 / 3.0)
        return surface_tensor(vertices + center / size, faces, closed, device, threads=threads, progress=progress)

    if as_given:
        result = direct_tensor(surface_from(scaled, faces, closed), solve)
    elif closed:
        result = solid_tensor(surface_from(scaled, faces, True), solve, tolerance, face_budget)
    else:
        result = remeshed_tensor(surface_from(scaled, faces, False), solve, tolerance, face_budget)
    dimensions = size ** np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    return MeshTensor(result.matrix * np.outer(dimensions, dimensions), result.error_estimate, result.faces, result.method)


def enclosed_volume(vertices: Array, faces: Indices) -> float:
    """Volume inside outward faces."""
    corners = vertices[faces]
    return float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


def total_area(vertices: Array, faces: Indices) -> float:
    """Area of a surface."""
    corners = vertices[faces]
    return float(np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0)


def measures(vertices: Array, faces: Indices, closed: bool) -> Array:
    """What a good mesh has in common with its original: the area; of solids the volume and the second moments too."""
    area = total_area(vertices, faces)
    if not closed:
        return np.array([area])
    integrals = closed_integrals(vertices[faces])
    return np.array([area, integrals.volume, *np.diag(integrals.second_moment)])


def extrapolated(fine: Array, coarse: Array) -> tuple[Array, float]:
    """Richardson's extrapolation of two tensors on meshes of edge lengths h and 2 h, errors going with h^2.

    Returns it and its estimated relative error.
    """
    matrix = fine + (fine - coarse) / 3.0
    return matrix, EXTRAPOLATION * relative_difference(matrix, fine, 1.0)


def remeshed_tensor(surface: Surface, solve: Solve, tolerance: float, budget: int | None) -> MeshTensor:
    """Make a coarse mesh and cut it more and more finely until two such meshes extrapolate to the tolerance."""
    coarse = fitting_mesh(surface, tolerance, budget)
    given = measures(surface.mesh.vertices, surface.mesh.faces, surface.closed)
    count = len(coarse.faces)
    if budget is not None:
        halves = [max(h for h in HALVES if h == 1 or 5 * h * h * count <= 1.3 * budget)]
    else:
        halves = [h for h in HALVES if h > 1 and 4 * h * h * count <= FACE_LIMIT] or [1]
    best, failure, spent = None, UnresolvedError(""), 0
    for half in halves:
        meshes = [graded_mesh(surface, coarse, parts) for parts in (half, 2 * half)]
        try:
            coarser, finer = (solve(*mesh) for mesh in meshes)
        except UnresolvedError as problem:
            failure = problem
            continue
        matrix, error = extrapolated(finer.matrix, coarser.matrix)
        lost = max(float(np.abs(measures(*mesh, surface.closed) / given - 1.0).max()) for mesh in meshes[1:])
        spent += sum(len(mesh[1]) for mesh in meshes)
        best = MeshTensor(positive_symmetric(matrix)[0], error + lost + finer.correction, spent, EXTRAPOLATED)
        if best.error_estimate <= tolerance:
            break
    if best is None:
        raise InputError(f"mesh: {failure}; it is too thin or too jagged to be solved, must have rounder faces") from failure
    return best


def fitting_mesh(surface: Surface, tolerance: float, budget: int | None) -> PatchMesh:
    """A coarse mesh that follows the surface: its area (solids: volume and second moments too) is nearly the true one."""
    given = measures(surface.mesh.vertices, surface.mesh.faces, surface.closed)
    sheet_limit, solid_limit = (24.0, 60.0) if budget is None else (max(8.0, budget / 45.0), max(24.0, budget / 45.0))
    limit = solid_limit if surface.closed else sheet_limit
    best, least = None, np.inf
    for _ in range(6 if budget is None else 1):
        coarse = coarse_mesh(surface, limit, even=not surface.singular.any())
        if best is not None and len(coarse.faces) > FACE_LIMIT // 8:
            break
        cuts = [graded_mesh(surface, coarse, parts) for parts in (4, 8)]
        lost = max(float(np.abs(measures(*cut, surface.closed) / given - 1.0).max()) for cut in cuts)
        lost += len(folded_faces_of(surface, coarse)) / len(coarse.faces)
        if best is None or lost < least:
            best, least = coarse, lost
        if least < LOST * tolerance:
            break
        limit *= 2.0
    assert best is not None  # one round at least
    return best


def solid_tensor(surface: Surface, solve: Solve, tolerance: float, budget: int | None) -> MeshTensor:
    """Solids: on the given mesh if it is good and good enough, else on one made for the purpose."""
    mesh = surface.mesh
    direct = DIRECT[0] <= len(mesh.faces) <= DIRECT[1] and well_shaped(mesh)
    ways = [lambda: direct_tensor(surface, solve)] if direct and budget is None else []
    ways.append(lambda: remeshed_tensor(surface, solve, tolerance, budget))
    if len(mesh.faces) > DIRECT[1] and budget is None:
        ways.append(lambda: decimated_tensor(surface, solve))
    best, failure = None, InputError("")
    for way in ways:
        try:
            result = way()
        except (InputError, UnresolvedError) as problem:
            failure = InputError(str(problem))
            continue
        if best is None or result.error_estimate < best.error_estimate:
            best = result
        if best.error_estimate <= tolerance:
            break
    if best is None:
        raise failure
    return best


def well_shaped(mesh: PatchMesh) -> bool:
    """Whether no face is a needle."""
    corners = mesh.vertices[mesh.faces]
    sides = ((corners - corners[:, [1, 2, 0]]) ** 2).sum(axis=2).max(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return bool((np.linalg.norm(normals, axis=1) > SHAPELY * sides).all())


def decimated_tensor(surface: Surface, solve: Solve) -> MeshTensor:
    """The tensor of a solid on a mesh of fewer, even faces, scaled to the true volume by `solve`."""
    fewer = coarse_mesh(surface, DECIMATED, even=True)
    mesh = surface_from(fewer.vertices, fewer.faces, True)
    true = measures(surface.mesh.vertices, surface.mesh.faces, True)
    found = measures(fewer.vertices, fewer.faces, True)
    scale = (true[1] / found[1]) ** (1.0 / 3.0)
    lost = float(np.abs(found * scale ** np.array([2.0, 3.0, 5.0, 5.0, 5.0]) / true - 1.0).max())
    result = direct_tensor(mesh, solve)
    return MeshTensor(result.matrix, result.error_estimate + SHAPE_LOSS * lost, result.faces, "panels on a mesh of fewer faces")


def direct_tensor(surface: Surface, solve: Solve) -> MeshTensor:
    """The tensor on the given mesh, and its error from what the mesh does not resolve; for sheets from their rims."""
    vertices, faces = surface.mesh.vertices, surface.mesh.faces
    result = solve(vertices, faces)
    if surface.closed:
        diagonal = np.diag(result.matrix)
        share = KINKS[1 if surface.singular.any() else 0] * result.unresolved
        error = float((share / np.maximum(diagonal, MINOR * diagonal.max())).max())
    else:
        error = rim_error(surface)
    return MeshTensor(result.matrix, error + result.correction, len(faces), "panels on the given mesh")


def rim_error(surface: Surface) -> float:
    """Relative error of a sheet on a given mesh: the depth of the faces along its rims over the mean half width of the sheet.


    On a uniform disk of radius a and edges h that is twice h / a; measured errors are 0.6 h / a (m) and 1.1 h / a (J).
    """
    mesh = surface.mesh
    halves = np.argwhere(surface.singular[surface.edges.of_face])
    a, b = (mesh.vertices[mesh.faces[halves[:, 0], (halves[:, 1] + k) % 3]] for k in (0, 1))
    lengths = np.linalg.norm(b - a, axis=1)
    areas = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1) / 2.0
    depth = (2.0 * areas[halves[:, 0]]).sum() / lengths.sum()
    return float(depth * lengths.sum() / areas.sum())
