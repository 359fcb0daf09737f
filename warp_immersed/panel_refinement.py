"""Added mass of a body to a wanted accuracy: which meshes to solve on, what their results say together, how sure that is."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed.decimation import thinned
from warp_immersed.errors import InputError
from warp_immersed.fan_mesh import fan_mesh
from warp_immersed.feature_curves import SMOOTH
from warp_immersed.globe_mesh import globe_mesh
from warp_immersed.mass_properties import closed_integrals
from warp_immersed.mesh_checks import clean_surface
from warp_immersed.mesh_errors import kink_error, rim_error
from warp_immersed.panel_mesh import (
    Surface,
    coarse_mesh,
    folded_faces_of,
    graded_mesh,
    marked_mesh,
    patched_mesh,
    surface_from,
    surface_of,
)
from warp_immersed.panel_solver import SurfaceTensor, UnresolvedError, positive_symmetric, silent, surface_tensor
from warp_immersed.remesh import PatchMesh, face_normals, longest_squared, mesh_edges
from warp_immersed.slab import Slab, middle_sheet
from warp_immersed.smooth_surface import swollen
from warp_immersed.stretching import equalizing_stretch

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Progress = Callable[[str, float], None]
Solve = Callable[[Array, Indices], SurfaceTensor]

FACE_LIMIT = 6000  # of one mesh: 3 GB would be 20,000, a minute of one core 10,000
NEXT_POWER = 1.2  # coefficient of the error's next power of 1/n over that of the square, at worst
START = 52  # faces for each coarse one to begin with
DIRECT = (300, 5200)  # closed meshes with so many good faces are solved as they are
MANY, THINNED = 20_000, 5000  # faces of meshes that are thinned first, and to how many
SLAB_ERROR = 0.03  # estimated error of a slab's sheet that is not worth more work
SLAB_EXCESS = 4.0  # what a slab's thickness adds over that of its middle sheet, times thickness over width (measured 2 to 4)
ROUGH = 0.1  # share of sharp edges, beyond which a solid's mesh is noisy
SHAPE_LOSS = 4.0  # error of rotations over that of second moments: they go with differences of these
EVEN = (1280, 2880, 5120)  # faces of meshes made for smooth solids
SHAPELY = 0.01  # twice the area of a good face over the square of its longest side, at least
EXTRAPOLATED = "panels, two graded meshes extrapolated"
BUDGET_SLACK = 1.1  # of the faces asked for, to be spent
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
    if len(faces) > MANY and as_given:
        raise InputError(f"{name}: has {len(faces)} faces; to be solved as it is a mesh must have at most {MANY}")
    if len(faces) > MANY:
        thinning = "%s: %d faces; will be checked and thinned to about %d to find its added mass"
        logging.getLogger("warp_immersed").info(thinning, name, len(faces), THINNED if closed else 2 * THINNED)
    vertices, faces = clean_surface(vertices, faces, closed, name)
    center = vertices.mean(axis=0)
    size = float(np.abs(vertices - center).max())
    scaled = (vertices - center) / size
    stretch = equalizing_stretch(scaled, faces, closed)
    shrink = np.linalg.inv(stretch)
    stretched = scaled @ stretch
    flatness = float(np.linalg.cond(stretch))
    true_volume = 1.0
    if closed:
        true_volume = enclosed_volume(scaled, faces) if volume is None else volume / size**3

    def solve(vertices: Array, faces: Indices) -> SurfaceTensor:
        vertices = vertices @ shrink
        if closed:
            volume = enclosed_volume(vertices, faces)
            if not volume > 0.1 * true_volume:
                raise UnresolvedError(f"{len(faces)} faces enclose {volume / true_volume:.2g} of the volume")
            vertices = vertices * (true_volume / volume) ** (1.0 / 3.0)
        return surface_tensor(vertices + center / size, faces, closed, device, threads=threads, progress=progress)

    def solve_sheet(slab: Slab) -> MeshTensor:
        sheet = mesh_tensor(
            slab.vertices + center / size, slab.faces, False, None, tolerance, face_budget, False, device, threads
        )
        error = sheet.error_estimate + SLAB_EXCESS * slab.thinness
        return MeshTensor(sheet.matrix, error, sheet.faces, "panels on the middle sheet of a slab")

    lost = 0.0
    if as_given:
        result = direct_tensor(surface_from(stretched, faces, closed, flatness), solve)
    else:
        if len(faces) > MANY:
            mesh, lost = fewer_faces(stretched, faces, closed, progress or silent)
        else:
            mesh = marked_mesh(stretched, faces, closed)
        surface = surface_of(mesh, closed, flatness)
        slab = middle_sheet(patched_mesh(mesh.vertices @ shrink, mesh.faces, True)) if closed else None
        if slab is not None:
            result = solid_tensor(surface, solve, tolerance, face_budget, lambda: solve_sheet(slab))
        elif closed:
            result = solid_tensor(surface, solve, tolerance, face_budget)
        else:
            result = remeshed_tensor(surface, solve, tolerance, face_budget)
    dimensions = size ** np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    return MeshTensor(result.matrix * np.outer(dimensions, dimensions), result.error_estimate + lost, result.faces, result.method)


def fewer_faces(vertices: Array, faces: Indices, closed: bool, report: Progress) -> tuple[PatchMesh, float]:
    """A thinned mesh in place of one of far more faces than the flow needs, and the relative error that this makes."""
    wanted = THINNED if closed else 2 * THINNED
    mesh = patched_mesh(vertices, faces, closed)
    sharp = mesh_edges(mesh).feature.mean() if closed else 0.0
    if sharp > ROUGH:  # noise, not edges
        mesh = PatchMesh(vertices, faces, np.zeros(len(faces), dtype=np.int64), mesh.fixed)
    mesh = thinned(mesh, wanted, report)
    if closed:
        mesh = swollen(mesh, enclosed_volume(vertices, faces), SMOOTH)
    lost = shape_loss(vertices, faces, mesh) if closed else 0.0
    return marked_mesh(mesh.vertices, mesh.faces, closed), lost


def shape_loss(vertices: Array, faces: Indices, mesh: PatchMesh) -> float:
    """Relative error of a solid's tensor on another mesh of the same volume, by its second moments."""
    true, found = (measures(v, f, True)[1:] for v, f in ((vertices, faces), (mesh.vertices, mesh.faces)))
    return SHAPE_LOSS * float(np.abs(found[1:] / true[1:] * (true[0] / found[0]) ** (5.0 / 3.0) - 1.0).max())


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


