"""Triangle meshes of flat sheets: ellipses, rectangles and any simple outline."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from warp_immersed.errors import InputError

Array = NDArray[np.float64]

# Rounds of boundary refinement before an outline is given up as too intricate for its spacing.
REFINEMENTS = 12


def ellipse_mesh(a: float, b: float, rings: int = 8) -> trimesh.Trimesh:
    """Ellipse with semi-axes a (x) and b (y) [m] as rings of triangles, 6 rings^2 faces."""
    points, faces = [np.zeros((1, 2))], []
    first = 1
    for ring in range(1, rings + 1):
        angle = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        points.append(ring / rings * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        inner_first, inner_count = (0, 1) if ring == 1 else (first - 6 * (ring - 1), 6 * (ring - 1))
        for sector in range(6):
            for step in range(ring):
                outer = first + (sector * ring + step) % (6 * ring)
                after = first + (sector * ring + step + 1) % (6 * ring)
                inner = inner_first + (sector * (ring - 1) + step) % inner_count
                faces.append((inner, outer, after))
                if step < ring - 1:
                    faces.append((inner, after, inner_first + (sector * (ring - 1) + step + 1) % inner_count))
        first += 6 * ring
    return flat_mesh(np.concatenate(points) * [a, b], np.array(faces))


def rectangle_mesh(length: float, width: float, cells: int = 8) -> trimesh.Trimesh:
    """Rectangle length (x) by width (y) [m] about the origin, with at least `cells` cells along its shorter side."""
    size = min(length, width) / cells
    nx, ny = max(cells, round(length / size)), max(cells, round(width / size))
    nx, ny = min(nx, 4 * cells), min(ny, 4 * cells)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, nx + 1) * length, np.linspace(-0.5, 0.5, ny + 1) * width, indexing="ij")
    index = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    a, b, c, d = (corner.ravel() for corner in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return flat_mesh(np.stack([x.ravel(), y.ravel()], axis=1), faces)


def outline_mesh(outline: ArrayLike, spacing: float | None = None) -> trimesh.Trimesh:
    """Triangles of roughly equal size that fill a simple closed polygon.

    outline: (P, 2) [m], its corners in order, either way round, the first not repeated; spacing: length of an edge [m],
    by default such that some 300 triangles result.

    Raises:
        InputError: fewer than three corners, no area, or edges that cross.
    """
    corners = np.asarray(outline, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InputError(f"outline: found shape {corners.shape}, must be a list of at least three [x, y]")
    if not np.isfinite(corners).all():
        raise InputError("outline: has coordinates that are not finite numbers")
    area = polygon_area(corners)
    if abs(area) < 1e-12 * np.ptp(corners, axis=0).max() ** 2:
        raise InputError("outline: encloses no area")
    crossing = crossing_edges(corners)
    if crossing is not None:
        raise InputError(f"outline: edges {crossing[0]} and {crossing[1]} cross; it must be a simple polygon")
    if area < 0.0:
        corners = corners[::-1]
    spacing = spacing or float(np.sqrt(abs(area) / 130.0))
    boundary = subdivided(corners, spacing)
    for _ in range(REFINEMENTS):
        points = np.concatenate([boundary, interior_lattice(boundary, spacing)])
        faces = Delaunay(points).simplices
        edges = {frozenset(edge) for face in faces for edge in (face[:2], face[1:], face[::2])}
        count = len(boundary)
        missing = [i for i in range(count) if frozenset((i, (i + 1) % count)) not in edges]
        if not missing:
            break
        middles = (boundary[missing] + boundary[(np.array(missing) + 1) % count]) / 2.0
        boundary = np.insert(boundary, np.array(missing) + 1, middles, axis=0)
    else:
        raise InputError("outline: too intricate to mesh; simplify it, or remove corners that nearly touch")
    faces = faces[inside_polygon(points[faces].mean(axis=1), boundary)]
    corners_of = points[faces]
    doubled = cross2(corners_of[:, 1] - corners_of[:, 0], corners_of[:, 2] - corners_of[:, 0])
    faces = faces[np.abs(doubled) > 1e-9 * spacing**2]
    flipped = doubled[np.abs(doubled) > 1e-9 * spacing**2] < 0.0
    faces[flipped] = faces[flipped][:, ::-1]
    return flat_mesh(points, faces)


def flat_mesh(points: Array, faces: NDArray[np.int64]) -> trimesh.Trimesh:
    """Mesh in the plane z = 0 from points (P, 2), with texture coordinates that span its bounding box."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    visual = trimesh.visual.TextureVisuals(uv=(points - low) / extent)
    vertices = np.column_stack([points, np.zeros(len(points))])
    return trimesh.Trimesh(vertices, faces, visual=visual, process=False)


def cross2(u: Array, v: Array) -> Array:
    """z component of the cross product of plane vectors (..., 2)."""
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def polygon_area(corners: Array) -> float:
    """Signed area of a polygon (P, 2), positive if counter-clockwise."""
    return float(cross2(corners, np.roll(corners, -1, axis=0)).sum() / 2.0)


def crossing_edges(corners: Array) -> tuple[int, int] | None:
    """Indices of two edges of a polygon (P, 2) that cross each other, if any do."""
    count = len(corners)
    p, q = corners, np.roll(corners, -1, axis=0)
    side_p = cross2((q - p)[:, None], p[None] - p[:, None])
    side_q = cross2((q - p)[:, None], q[None] - p[:, None])
    splits = side_p * side_q < 0.0
    i, j = np.nonzero(splits & splits.T)
    apart = (np.abs(i - j) > 1) & (np.abs(i - j) < count - 1)
    return (int(i[apart][0]), int(j[apart][0])) if apart.any() else None


def subdivided(corners: Array, spacing: float) -> Array:
    """The polygon (P, 2) with its edges cut into pieces no longer than spacing."""
    pieces = []
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = max(1, int(np.ceil(np.linalg.norm(q - p) / spacing)))
        pieces.append(p + (q - p) * (np.arange(n) / n)[:, None])
    return np.concatenate(pieces)


def interior_lattice(boundary: Array, spacing: float) -> Array:
    """Points (Q, 2) of a triangular lattice inside a polygon, kept off its boundary."""
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    height = spacing * np.sqrt(3.0) / 2.0
    rows = np.arange(low[1] + height / 2.0, high[1], height)
    points = np.concatenate([lattice_row(low[0], high[0], y, spacing, i) for i, y in enumerate(rows)])
    points = points[inside_polygon(points, boundary)]
    if not len(points):
        return points
    distances = np.linalg.norm(points[:, None] - boundary[None], axis=2).min(axis=1)
    return points[distances > 0.6 * spacing]


def lattice_row(start: float, stop: float, y: float, spacing: float, row: int) -> Array:
    """One row of a triangular lattice."""
    x = np.arange(start + spacing * 0.5 * (row % 2), stop, spacing)
    return np.column_stack([x, np.full_like(x, y)])


def inside_polygon(points: Array, corners: Array) -> NDArray[np.bool_]:
    """Which points (Q, 2) lie inside a polygon (P, 2), by the even-odd rule."""
    p, q = corners, np.roll(corners, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    straddles = (p[:, 1] > y) != (q[:, 1] > y)
    rise = np.where(q[:, 1] == p[:, 1], 1.0, q[:, 1] - p[:, 1])
    return (np.count_nonzero(straddles & (x < p[:, 0] + (y - p[:, 1]) * (q - p)[:, 0] / rise), axis=1) % 2).astype(bool)
