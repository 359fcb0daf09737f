"""Where the smooth surface lies whose samples the vertices of a mesh are.

A mesh whose faces meet at small angles stands for a smooth surface. With the normals n_i at its corners p_i known to second
order, the point q = sum w_i p_i of a face belongs to the point q - 1/2 sum w_i ((q - p_i) . n_i) n_i of that surface: half way
from the face to the mean of the tangent planes, which is exact for quadrics (with 3/4 instead of 1/2 it is Phong tessellation:
Boubekeur and Alexa, ACM Trans. Graph. 27, 2008).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from warp_immersed.remesh import Edges, PatchMesh, edge_angles, face_normals, mesh_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FACES = 40_000  # finer meshes need no smoothing


def corner_normals(mesh: PatchMesh, edges: Edges, sharp: NDArray[np.bool_]) -> Array:
    """Unit normals (F, 3, 3) of the smooth surface at the corners of each face, one for each patch that meets there.

    sharp: (E,) edges across which the surface is not smooth; corners at their ends get 0, which leaves the face flat there.
    """
    count = len(mesh.vertices)
    if len(mesh.faces) > FACES:
        return np.zeros((len(mesh.faces), 3, 3))
    keys, wedge = np.unique(mesh.patch[:, None] * count + mesh.faces, return_inverse=True)
    wedge, vertex = wedge.reshape(-1, 3), keys % count
    points = mesh.vertices[vertex]
    first = mean_normals(points, wedge)
    normals = fitted_normals(points, wedge, first)
    bent = np.zeros(count, dtype=bool)
    bent[edges.ends[sharp]] = True
    normals[bent[vertex]] = 0.0
    return normals[wedge]


def mean_normals(points: Array, faces: Indices) -> Array:
    """Normals (V, 3), exact on spheres: corners weigh sin(angle) / product of sides (Max, J. Graph. Tools 4, 1999)."""
    total = np.zeros_like(points)
    for k in range(3):
        at, one, other = (points[faces[:, (k + j) % 3]] for j in range(3))
        a, b = one - at, other - at
        weight = (a**2).sum(axis=1) * (b**2).sum(axis=1)
        np.add.at(total, faces[:, k], np.cross(a, b) / weight[:, None])
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def fitted_normals(points: Array, faces: Indices, first: Array) -> Array:
    """Normals (V, 3) of the quadrics through each vertex that fit its neighbours and theirs best; `first`: (V, 3), near them."""
    count = len(points)
    halves = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ones = np.ones(2 * len(halves))
    near = coo_matrix((ones, np.concatenate([halves, halves[:, ::-1]]).T), (count, count)).tocsr()
    around = (near + near @ near).tocoo()
    off = around.row != around.col
    here, there = around.row[off], around.col[off]
    axis = np.eye(3)[np.argmin(np.abs(first), axis=1)]
    one = np.cross(first, axis)
    one /= np.linalg.norm(one, axis=1)[:, None]
    other = np.cross(first, one)
    gap = points[there] - points[here]
    square = (gap**2).sum(axis=1)
    members = np.bincount(here, minlength=count)
    scale = np.sqrt(np.bincount(here, square, minlength=count) / np.maximum(members, 1))[here]
    x, y, z = (np.einsum("pi,pi->p", gap, frame[here]) / scale for frame in (one, other, first))
    terms = np.stack([x, y, x * x, x * y, y * y], axis=1)
    weight = scale**2 / square
    products = weight[:, None, None] * terms[:, :, None] * np.concatenate([terms, z[:, None]], axis=1)[:, None]
    sums = np.stack([np.bincount(here, column, minlength=count) for column in products.reshape(len(here), -1).T], axis=1)
    system = sums.reshape(count, 5, 6)
    ridge = 1e-9 * np.einsum("vii->v", system[:, :, :5])[:, None, None] * np.eye(5) + 1e-300 * np.eye(5)
    slopes = np.linalg.solve(system[:, :, :5] + ridge, system[:, :, 5:])[:, :2, 0]
    slopes[(members < 6) | (np.abs(slopes) > 0.3).any(axis=1)] = 0.0  # too few neighbours, or no smooth surface: keep the mean
    normals = first - slopes[:, :1] * one - slopes[:, 1:] * other
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def smoothed(points: Array, weights: Array, corners: Array, normals: Array) -> Array:
    """Points (N, 3) of faces moved to the smooth surface; weights (N, 3) of their corners (N, 3, 3) with normals (N, 3, 3)."""
    above = np.einsum("nki,nki->nk", points[:, None] - corners, normals)
    return points - 0.5 * np.einsum("nk,nk,nki->ni", weights, above, normals)


def swollen(mesh: PatchMesh, volume: float, smooth: float) -> PatchMesh:
    """A closed mesh with its vertices moved along their normals such that it encloses a volume.

    Faces between points of a smooth surface cut off what bulges between them: vertices move as far as the faces around them lie
    under it, all times one factor, or all by one distance where that does not make up for the volume. (Scaling about the middle
    would rather move what lies far out.)
    smooth: angle between faces of a smooth surface [rad].
    """
    edges = mesh_edges(mesh)
    normals = corner_normals(mesh, edges, edge_angles(mesh, edges) > smooth)
    corners, faces = mesh.vertices[mesh.faces], mesh.faces
    centers, thirds = corners.mean(axis=1), np.full((len(faces), 3), 1.0 / 3.0)
    across = face_normals(mesh.vertices, faces)
    areas = np.linalg.norm(across, axis=1)
    under = np.einsum("fi,fi->f", smoothed(centers, thirds, corners, normals) - centers, across) / areas
    around, depth, outward = np.zeros(len(mesh.vertices)), np.zeros(len(mesh.vertices)), np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(around, faces[:, k], areas)
        np.add.at(depth, faces[:, k], areas * under)
        np.add.at(outward, faces[:, k], across)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    depth /= around
    for steps in (depth, np.ones(len(depth))):
        vertices, factor = mesh.vertices, 0.0
        for _ in range(4):
            now = face_normals(vertices, faces)
            lacking = volume - np.einsum("fi,fi->", vertices[faces[:, 0]], now) / 6.0
            swept = np.einsum("fki,fi->", (steps[:, None] * outward)[faces], now) / 6.0
            step = lacking / swept if swept != 0.0 else np.inf
            factor += step
            vertices = vertices + step * steps[:, None] * outward
        if 0.3 < factor < 1.5:
            break
    return PatchMesh(vertices, faces, mesh.patch, mesh.fixed)