def extrapolated(fine: Array, coarse: Array, parts: tuple[int, int]) -> tuple[Array, float]:
    """Richardson's extrapolation of two tensors on meshes of parts[0] < parts[1] cuts an edge, errors going with the square.

    Returns it and its estimated relative error: that of the next power, which is left.
    """
    few, many = parts
    matrix = fine + (fine - coarse) * few**2 / (many**2 - few**2)
    return matrix, NEXT_POWER * many / (few * (few + many)) * relative_difference(matrix, fine, 1.0)


def best_pair(budget: float) -> tuple[int, int]:
    """Cuts n < m of a coarse edge, n**2 + m**2 within a budget, of which the extrapolation leaves least, 1 / (n m (n + m))."""
    pairs = [(n, m) for n in range(1, 40) for m in range(n + 1, 2 * n + 1) if n * n + m * m <= budget and 3 * m >= 4 * n]
    return max(pairs, key=lambda pair: pair[0] * pair[1] * sum(pair), default=(1, 2))


def remeshed_tensor(surface: Surface, solve: Solve, tolerance: float, budget: int | None) -> MeshTensor:
    """Make a coarse mesh and cut it more and more finely until two such meshes extrapolate to the tolerance.

    The coarse mesh is a fan if there is one, and one of even triangles where that fails."""
    best, failure = None, UnresolvedError("")
    for base in (lambda: fan_mesh(surface), lambda: fitting_mesh(surface, tolerance, budget)):
        coarse = base()
        if coarse is None or (best is not None and budget is not None):
            continue
        try:
            result = cut_tensor(surface, coarse, solve, tolerance, budget)
        except UnresolvedError as problem:
            failure = problem
            continue
        if result is not None and (best is None or result.error_estimate < best.error_estimate):
            best = result
        if best is not None and best.error_estimate <= tolerance:
            break
    if best is None:
        raise InputError(f"mesh: {failure}; it is too thin or too jagged to be solved, must have rounder faces") from failure
    return best


