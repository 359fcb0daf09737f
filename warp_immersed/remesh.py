"""Remeshing of a triangulated surface to a wanted edge length, with its rims and creases kept.

Split long edges, collapse short ones, flip towards Delaunay, relax along the surface, put back on the original (Botsch and
Kobbelt, "A remeshing approach to multiresolution modeling", 2004). Every step works on a whole independent set of edges at
once with arrays, so that 200,000 faces take seconds. Feature edges are those with other than two faces and those between two
patches; patches are given, one number a face, and never mix.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LONG, SHORT = 4.0 / 3.0, 4.0 / 5.0  # of the wanted length: a split edge is not collapsed again
SAGITTA = 0.15  # how far edges may leave their curve at the middle, and faces their surface, over their lengths


@dataclass(frozen=True)
class PatchMesh:
    """Triangles with labels: vertices (V, 3), faces (F, 3), patch (F,) of each face, fixed (V,) vertices that may not move."""

    vertices: Array
    faces: Indices
    patch: Indices
    fixed: NDArray[np.bool_]


@dataclass(frozen=True)
class Edges:
    """Unique edges of a mesh: ends (E, 2) with ends[:, 0] < ends[:, 1]; of_face (F, 3), edge from corner k to k + 1;
    first, second (E,): two faces of each edge (second is -1 at a rim); feature (E,): rims, creases and patch borders."""

    ends: Indices
    of_face: Indices
    first: Indices
    second: Indices
    feature: NDArray[np.bool_]


def mesh_edges(mesh: PatchMesh) -> Edges:
    """Find the edges of a mesh."""
    faces = mesh.faces
    halves = np.sort(np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    keys = halves[:, 0] * (len(mesh.vertices) + 1) + halves[:, 1]
    _, first, inverse, counts = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    face = np.arange(len(keys)) // 3
    last = np.empty(len(first), dtype=np.int64)
    last[inverse] = face  # the last of the faces of each edge
    one, other = face[first], np.where(counts > 1, last, -1)
    feature = (counts != 2) | (mesh.patch[one] != mesh.patch[other])
    return Edges(halves[first], inverse.reshape(-1, 3), one, other, feature)


def winners(values: Array, groups: list[Indices], group_count: int) -> NDArray[np.bool_]:
    """Which items have the greatest value in every group they belong to; item i is in groups[k][i] for each k, if >= 0."""
    rank = np.empty(len(values), dtype=np.int64)
    rank[np.argsort(values, kind="stable")] = np.arange(len(values))
    best = np.full(group_count, -1)
    for group in groups:
        np.maximum.at(best, group[group >= 0], rank[group >= 0])
    result = np.ones(len(values), dtype=bool)
    for group in groups:
        result &= (group < 0) | (best[group] == rank)
    return result


def winners_apart(values: Array, one: Indices, other: Indices, edges: Edges, count: int) -> NDArray[np.bool_]:
    """Which of some vertex pairs (one, other), no two sharing a vertex, have no neighbouring pair of greater value."""
    rank = np.empty(len(values), dtype=np.int64)
    rank[np.argsort(values, kind="stable")] = np.arange(len(values))
    best = np.full(count, -1)
    best[one] = best[other] = rank
    around = best.copy()
    for column in (0, 1):
        np.maximum.at(around, edges.ends[:, column], best[edges.ends[:, 1 - column]])
    return (around[one] == rank) & (around[other] == rank)


def split_edges(mesh: PatchMesh, edges: Edges, chosen: Indices) -> PatchMesh:
    """Halve the edges `chosen`, of which no face may have two, at their midpoints."""
    middle = np.full(len(edges.ends), -1)
    middle[chosen] = len(mesh.vertices) + np.arange(len(chosen))
    of_face = middle[edges.of_face]
    split = np.flatnonzero((of_face >= 0).any(axis=1))
    corner = np.argmax(of_face[split] >= 0, axis=1)
    a, b, c = (mesh.faces[split, (corner + k) % 3] for k in range(3))
    new = of_face[split, corner]
    faces = mesh.faces.copy()
    faces[split] = np.stack([a, new, c], axis=1)
    return PatchMesh(
        np.vstack([mesh.vertices, mesh.vertices[edges.ends[chosen]].mean(axis=1)]),
        np.vstack([faces, np.stack([new, b, c], axis=1)]),
        np.concatenate([mesh.patch, mesh.patch[split]]),
        np.concatenate([mesh.fixed, np.zeros(len(chosen), dtype=bool)]),
    )


def split_where(mesh: PatchMesh, wanted: Callable[[PatchMesh, Edges], Array], limit: int) -> PatchMesh:
    """Halve edges as long as `wanted` gives a positive value, greatest first, up to `limit` faces."""
    for _ in range(64):
        edges = mesh_edges(mesh)
        values = wanted(mesh, edges)
        if not (values > 0.0).any() or len(mesh.faces) >= limit:
            break
        of_face = np.where(values[edges.of_face] > 0.0, values[edges.of_face], -1.0)
        greatest = edges.of_face[np.arange(len(of_face)), np.argmax(of_face + 1e-12 * edges.of_face, axis=1)]
        losers = np.zeros(len(values), dtype=bool)
        losers[edges.of_face[edges.of_face != greatest[:, None]]] = True
        chosen = np.flatnonzero((values > 0.0) & ~losers)
        if not len(chosen):
            break
        mesh = split_edges(mesh, edges, chosen)
    return mesh


def face_normals(vertices: Array, faces: Indices) -> Array:
    """Normals (F, 3) with lengths of twice the areas."""
    return np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])


def edge_angles(mesh: PatchMesh, edges: Edges) -> Array:
    """Angle (E,) between the normals of the two faces of each edge; 0 at rims and creases."""
    normals = face_normals(mesh.vertices, mesh.faces)
    one, other = normals[edges.first], normals[edges.second]
    angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ei,ei->e", one, other))
    return np.where(edges.feature, 0.0, angle)


def longest_squared(vertices: Array, faces: Indices) -> Array:
    """Square (F,) of the longest side of each face."""
    sides = vertices[faces] - vertices[faces[:, [1, 2, 0]]]
    return (sides**2).sum(axis=2).max(axis=1)


def cuts_curve(
    mesh: PatchMesh, edges: Edges, gone: Indices, kept: Indices, put_back: Callable[[Array, Indices], Array]
) -> NDArray[np.bool_]:
    """Whether taking curve vertices `gone` into their neighbours `kept` would leave an edge too far from the curve."""
    ends = edges.ends[edges.feature]
    sums = np.zeros(len(mesh.vertices))
    np.add.at(sums, ends[:, 0], ends[:, 1])
    np.add.at(sums, ends[:, 1], ends[:, 0])
    p, q = mesh.vertices[kept], mesh.vertices[sums[gone].astype(np.int64) - kept]
    middle = (p + q) / 2.0
    away = np.linalg.norm(put_back(middle, np.full(len(middle), -1)) - middle, axis=1)
    return away > SAGITTA * np.linalg.norm(p - q, axis=1)


def collapse_short(mesh: PatchMesh, size: Array, put_back: Callable[[Array, Indices], Array] | None) -> PatchMesh:
    """Collapse one independent set of edges shorter than SHORT times the wanted length; size: (V,).

    put_back: as for `relax`; edges and faces that would lie far from the surface are kept. None leaves that out, and takes
    any edges instead of the shortest first: for fine meshes.
    """
    edges = mesh_edges(mesh)
    count = len(mesh.vertices)
    lengths = np.linalg.norm(mesh.vertices[edges.ends[:, 0]] - mesh.vertices[edges.ends[:, 1]], axis=1)
    wanted = size[edges.ends].mean(axis=1)
    rank = vertex_rank(mesh, edges)
    # A vertex goes to the end that is at least as constrained: interior to anything, a curve along itself, corners stay.
    swap = rank[edges.ends[:, 0]] > rank[edges.ends[:, 1]]
    gone, kept = np.where(swap, edges.ends[:, 1], edges.ends[:, 0]), np.where(swap, edges.ends[:, 0], edges.ends[:, 1])
    legal = (rank[gone] == 0) | ((rank[gone] == 1) & edges.feature)
    legal &= lengths < SHORT * wanted
    legal[edges.of_face[edges.feature[edges.of_face].all(axis=1)]] = False  # would remove the last face of a patch
    # Link condition: the ends share no neighbours but the corners opposite to the edge.
    link = coo_matrix((np.ones(2 * len(lengths)), (edges.ends.T.ravel(), edges.ends[:, ::-1].T.ravel())), (count, count)).tocsr()
    candidates = np.flatnonzero(legal)
    if not len(candidates):
        return mesh
    gone, kept = gone[candidates], kept[candidates]
    shared = np.asarray(link[gone].multiply(link[kept]).sum(axis=1)).ravel()
    corners = np.bincount(edges.of_face.ravel(), minlength=len(lengths))[candidates]
    good = shared == corners
    along = np.flatnonzero(good & (rank[gone] == 1))
    if put_back is not None:
        good[along] = ~cuts_curve(mesh, edges, gone[along], kept[along], put_back)
    candidates, gone, kept = candidates[good], gone[good], kept[good]
    # An independent set, shortest first: no end of one edge is or neighbours an end of another.
    shortness = -lengths[candidates] / wanted[candidates]
    if put_back is None:  # chance makes far larger sets than lengths, which change slowly over a fine mesh
        shortness = np.random.default_rng(0).random(len(candidates))
    open_, chosen = np.arange(len(candidates)), []
    for _ in range(4):
        best = winners(shortness[open_], [gone[open_], kept[open_]], count)
        best[best] = winners_apart(shortness[open_[best]], gone[open_[best]], kept[open_[best]], edges, count)
        chosen.append(open_[best])
        blocked = np.zeros(count, dtype=bool)
        blocked[gone[chosen[-1]]] = blocked[kept[chosen[-1]]] = True
        blocked[edges.ends[blocked[edges.ends].any(axis=1)]] = True
        open_ = open_[~(blocked[gone[open_]] | blocked[kept[open_]])]
        if not len(open_):
            break
    picked = np.concatenate(chosen)
    gone, kept = gone[picked], kept[picked]
    target = np.arange(count)
    target[gone] = kept
    vertices = mesh.vertices
    # Undo what would turn a face over, make it a needle or take it off the surface.
    for _ in range(8):
        faces = target[mesh.faces]
        alive = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
        touched = alive & (faces != mesh.faces).any(axis=1)
        before, after = face_normals(vertices, mesh.faces[touched]), face_normals(vertices, faces[touched])
        lengths_before, lengths_after = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        fatness = lengths_after / longest_squared(vertices, faces[touched])
        turned = np.einsum("fi,fi->f", before, after) < 0.5 * lengths_before * lengths_after
        turned |= (fatness < 0.05) & (fatness < lengths_before / longest_squared(vertices, mesh.faces[touched]))
        if put_back is not None:
            middle = vertices[faces[touched]].mean(axis=1)
            away = np.linalg.norm(put_back(middle, mesh.patch[touched]) - middle, axis=1)
            turned |= away > SAGITTA * np.sqrt(longest_squared(vertices, faces[touched]))
        if not turned.any():
            break
        spoiled = np.zeros(count, dtype=bool)
        spoiled[faces[touched][turned].ravel()] = True
        spoiled[mesh.faces[touched][turned].ravel()] = True
        undo = spoiled[kept] | spoiled[gone]
        target[gone[undo]] = gone[undo]
        gone, kept = gone[~undo], kept[~undo]
    else:
        return mesh
    used = np.unique(faces[alive])
    number = np.full(count, -1)
    number[used] = np.arange(len(used))
    return PatchMesh(vertices[used], number[faces[alive]], mesh.patch[alive], mesh.fixed[used])


def vertex_rank(mesh: PatchMesh, edges: Edges) -> Indices:
    """0 for vertices inside a patch, 1 on a feature curve, 2 where curves end or meet and where fixed."""
    on_curve = np.bincount(edges.ends[edges.feature].ravel(), minlength=len(mesh.vertices))
    rank = np.minimum(on_curve, 1)
    rank[(on_curve != 0) & (on_curve != 2)] = 2
    rank[mesh.fixed] = 2
    return rank


def vertex_patch(mesh: PatchMesh, rank: Indices) -> Indices:
    """The patch (V,) of vertices inside one, -1 for others; rank: (V,)."""
    patch = np.full(len(mesh.vertices), -1)
    patch[mesh.faces] = mesh.patch[:, None]
    return np.where(rank == 0, patch, -1)


def flip_edges(mesh: PatchMesh) -> PatchMesh:
    """Flip one independent set of edges whose opposite angles add up to more than pi."""
    edges = mesh_edges(mesh)
    inner = np.flatnonzero(~edges.feature)
    f, g = edges.first[inner], edges.second[inner]
    fk = np.argmax(edges.of_face[f] == inner[:, None], axis=1)
    gk = np.argmax(edges.of_face[g] == inner[:, None], axis=1)
    a, b, c = (mesh.faces[f, (fk + k) % 3] for k in range(3))
    d = mesh.faces[g, (gk + 2) % 3]
    consistent = mesh.faces[g, gk] == b
    v = mesh.vertices

    def angle(at: Indices) -> Array:
        p, q = v[a] - v[at], v[b] - v[at]
        return np.arctan2(np.linalg.norm(np.cross(p, q), axis=1), np.einsum("ni,ni->n", p, q))

    gain = angle(c) + angle(d) - np.pi
    old_f, old_g = face_normals(v, np.stack([a, b, c], 1)), face_normals(v, np.stack([b, a, d], 1))
    new_f, new_g = face_normals(v, np.stack([a, d, c], 1)), face_normals(v, np.stack([d, b, c], 1))
    mean = old_f + old_g

    def along(normal: Array) -> Array:
        return np.einsum("ni,ni->n", normal, mean) / (np.linalg.norm(normal, axis=1) * np.linalg.norm(mean, axis=1) + 1e-300)

    flat = np.minimum(np.minimum(along(old_f), along(old_g)), np.minimum(along(new_f), along(new_g)))
    known = np.isin(np.minimum(c, d) * len(v) + np.maximum(c, d), edges.ends[:, 0] * len(v) + edges.ends[:, 1])
    good = consistent & (gain > 1e-6) & (flat > 0.7) & ~known & (c != d)
    if not good.any():
        return mesh
    picked = np.flatnonzero(good)
    # No two flips may share a face, nor (through a vertex) make the same new edge.
    chosen = picked[winners(gain[picked], [f[picked], g[picked]], len(mesh.faces))]
    pair = np.minimum(c, d)[chosen] * len(v) + np.maximum(c, d)[chosen]
    chosen = chosen[np.unique(pair, return_index=True)[1]]
    faces = mesh.faces.copy()
    faces[f[chosen]] = np.stack([a, d, c], 1)[chosen]
    faces[g[chosen]] = np.stack([d, b, c], 1)[chosen]
    return PatchMesh(mesh.vertices, faces, mesh.patch, mesh.fixed)


def relax(mesh: PatchMesh, put_back: Callable[[Array, Indices], Array]) -> PatchMesh:
    """Move vertices inside patches towards the mean of their neighbours, then all free ones back on the surface or curve.

    put_back: from points (N, 3) and their patches (N,), -1 for curves, to the nearest points of the original.
    """
    edges = mesh_edges(mesh)
    rank = vertex_rank(mesh, edges)
    total, weight = np.zeros_like(mesh.vertices), np.zeros(len(mesh.vertices))
    for end in (0, 1):
        np.add.at(total, edges.ends[:, end], mesh.vertices[edges.ends[:, 1 - end]])
        np.add.at(weight, edges.ends[:, end], 1.0)
    inner, free = np.flatnonzero(rank == 0), np.flatnonzero(rank < 2)
    moved = mesh.vertices.copy()
    moved[inner] = 0.5 * (mesh.vertices[inner] + total[inner] / weight[inner][:, None])
    moved[free] = put_back(moved[free], vertex_patch(mesh, rank)[free])
    return moved_safely(mesh, moved)


def moved_safely(mesh: PatchMesh, moved: Array) -> PatchMesh:
    """The mesh with its vertices at `moved` (V, 3), but for those whose move would turn a face over or flatten it."""
    moved = moved.copy()
    for _ in range(8):
        before, after = face_normals(mesh.vertices, mesh.faces), face_normals(moved, mesh.faces)
        product = np.einsum("fi,fi->f", before, after)
        turned = product < 0.3 * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        turned |= np.linalg.norm(after, axis=1) < 0.3 * np.linalg.norm(before, axis=1)
        if not turned.any():
            return PatchMesh(moved, mesh.faces, mesh.patch, mesh.fixed)
        stay = np.unique(mesh.faces[turned])
        moved[stay] = mesh.vertices[stay]
    return mesh


def remesh(
    mesh: PatchMesh,
    size_at: Callable[[Array], Array],
    put_back: Callable[[Array, Indices], Array],
    limit: int,
    rounds: int = 6,
) -> PatchMesh:
    """Remesh towards edge lengths size_at(points (N, 3)) -> (N,), up to `limit` faces while splitting."""

    def too_long(mesh: PatchMesh, edges: Edges) -> Array:
        p = mesh.vertices[edges.ends]
        return np.linalg.norm(p[:, 0] - p[:, 1], axis=1) / size_at(p.mean(axis=1)) - LONG

    for _ in range(60):  # down first, where there is too much
        before = len(mesh.faces)
        mesh = collapse_short(mesh, size_at(mesh.vertices), put_back)
        mesh = flip_edges(mesh)
        if len(mesh.faces) > 0.99 * before:
            break
    for _ in range(rounds):
        mesh = split_where(mesh, too_long, limit)
        for _ in range(3):
            mesh = flip_edges(mesh)
        for _ in range(3):
            mesh = collapse_short(mesh, size_at(mesh.vertices), put_back)
        for _ in range(3):
            mesh = flip_edges(mesh)
        mesh = relax(mesh, put_back)
    return mesh
