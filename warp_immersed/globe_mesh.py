"""Even meshes of round solids: a divided icosahedron, drawn from the middle of the body out onto its surface."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.feature_curves import feature_curves
from warp_immersed.graded_mesh import graded_subdivision
from warp_immersed.kernels import surface_queries
from warp_immersed.panel_mesh import Surface, nearest_on_surface
from warp_immersed.remesh import PatchMesh, face_normals, longest_squared

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OBLIQUE = 0.25  # least cosine between a ray and the normal of the face it hits
EVEN = 0.2  # least twice the area of a face over the square of its longest side


def globe_mesh(surface: Surface, wanted: int) -> PatchMesh | None:
    """About `wanted` even faces on a smooth solid, or None if its middle does not see all of its surface well."""
    if not surface.closed or surface.singular.any() or surface.mesh.patch.any():
        return None
    vertices, faces = surface.mesh.vertices, surface.mesh.faces
    normals = face_normals(vertices, faces)
    sixths = np.einsum("fi,fi->f", vertices[faces[:, 0]], normals)
    middle = np.einsum("f,fi->i", sixths, vertices[faces].sum(axis=1)) / (4.0 * sixths.sum())
    arms = vertices[faces].mean(axis=1) - middle
    cosines = np.einsum("fi,fi->f", arms, normals) / (np.linalg.norm(arms, axis=1) * np.linalg.norm(normals, axis=1))
    if cosines.min() < OBLIQUE:
        return None
    directions, globe = sphere_mesh(max(2, round(np.sqrt(wanted / 20.0))))
    points = nearest_on_surface(surface, hits(surface, middle, directions))
    fatness = np.linalg.norm(face_normals(points, globe), axis=1) / longest_squared(points, globe)
    if fatness.min() < EVEN:
        return None
    return PatchMesh(points, globe, np.zeros(len(globe), dtype=np.int64), np.zeros(len(points), dtype=bool))


def sphere_mesh(parts: int) -> tuple[Array, Indices]:
    """Unit sphere of 20 parts**2 faces."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    a, b = np.array([(s, t * golden) for s in (-1.0, 1.0) for t in (-1.0, 1.0)]).T
    zero = np.zeros(4)
    corners = np.concatenate([np.stack(c, axis=1) for c in ((zero, a, b), (b, zero, a), (a, b, zero))])
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    joined = np.isclose(gaps, 2.0)
    triples = [(i, j, k) for i in range(12) for j in range(i) for k in range(j) if joined[i, j] and joined[j, k] and joined[k, i]]
    faces = np.array(triples)
    inward = np.linalg.det(corners[faces]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    base = PatchMesh(corners, faces, np.zeros(20, dtype=np.int64), np.zeros(12, dtype=bool))
    none = np.zeros(12, dtype=bool)
    no_curves = feature_curves(corners, [])
    vertices, cut = graded_subdivision(base, none, parts, no_curves, lambda points, _: points)
    return vertices / np.linalg.norm(vertices, axis=1)[:, None], cut


def hits(surface: Surface, middle: Array, directions: Array) -> Array:
    """Points (N, 3) where rays from inside a solid leave it."""
    rays = wp.array(directions.astype(np.float32), dtype=wp.vec3f, device="cpu")
    distance = wp.empty(len(directions), dtype=wp.float32, device="cpu")
    inputs = [surface.query.id, wp.vec3f(*middle.tolist()), rays]
    wp.launch(surface_queries.ray_hits, dim=len(directions), inputs=inputs, outputs=[distance], device="cpu")
    return middle + distance.numpy().astype(np.float64)[:, None] * directions
