"""Subdivision of a coarse surface mesh with its points crowded towards the rims, where the jump of potential is singular.

At a free rim the jump grows like the square root of the distance, so uniform meshes converge with the first power of the edge
length only; with distances growing like (k / n)^GRADING the second power returns. On a disk made of six triangles this is
the usual mesh of rings.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warp_immersed.feature_curves import FeatureCurves, arc_between, at_arc
from warp_immersed.remesh import Edges, PatchMesh, face_normals, mesh_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

GRADING = 2.0
FOLD_PARTS = 8  # where folds are looked for: a finer cut shows more of them


def graded_subdivision(
    base: PatchMesh, singular: Flags, parts: int, curves: FeatureCurves, put_back: Callable[[Array, Indices], Array]
) -> tuple[Array, Indices]:
    """Cut each face of a coarse mesh into parts**2 faces: vertices (V, 3) and faces (F, 3).

    singular: (V,) vertices on rims (or sharp edges of solids) towards which points crowd; no edge off a rim may join two of them.
    Points of feature edges go to the curves between the ends of the edge, others to the surface by put_back(points, patches).
    """
    edges = mesh_edges(base)
    arcs = edge_arcs(base, edges, curves)
    vertices, faces = subdivide(base, edges, singular, parts, curves, arcs, put_back)
    for _ in range(3):  # where a curve is too bent for its faces keep the straight edge
        spoiled = inverted_parents(base, vertices, faces, parts)
        if not len(spoiled):
            break
        for edge in edges.of_face[spoiled].ravel().tolist():
            arcs.pop(edge, None)
        vertices, faces = subdivide(base, edges, singular, parts, curves, arcs, put_back)
    return vertices, faces


def folded_faces(base: PatchMesh, singular: Flags, curves: FeatureCurves, put_back: Callable[[Array, Indices], Array]) -> Indices:
    """Faces of a coarse mesh that would fold over, at least in part, when subdivided."""
    edges = mesh_edges(base)
    cut = subdivide(base, edges, singular, FOLD_PARTS, curves, edge_arcs(base, edges, curves), put_back)
    return inverted_parents(base, *cut, FOLD_PARTS)


def edge_arcs(base: PatchMesh, edges: Edges, curves: FeatureCurves) -> dict[int, tuple[int, float, float]]:
    """For each feature edge the curve it stands for and the arc lengths of its ends."""
    arcs = {}
    for edge in np.flatnonzero(edges.feature).tolist():
        a, b = base.vertices[edges.ends[edge]]
        arc = arc_between(curves, a, b, 1e-7)
        if arc is not None and abs(arc[2] - arc[1]) < 3.0 * np.linalg.norm(b - a):
            arcs[edge] = arc
    return arcs


def inverted_parents(base: PatchMesh, vertices: Array, faces: Indices, parts: int) -> Indices:
    """Coarse faces of which a part is turned over or nearly without area."""
    before = np.repeat(face_normals(base.vertices, base.faces), parts**2, axis=0)
    after = face_normals(vertices, faces)
    lengths = np.linalg.norm(after, axis=1)
    sides = vertices[faces] - vertices[faces[:, [1, 2, 0]]]
    bad = np.einsum("fi,fi->f", before, after) < 0.2 * np.linalg.norm(before, axis=1) * lengths
    bad |= lengths < 1e-3 * (sides**2).sum(axis=2).max(axis=1) / parts
    return np.unique(np.flatnonzero(bad) // parts**2)


def subdivide(
    base: PatchMesh,
    edges: Edges,
    singular: Flags,
    parts: int,
    curves: FeatureCurves,
    arcs: dict[int, tuple[int, float, float]],
    put_back: Callable[[Array, Indices], Array],
) -> tuple[Array, Indices]:
    """One subdivision; corners come first, then the points of edges, then those inside faces."""
    i, j = np.array([(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]).T
    weights = np.stack([parts - i - j, i, j], axis=1)  # of the corners, in parts
    number = local_numbers(base, edges, weights, parts)
    count = int(number.max()) + 1
    vertices = np.zeros((count, 3))
    blended = crowded(weights / parts, singular[base.faces])
    straight = np.einsum("fpk,fki->fpi", blended, base.vertices[base.faces])
    straight += bends(base, edges, blended, curves, arcs)
    vertices[number.ravel()] = straight.reshape(-1, 3)  # shared points agree between faces
    on_curve = np.zeros(count, dtype=bool)
    on_curve[: len(base.vertices)] = True
    on_edge = (weights > 0).sum(axis=1) == 2
    of_edge = edges.of_face[:, [1, 2, 0]][:, np.argmin(weights[on_edge], axis=1)]  # the edge opposite to the zero weight
    on_curve[number[:, on_edge][edges.feature[of_edge]]] = True
    free = np.flatnonzero(~on_curve)
    if len(free):
        patch = np.empty(count, dtype=np.int64)
        patch[number] = base.patch[:, None]
        vertices[free] = put_back(vertices[free], patch[free])
    place = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(i, j, strict=True))}
    triangles = [(place[a, b], place[a + 1, b], place[a, b + 1]) for a in range(parts) for b in range(parts - a)]
    triangles += [(place[a + 1, b], place[a + 1, b + 1], place[a, b + 1]) for a in range(parts) for b in range(parts - a - 1)]
    return vertices, number[:, np.array(triangles)].reshape(-1, 3)


def local_numbers(base: PatchMesh, edges: Edges, weights: Indices, parts: int) -> Indices:
    """Vertex number (F, P) of each lattice point of each face, shared along edges."""
    faces, corners = len(base.faces), len(base.vertices)
    inside = np.flatnonzero((weights > 0).all(axis=1))
    number = np.empty((faces, len(weights)), dtype=np.int64)
    for k in range(3):
        number[:, weights[:, k] == parts] = base.faces[:, k : k + 1]
        here, there = weights[:, k], weights[:, (k + 1) % 3]
        on_edge = np.flatnonzero((here > 0) & (there > 0) & (weights[:, (k + 2) % 3] == 0))
        edge = edges.of_face[:, k]
        forward = base.faces[:, k] == edges.ends[edge, 0]
        step = np.where(forward[:, None], there[on_edge][None], here[on_edge][None])  # parts from the edge's first end
        number[:, on_edge] = corners + edge[:, None] * (parts - 1) + step - 1
    start = corners + len(edges.ends) * (parts - 1)
    number[:, inside] = start + np.arange(faces * len(inside)).reshape(faces, -1)
    return number


def crowded(weights: Array, singular: Flags) -> Array:
    """Barycentric weights (F, P, 3) moved towards the singular corners (F, 3) of each face, from uniform weights (P, 3)."""
    away = weights[None] * ~singular[:, None]
    s = away.sum(axis=2, keepdims=True)
    graded = s**GRADING
    mixed = (s > 0.0) & (s < 1.0)
    safe = np.where(mixed, s, 0.5)
    toward = weights[None] * singular[:, None]
    result = np.where(mixed, away * (graded / safe) + toward * ((1.0 - graded) / (1.0 - safe)), weights[None])
    count = singular.sum(axis=1)
    return np.where(((count == 0) | (count == 3))[:, None, None], weights[None], result)


def bends(
    base: PatchMesh, edges: Edges, weights: Array, curves: FeatureCurves, arcs: dict[int, tuple[int, float, float]]
) -> Array:
    """Displacements (F, P, 3) that bend straight feature edges into their curves, fading into the faces."""
    total = np.zeros((*weights.shape[:2], 3))
    if not arcs:
        return total
    for k in range(3):
        for face in np.flatnonzero(np.isin(edges.of_face[:, k], list(arcs))).tolist():
            edge = int(edges.of_face[face, k])
            curve, start, end = arcs[edge]
            first, second = base.vertices[edges.ends[edge]]
            here, there = weights[face, :, k], weights[face, :, (k + 1) % 3]
            if base.faces[face, k] != edges.ends[edge, 0]:
                here, there = there, here
            both = here + there
            t = np.where(both > 1e-12, there / np.where(both > 1e-12, both, 1.0), 0.0)
            straight = (1.0 - t)[:, None] * first + t[:, None] * second
            total[face] += (both**2)[:, None] * (at_arc(curves, curve, start + t * (end - start)) - straight)
    return total
