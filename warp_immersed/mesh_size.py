"""How long the edges of a coarse mesh should be: as the local width allows, changing gently, within a number of faces."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

GRADIENT = 0.7  # of edge length over distance
BEND = 0.7  # edge length over radius of curvature
SAMPLES = 500
EVENNESS = 0.9  # remeshed edges come out a little longer than asked for


@dataclass(frozen=True)
class SizeSamples:
    """Points (N, 3) and the edge length (N,) wanted there."""

    points: Array
    lengths: Array

    def at(self, points: Array) -> Array:
        """Edge length (P,) wanted at points (P, 3)."""
        result = np.empty(len(points))
        for first in range(0, len(points), 2048):
            gap = cdist(points[first : first + 2048], self.points)
            result[first : first + 2048] = (self.lengths + GRADIENT * gap).min(axis=1)
        return result


def rim_samples(vertices: Array, faces: Indices, halves: Indices) -> SizeSamples:
    """Half the local width along rims: the radius of the circle that touches the rim there and some other point of it.

    halves: (S, 2), face and first corner of each rim edge (an edge of a solid counts once for each of its faces).
    """
    face, corner = halves[:, 0], halves[:, 1]
    a, b, c = (vertices[faces[face, (corner + k) % 3]] for k in range(3))
    along = b - a
    lengths = np.linalg.norm(along, axis=1)
    pieces = np.maximum(1, np.round(lengths / (lengths.sum() / SAMPLES)).astype(int))
    pick = np.repeat(np.arange(len(halves)), pieces)
    within = np.arange(len(pick)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    points = a[pick] + ((within + 0.5) / pieces[pick])[:, None] * along[pick]
    stride = max(1, len(points) // SAMPLES)
    points, pick = points[::stride], pick[::stride]
    inward = c - a
    inward -= np.einsum("si,si->s", inward, along)[:, None] / (lengths**2)[:, None] * along
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    offset = points[None] - points[:, None]
    ahead = np.einsum("pqi,pi->pq", offset, inward[pick])
    squares = (offset**2).sum(axis=2)
    radius = np.where(ahead > 1e-3 * np.sqrt(squares), squares / np.maximum(2.0 * ahead, 1e-300), np.inf).min(axis=1)
    return SizeSamples(points, np.minimum(radius, np.ptp(vertices, axis=0).max()))


def bend_samples(vertices: Array, faces: Indices, smooth: Indices) -> SizeSamples:
    """What the curvature allows: BEND times its radius across smooth edges; smooth: (E, 4), ends and opposite corners."""
    a, b, c, d = (vertices[smooth[:, k]] for k in range(4))
    one, other = np.cross(b - a, c - a), np.cross(d - a, b - a)
    angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ei,ei->e", one, other))
    width = (np.linalg.norm(one, axis=1) + np.linalg.norm(other, axis=1)) / (2.0 * np.linalg.norm(b - a, axis=1))
    size = np.ptp(vertices, axis=0).max()
    lengths = BEND * width / np.maximum(angle, 1e-12)
    bent = np.flatnonzero(lengths < size)
    if len(bent) > SAMPLES:  # the most bent edge of each cell of a coarse grid
        cell = np.floor((a[bent] - vertices.min(axis=0)) / size * 12.0).astype(np.int64) @ np.array([1, 16, 256])
        bent = bent[np.lexsort((lengths[bent], cell))]
        cell = np.floor((a[bent] - vertices.min(axis=0)) / size * 12.0).astype(np.int64) @ np.array([1, 16, 256])
        bent = bent[np.unique(cell, return_index=True)[1]]
    return SizeSamples((a[bent] + b[bent]) / 2.0, lengths[bent])


def size_field(vertices: Array, faces: Indices, samples: list[SizeSamples], limit: float, even: bool) -> Callable[[Array], Array]:
    """Edge length at points (P, 3) -> (P,), such that the surface takes at most about `limit` triangles.

    even: spend them all, evenly but for where samples ask for shorter edges. Otherwise only these samples ask for any.
    """
    size = np.ptp(vertices, axis=0).max()
    points = np.concatenate([s.points for s in samples] + [vertices[faces[:1]].mean(axis=1)])
    lengths = np.concatenate([s.lengths for s in samples] + [[size]])
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    centers, weights = spread_points(corners, areas)
    ceiling = EVENNESS * np.sqrt(areas.sum() / (0.433 * limit)) if even else np.inf
    matters = (lengths < ceiling) | (lengths == lengths.min())
    points, lengths = points[matters], lengths[matters]
    floor = 0.0
    spread = GRADIENT * cdist(centers, points)
    for _ in range(40):
        count = (weights / (0.433 * np.minimum((np.maximum(lengths, floor) + spread).min(axis=1), ceiling) ** 2)).sum()
        if count <= limit:
            break
        floor = max(1.15 * floor, 0.01 * size)
    field = SizeSamples(points, np.maximum(lengths, floor))
    return lambda where: np.minimum(field.at(where), ceiling)


def spread_points(corners: Array, areas: Array, wanted: int = 1000) -> tuple[Array, Array]:
    """Points spread evenly over triangles (F, 3, 3), and the area each stands for."""
    cumulative = np.cumsum(areas)
    targets = (np.arange(wanted) + 0.5) / wanted * cumulative[-1]
    face = np.searchsorted(cumulative, targets)
    k = np.arange(wanted)
    u, v = np.mod(0.7548776662 * k, 1.0), np.mod(0.5698402910 * k, 1.0)  # the plastic-number sequence, folded
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    c = corners[face]
    points = c[:, 0] + u[:, None] * (c[:, 1] - c[:, 0]) + v[:, None] * (c[:, 2] - c[:, 0])
    return points, np.full(wanted, cumulative[-1] / wanted)
