"""How a body can lie on flat ground: the points it may touch it with and the directions it may rest on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from warp_immersed.mesh_normals import vertex_normals
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

# A hull with more vertices is thinned to the extreme ones along this many directions.
MOST_SUPPORTS = 512
# Sheets can be balanced on an edge as thick as they are, but do not come to rest on it: cosine between the sheet's
# normal and the vertical below which it topples.
EDGE_STAND = 0.3


@dataclass(frozen=True)
class Resting:
    """Contact geometry in the principal frame.

    supports (S, 3) [m]: vertices of the convex hull; rests (R, 3): unit outward normals of the hull faces on which the
    body stands without toppling, its centre of mass above them.
    """

    supports: Array
    rests: Array


def resting(shape: Shape) -> Resting:
    """Hull and rest directions of a shape; a sheet is as thick as it is."""
    points = np.asarray(shape.mesh.vertices)
    if shape.thickness is not None:
        offset = vertex_normals(points, np.asarray(shape.mesh.faces)) * (shape.thickness / 2.0)
        points = np.concatenate([points + offset, points - offset])
    points = points[ConvexHull(points).vertices]
    if len(points) > MOST_SUPPORTS:
        points = points[np.unique(np.argmax(points @ sphere_directions(MOST_SUPPORTS).T, axis=0))]
    rests = rest_directions(points)
    if shape.is_sheet:
        rests = rests[np.abs(rests[:, 2]) > EDGE_STAND]
    return Resting(points, rests)


def rest_directions(points: Array) -> Array:
    """Outward normals (R, 3) of those hull faces of points (P, 3) that contain the origin's projection, one a facet."""
    hull = ConvexHull(points)
    normals, distances = hull.equations[:, :3], -hull.equations[:, 3]
    feet = normals * distances[:, None]
    corners = points[hull.simplices]
    inside = np.ones(len(feet), dtype=bool)
    size = np.ptp(points, axis=0).max()
    for i in range(3):
        start, end, other = corners[:, i], corners[:, (i + 1) % 3], corners[:, (i + 2) % 3]
        across = np.cross(normals, end - start)
        side = np.einsum("fi,fi->f", across, feet - start) * np.sign(np.einsum("fi,fi->f", across, other - start))
        inside &= side >= -1e-9 * size * np.linalg.norm(across, axis=1)
    found = normals[inside]
    _, first = np.unique(found.round(6), axis=0, return_index=True)
    return found[np.sort(first)]


def sphere_directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly over the sphere (Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
