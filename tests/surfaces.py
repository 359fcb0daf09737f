"""Meshes with known added mass, made the plain way: rings on a disk, grids on a square, the reference leaf and airplane."""

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import icosphere

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def disk(rings: int, graded: bool = True) -> tuple[Array, Indices]:
    """Unit disk of 6 rings**2 faces; graded: ring radii sin(pi k / 2 n) instead of k / n."""
    points, first = [(0.0, 0.0, 0.0)], [0]
    for k in range(1, rings + 1):
        first.append(len(points))
        radius = np.sin(np.pi * k / (2 * rings)) if graded else k / rings
        angles = 2.0 * np.pi * np.arange(6 * k) / (6 * k)
        points += [(radius * np.cos(a), radius * np.sin(a), 0.0) for a in angles]
    faces = []
    for k in range(1, rings + 1):
        outer, inner = 6 * k, max(6 * (k - 1), 1)
        for sector in range(6):
            for j in range(k):
                a, b = first[k] + (sector * k + j) % outer, first[k] + (sector * k + j + 1) % outer
                c = first[k - 1] + (sector * (k - 1) + j) % inner
                faces.append((a, b, c))
                if j < k - 1:
                    faces.append((b, first[k - 1] + (sector * (k - 1) + j + 1) % inner, c))
    return np.array(points), np.array(faces, dtype=np.int64)


def square(cells: int) -> tuple[Array, Indices]:
    """Unit square about the origin, cells x cells halved cells."""
    x = np.linspace(-0.5, 0.5, cells + 1)
    points = np.array([(a, b, 0.0) for a in x for b in x])
    corner = np.array([i * (cells + 1) + j for i in range(cells) for j in range(cells)])
    faces = [(corner, corner + cells + 1, corner + 1), (corner + 1, corner + cells + 1, corner + cells + 2)]
    return points, np.concatenate([np.stack(f, axis=1) for f in faces]).astype(np.int64)


def ellipsoid(semi_axes: tuple[float, float, float], subdivisions: int) -> tuple[Array, Indices]:
    """Ellipsoid of 20 * 4**subdivisions faces, of the exact volume."""
    ball = icosphere(subdivisions)
    scale = (4.0 / 3.0 * np.pi / ball.volume) ** (1.0 / 3.0)
    return scale * np.asarray(ball.vertices) * np.array(semi_axes), np.asarray(ball.faces, dtype=np.int64)


def leaf(rings: int) -> tuple[Array, Indices]:
    """The cambered, twisted reference leaf, 60 x 30 mm, about its area centroid."""
    flat, faces = disk(rings)
    u, v = flat[:, 0], flat[:, 1]
    height = 0.006 * (1.0 - u**2) + 0.5 * 0.006 * v**2 + 0.5 * 0.03 / 4.0 * u * v
    return np.stack([0.03 * u, 0.015 * v, height - 0.005237821604676224], axis=1), faces


def leaf_like(outline: tuple[float, ...], rings: int, graded: bool = True) -> tuple[Array, Indices]:
    """A leaf of length 1: width, camber, twist, taper and cup, defined as the reference leaf is."""
    width, camber, twist, taper, cup = outline
    flat, faces = disk(rings, graded)
    u, v = flat[:, 0], flat[:, 1]
    height = camber * (1.0 - u**2) + cup * camber * v**2 + twist * width / 4.0 * u * v
    return np.stack([0.5 * u, 0.5 * width * v * (1.0 - taper * u), height], axis=1), faces


def slab_of(vertices: Array, faces: Indices, thickness: float) -> tuple[Array, Indices]:
    """A closed slab: a sheet moved half a thickness to either side, and a wall round its rim."""
    across = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    normals *= 0.5 * thickness / np.linalg.norm(normals, axis=1)[:, None]
    halves = np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2)
    _, first, counts = np.unique(np.sort(halves, axis=1), axis=0, return_index=True, return_counts=True)
    a, b = halves[first[counts == 1]].T
    below = len(vertices)
    wall = np.concatenate([np.stack([b, a, a + below], axis=1), np.stack([b, a + below, b + below], axis=1)])
    return np.vstack([vertices + normals, vertices - normals]), np.vstack([faces, faces[:, ::-1] + below, wall])


def airplane() -> tuple[Array, Indices]:
    """The reference paper airplane: two wings and a keel on one crease, about its area centroid."""
    points = [(0.14, 0, 0), (-0.14, 0, 0), (-0.14, 0.09, 0.015), (-0.14, -0.09, 0.015), (-0.14, 0, -0.035)]
    centroid = np.array([-0.04666666666666667, 0.0, 0.002317796489055271])
    return np.array(points, dtype=np.float64) - centroid, np.array([(0, 1, 2), (0, 1, 3), (0, 1, 4)], dtype=np.int64)


def lobed_outline(lobes: int, depth: float, points: int) -> Array:
    """Outline (points, 2) of a leaf with rounded lobes, of mean radius 1."""
    angle = 2.0 * np.pi * np.arange(points) / points
    radius = 1.0 + depth * np.cos(lobes * angle)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def fan(outline: Array) -> tuple[Array, Indices]:
    """A star-shaped outline (N, 2) as a fan of slivers about the origin: the worst triangulation a user may bring."""
    count = len(outline)
    points = np.vstack([np.zeros(3), np.column_stack([outline, np.zeros(count)])])
    k = np.arange(count)
    return points, np.stack([np.zeros(count), 1 + k, 1 + (k + 1) % count], axis=1).astype(np.int64)
