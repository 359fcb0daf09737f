"""From the mesh a user brings to the meshes the added-mass solver wants."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from warp_immersed.feature_curves import SMOOTH, FeatureCurves, corner_vertices, feature_curves, nearest_on_curves, trace_curves
from warp_immersed.graded_mesh import folded_faces, graded_subdivision
from warp_immersed.kernels import surface_queries
from warp_immersed.mesh_checks import warp_mesh
from warp_immersed.mesh_size import bend_samples, rim_samples, size_field
from warp_immersed.remesh import (
    Edges,
    PatchMesh,
    edge_angles,
    face_normals,
    flip_edges,
    mesh_edges,
    moved_safely,
    relax,
    remesh,
    split_where,
    vertex_patch,
    vertex_rank,
)
from warp_immersed.smooth_surface import corner_normals, smoothed

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

SHARP = np.radians(35.0)  # edges of closed bodies that turn by more are kept, and meshes crowd towards them
OVERHANG = 0.02  # of the size: how far a point may lie beyond the faces of the original
FOLD = np.radians(35.0)  # the same for sheets, but without crowding: their rims are far more singular


@dataclass(frozen=True, eq=False)
class Surface:
    """The original of all meshes of a body, scaled to about unit size.

    mesh: its triangles with their patches (parts bounded by rims, creases and sharp edges); curves: those bounds;
    singular: (E,) of mesh_edges(mesh), where meshes crowd; closed: a solid; query: for nearest points;
    flat: (P,) patches that are plane. normals: (F, 3, 3) of the smooth surface at the corners of the faces, see corner_normals.
    flatness: by how much one axis of the body was stretched more than another.
    """

    mesh: PatchMesh
    edges: Edges
    curves: FeatureCurves
    singular: Flags
    closed: bool
    query: wp.Mesh
    flat: Flags
    normals: Array
    flatness: float

    def put_back(self, points: Array, patches: Indices) -> Array:
        """Nearest points (N, 3) on the surface, or on its curves for patches of -1. Points of flat patches are on them."""
        result = points.copy()
        inside, curved = np.flatnonzero((patches >= 0) & ~self.flat[patches]), np.flatnonzero(patches < 0)
        if len(inside):
            result[inside] = nearest_on_surface(self, points[inside])
        if len(curved) and len(self.curves.starts):
            result[curved] = nearest_on_curves(self.curves, points[curved])[0]
        return result


def nearest_on_surface(surface: Surface, points: Array) -> Array:
    """Nearest points (N, 3) on a surface."""
    face = wp.empty(len(points), dtype=int, device="cpu")
    weights = wp.empty(len(points), dtype=wp.vec3f, device="cpu")
    where = wp.array(points.astype(np.float32), dtype=wp.vec3f, device="cpu")
    inputs = [surface.query.id, where]
    wp.launch(surface_queries.nearest_points, dim=len(points), inputs=inputs, outputs=[face, weights], device="cpu")
    found = face.numpy()
    corners = surface.mesh.vertices[surface.mesh.faces[found]]
    nearest = np.einsum("nk,nki->ni", weights.numpy().astype(np.float64), corners)
    # Into the plane of the nearest face: a smooth rim reaches a little beyond the straight edges of the faces.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)[:, None]
    normals /= doubled
    planar = points - np.einsum("ni,ni->n", points - nearest, normals)[:, None] * normals
    outside = np.linalg.norm(planar - nearest, axis=1)
    planar = np.where((outside < OVERHANG)[:, None], planar, nearest)
    opposite = np.cross(corners[:, [1, 2, 0]] - planar[:, None], corners[:, [2, 0, 1]] - planar[:, None])
    parts = np.einsum("nki,ni->nk", opposite, normals) / doubled
    return smoothed(planar, parts, corners, surface.normals[found])


def surface_from(vertices: Array, faces: Indices, closed: bool, flatness: float = 1.0) -> Surface:
    """Find the rims, creases, sharp edges and corners of a clean mesh of about unit size, stretched by so much."""
    return surface_of(marked_mesh(vertices, faces, closed), closed, flatness)


def patched_mesh(vertices: Array, faces: Indices, closed: bool) -> PatchMesh:
    """A clean mesh of about unit size with its patches, bounded by rims, creases and sharp edges."""
    plain = PatchMesh(vertices, faces, np.zeros(len(faces), dtype=np.int64), np.zeros(len(vertices), dtype=bool))
    edges = mesh_edges(plain)
    bent = edge_angles(plain, edges) > (SHARP if closed else FOLD)
    return PatchMesh(vertices, faces, patches_between(faces, edges, edges.feature | bent), plain.fixed)


def marked_mesh(vertices: Array, faces: Indices, closed: bool) -> PatchMesh:
    """The same with the corners of its rims, creases and sharp edges fixed."""
    mesh = patched_mesh(vertices, faces, closed)
    fixed = mesh.fixed.copy()
    fixed[corner_vertices(curves_of(mesh, mesh_edges(mesh)), float(np.ptp(vertices, axis=0).max()))] = True
    return PatchMesh(vertices, faces, mesh.patch, fixed)


def curves_of(mesh: PatchMesh, edges: Edges) -> FeatureCurves:
    """The rims, creases and patch borders of a mesh."""
    kinds = np.bincount(edges.of_face.ravel(), minlength=len(edges.ends))
    chosen = np.flatnonzero(edges.feature)
    return feature_curves(mesh.vertices, trace_curves(mesh.vertices, edges.ends[chosen], kinds[chosen]))


def surface_of(mesh: PatchMesh, closed: bool, flatness: float = 1.0) -> Surface:
    """A surface of a mesh whose patches and corners are known."""
    edges = mesh_edges(mesh)
    kinds = np.bincount(edges.of_face.ravel(), minlength=len(edges.ends))
    singular = edges.feature if closed else kinds == 1
    normals = corner_normals(mesh, edges, edge_angles(mesh, edges) > SMOOTH)
    query, curves = warp_mesh(mesh.vertices, mesh.faces), curves_of(mesh, edges)
    return Surface(mesh, edges, curves, singular, closed, query, flat_patches(mesh), normals, flatness)


def flat_patches(mesh: PatchMesh) -> Flags:
    """Which patches are plane."""
    normals = face_normals(mesh.vertices, mesh.faces)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    first = np.unique(mesh.patch, return_index=True)[1]
    off = np.linalg.norm(np.cross(normals, normals[first][mesh.patch]), axis=1) > 1e-6
    return np.bincount(mesh.patch, off) == 0


def patches_between(faces: Indices, edges: Edges, feature: Flags) -> Indices:
    """Number (F,) of the part of the surface, bounded by feature edges, that each face belongs to."""
    inner = ~feature & (edges.second >= 0)
    graph = coo_matrix((np.ones(inner.sum()), (edges.first[inner], edges.second[inner])), (len(faces), len(faces)))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def coarse_mesh(surface: Surface, limit: float, even: bool = False) -> PatchMesh:
    """A coarse mesh of well-shaped triangles with the rims and creases of a surface.

    limit: of about so many faces at most; even: of just about so many.
    """
    mesh, edges = surface.mesh, surface.edges
    samples = []
    if surface.singular.any():
        halves = np.argwhere(surface.singular[edges.of_face])
        samples.append(rim_samples(mesh.vertices, mesh.faces, halves))
    smooth = np.flatnonzero(~edges.feature)
    f, g = edges.first[smooth], edges.second[smooth]
    opposite = [mesh.faces[k].sum(axis=1) - edges.ends[smooth].sum(axis=1) for k in (f, g)]
    samples.append(bend_samples(mesh.vertices, mesh.faces, np.column_stack([edges.ends[smooth], *opposite])))
    size_at = size_field(mesh.vertices, mesh.faces, samples, limit, even)
    coarse = remesh(mesh, size_at, surface.put_back, limit=int(20 * limit) + 2 * len(mesh.faces))
    return without_folds(surface, without_bridges(surface, coarse))


def without_folds(surface: Surface, mesh: PatchMesh) -> PatchMesh:
    """Halve the rim edges (else the longest edges) of faces that would fold over when their rims are bent to the curves."""
    for _ in range(5):
        edges = mesh_edges(mesh)
        folded = folded_faces_of(surface, mesh)
        if not len(folded):
            break
        lengths = np.linalg.norm(mesh.vertices[edges.ends[:, 0]] - mesh.vertices[edges.ends[:, 1]], axis=1)
        wanted = np.zeros(len(lengths))
        for face in edges.of_face[folded]:
            curved = face[edges.feature[face]]
            chosen = curved if len(curved) else face[[np.argmax(lengths[face])]]
            wanted[chosen] = lengths[chosen]
        once = wanted

        def only_once(_: PatchMesh, edges: Edges, once: Array = once, count: int = len(edges.ends)) -> Array:
            return once if len(edges.ends) == count else np.zeros(len(edges.ends))

        mesh = on_surface(surface, split_where(mesh, only_once, limit=10**6))
        for _ in range(2):
            mesh = flip_edges(mesh)
        mesh = without_bridges(surface, relax(mesh, surface.put_back))
    return mesh


def folded_faces_of(surface: Surface, mesh: PatchMesh) -> Indices:
    """Faces of a coarse mesh that fold over when cut finely and put on the surface."""
    return folded_faces(mesh, singular_vertices(surface, mesh, mesh_edges(mesh)), surface.curves, surface.put_back)


def on_surface(surface: Surface, mesh: PatchMesh) -> PatchMesh:
    """The same mesh with its free vertices put back on the surface and its curves."""
    rank = vertex_rank(mesh, mesh_edges(mesh))
    vertices = mesh.vertices.copy()
    free = rank < 2
    vertices[free] = surface.put_back(vertices[free], vertex_patch(mesh, rank)[free])
    return moved_safely(mesh, vertices)


def singular_vertices(surface: Surface, mesh: PatchMesh, edges: Edges) -> Flags:
    """Vertices (V,) of a coarse mesh on rims (sheets) or sharp edges (solids)."""
    marks = np.zeros(len(mesh.vertices), dtype=bool)
    marks[edges.ends[singular_edges(surface, mesh, edges)]] = True
    return marks


def singular_edges(surface: Surface, mesh: PatchMesh, edges: Edges) -> Flags:
    """Edges (E,) of a coarse mesh that are rims (sheets) or sharp (solids)."""
    kinds = np.bincount(edges.of_face.ravel(), minlength=len(edges.ends))
    return edges.feature if surface.closed else kinds == 1


def bridges(surface: Surface, mesh: PatchMesh, edges: Edges) -> Array:
    """Lengths (E,) of the edges that join two rim vertices without being rim, between which nothing can be crowded; else 0."""
    marks = singular_vertices(surface, mesh, edges)
    lengths = np.linalg.norm(mesh.vertices[edges.ends[:, 0]] - mesh.vertices[edges.ends[:, 1]], axis=1)
    return np.where(marks[edges.ends].all(axis=1) & ~singular_edges(surface, mesh, edges), lengths, 0.0)


def without_bridges(surface: Surface, mesh: PatchMesh) -> PatchMesh:
    """Halve the edges that join two rim vertices without being rim, and faces made of rim only."""
    mesh = split_where(mesh, lambda mesh, edges: bridges(surface, mesh, edges), limit=10**6)
    edges = mesh_edges(mesh)
    whole = singular_vertices(surface, mesh, edges)[mesh.faces].all(axis=1)
    if whole.any():
        a, b, c = mesh.faces[whole].T
        center = len(mesh.vertices) + np.arange(len(a))
        faces = [mesh.faces[~whole], np.stack([a, b, center], 1), np.stack([b, c, center], 1), np.stack([c, a, center], 1)]
        mesh = PatchMesh(
            np.vstack([mesh.vertices, mesh.vertices[mesh.faces[whole]].mean(axis=1)]),
            np.vstack(faces),
            np.concatenate([mesh.patch[~whole], *[mesh.patch[whole]] * 3]),
            np.concatenate([mesh.fixed, np.zeros(len(a), dtype=bool)]),
        )
    return on_surface(surface, mesh)


def graded_mesh(surface: Surface, coarse: PatchMesh, parts: int) -> tuple[Array, Indices]:
    """The coarse mesh with each face cut into parts**2, points crowded towards rims and put on the surface."""
    singular = singular_vertices(surface, coarse, mesh_edges(coarse))
    return graded_subdivision(coarse, singular, parts, surface.curves, surface.put_back)