def cut_tensor(surface: Surface, coarse: PatchMesh, solve: Solve, tolerance: float, budget: int | None) -> MeshTensor:
    """The tensor on a coarse mesh cut into n**2 and m**2 parts a face, with n < m as budget or tolerance ask."""
    given = measures(surface.mesh.vertices, surface.mesh.faces, surface.closed)
    count = len(coarse.faces)
    limit = best_pair(FACE_LIMIT * 1.4 / count)
    pair = min(limit, best_pair(START if budget is None else BUDGET_SLACK * budget / count))
    best, failure, spent = None, UnresolvedError(""), 0
    while True:
        meshes = [graded_mesh(surface, coarse, parts) for parts in pair]
        try:
            coarser, finer = (solve(*mesh) for mesh in meshes)
        except UnresolvedError as problem:
            failure, wanted = problem, 1.5
        else:
            matrix, error = extrapolated(finer.matrix, coarser.matrix, pair)
            shape = [measures(*mesh, surface.closed) for mesh in meshes]
            step = pair[0] ** 2 / (pair[1] ** 2 - pair[0] ** 2)
            lost = float(np.abs((shape[1] + step * (shape[1] - shape[0])) / given - 1.0).max())
            spent += sum(len(mesh[1]) for mesh in meshes)
            best = MeshTensor(positive_symmetric(matrix)[0], error + lost + finer.correction, spent, EXTRAPOLATED)
            if best.error_estimate <= tolerance:
                break
            wanted = max(1.3, (error / max(tolerance - lost, 0.5 * tolerance)) ** (1.0 / 3.0))
        if budget is not None or pair == limit:
            break
        pair = min(limit, best_pair(1.05 * wanted**2 * (pair[0] ** 2 + pair[1] ** 2)))
    if best is None:
        raise failure
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


def solid_tensor(
    surface: Surface, solve: Solve, tolerance: float, budget: int | None, as_slab: Callable[[], MeshTensor] | None = None
) -> MeshTensor:
    """Solids: on the given mesh if good and good enough, else as a slab if it is one, else on a mesh made for the purpose."""
    mesh, sharp = surface.mesh, bool(surface.singular.any())
    least, most = DIRECT if budget is None else (0.7 * budget, 1.1 * budget)
    ways = [lambda: direct_tensor(surface, solve)] if least <= len(mesh.faces) <= most and well_shaped(mesh) else []
    even = [lambda n=n: even_tensor(surface, solve, n) for n in (EVEN if budget is None else (budget,))]
    if as_slab is not None:
        ways.append(as_slab)
        tolerance = max(tolerance, SLAB_ERROR)
    if sharp:
        ways += [lambda: remeshed_tensor(surface, solve, tolerance, budget), *even[:1]]
    else:
        ways += even
    best, failure = None, InputError("")
    for way in ways:
        try:
            result = way()
        except (InputError, UnresolvedError) as problem:
            failure = InputError(str(problem))
            continue
        if best is None or result.error_estimate < best.error_estimate:
            best = result
        if best.error_estimate <= tolerance or budget is not None:
            break
    if best is None:
        raise failure
    return best


def well_shaped(mesh: PatchMesh) -> bool:
    """Whether no face is a needle."""
    sides = longest_squared(mesh.vertices, mesh.faces)
    return bool((np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1) > SHAPELY * sides).all())


def even_tensor(surface: Surface, solve: Solve, wanted: int) -> MeshTensor:
    """The tensor of a solid on a mesh of about so many even faces, scaled to the true volume by `solve`."""
    even = globe_mesh(surface, wanted) or coarse_mesh(surface, float(wanted), even=True)
    if not surface.singular.any():
        even = swollen(even, enclosed_volume(surface.mesh.vertices, surface.mesh.faces), SMOOTH)
    result = direct_tensor(surface_from(even.vertices, even.faces, True, surface.flatness), solve)
    error = result.error_estimate + shape_loss(surface.mesh.vertices, surface.mesh.faces, even)
    return MeshTensor(result.matrix, error, result.faces, "panels on a mesh of even faces")


def direct_tensor(surface: Surface, solve: Solve) -> MeshTensor:
    """The tensor on the given mesh, and its error from what the mesh does not resolve; for sheets from their rims."""
    vertices, faces = surface.mesh.vertices, surface.mesh.faces
    result = solve(vertices, faces)
    if result.jumps is None:
        error = rim_error(surface)
    else:
        error = kink_error(surface, result.jumps, np.diag(result.matrix))
    return MeshTensor(result.matrix, error + result.correction, len(faces), "panels on the given mesh")
