"""What a mesh must be for the added-mass solver, and the repairs made on the way there."""

import warnings

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from warp_immersed.errors import InputError, MeshRepairWarning
from warp_immersed.kernels import surface_queries

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MERGE = 1e-7  # of the size: vertices closer than this are one


def clean_surface(vertices: Array, faces: Indices, closed: bool, name: str = "mesh") -> tuple[Array, Indices]:
    """Check a triangle mesh and make it fit for the solver: vertices (V, 3) and faces (F, 3), closed ones outward.

    Merges duplicate vertices, drops faces without area and second copies of a face (coincident sheets), orients consistently
    and leaves out sealed cavities.

    Raises:
        InputError: no faces, vertices that are not finite, an open or non-manifold edge of a closed mesh, no consistent
            orientation, no volume, or a surface that crosses or lies on itself.
    Warns:
        MeshRepairWarning: faces were dropped or merged.
    """
    vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    if not len(faces):
        raise InputError(f"{name}: has 0 faces, must be a triangle mesh")
    used = np.unique(faces)
    if not np.isfinite(vertices[used]).all():
        bad = int(used[~np.isfinite(vertices[used]).all(axis=1)][0])
        raise InputError(f"{name}: vertex {bad} is {vertices[bad].tolist()}, must be finite numbers")
    vertices, faces = vertices[used], np.searchsorted(used, faces)
    size = float(np.ptp(vertices, axis=0).max())
    if not size > 0.0:
        raise InputError(f"{name}: all its vertices are one point, must have a size")
    vertices, faces = merge_vertices(vertices, faces, MERGE * size)
    given = len(faces)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    faces = faces[np.linalg.norm(normals, axis=1) > 1e-12 * size**2]
    faces = faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]
    if not len(faces):
        raise InputError(f"{name}: all its {given} faces are without area")
    if len(faces) < given:
        warnings.warn(f"{name}: left out {given - len(faces)} faces without area or given twice", MeshRepairWarning, stacklevel=3)
    faces = oriented(vertices, faces, closed, name)
    if closed:
        faces = outward(vertices, faces, size, name)
    used = np.unique(faces)
    vertices, faces = vertices[used], np.searchsorted(used, faces)
    check_contacts(vertices, faces, size, name)
    return vertices, faces


def merge_vertices(vertices: Array, faces: Indices, tolerance: float) -> tuple[Array, Indices]:
    """Make vertices closer than tolerance one, the first of them."""
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    if not len(pairs):
        return vertices, faces
    count = len(vertices)
    _, group = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), (count, count)), directed=False)
    first = np.unique(group, return_index=True)[1]
    return vertices[first], group[faces]


def oriented(vertices: Array, faces: Indices, closed: bool, name: str) -> Indices:
    """Faces with one orientation across every edge of two faces; a one-sided sheet keeps what it has.

    Raises InputError, for a closed mesh, at an edge that has not exactly two faces or where none fits.
    """
    count = len(faces)
    halves = np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2)
    keys = halves.min(axis=1) * len(vertices) + halves.max(axis=1)
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    members = np.diff(first, append=len(order))
    if closed and (members != 2).any():
        odd = first[members != 2][0]
        number = int(members[members != 2][0])
        a, b = vertices[halves[order[odd]]]
        where = f"edge {point_text(a)} to {point_text(b)}"
        if number == 1:
            raise InputError(f"{name}: is open at {where}; close it, or give a thickness [m] to make it a sheet")
        raise InputError(f"{name}: {number} faces meet at {where}; a closed body must have exactly 2 at every edge")
    twice = first[members == 2]
    pairs = order[np.stack([twice, twice + 1], axis=1)]
    forward = halves[:, 0] < halves[:, 1]
    opposed = forward[pairs[:, 0]] == forward[pairs[:, 1]]  # both run the same way: one of the faces must turn
    f, g = pairs[:, 0] // 3, pairs[:, 1] // 3
    rows = np.concatenate([2 * f, 2 * f + 1])
    columns = np.concatenate([2 * g + opposed, 2 * g + 1 - opposed])
    _, color = connected_components(coo_matrix((np.ones(len(rows)), (rows, columns)), (2 * count, 2 * count)), directed=False)
    one_sided = color[0::2] == color[1::2]
    if closed and one_sided.any():
        raise InputError(f"{name}: has no inside and outside (one-sided near {point_text(vertices[faces[one_sided][0, 0]])})")
    turn = (color[0::2] > color[1::2]) & ~one_sided
    return np.where(turn[:, None], faces[:, [0, 2, 1]], faces)


def outward(vertices: Array, faces: Indices, size: float, name: str) -> Indices:
    """Closed, consistently oriented pieces turned outward; pieces that lie inside others (sealed cavities) left out."""
    piece = pieces_of(faces, len(vertices))
    corners = vertices[faces] - vertices.mean(axis=0)
    sixfold = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    volumes = np.bincount(piece, sixfold) / 6.0
    if np.abs(volumes).max() < 1e-9 * size**3:
        raise InputError(f"{name}: encloses no volume; a sheet must be open and have a thickness")
    faces = np.where((volumes < 0.0)[piece][:, None], faces[:, [0, 2, 1]], faces)
    keep = np.ones(len(volumes), dtype=bool)
    for inner in range(len(volumes) if len(volumes) > 1 else 0):
        inside = vertices[faces[piece == inner][0, 0]]
        others = piece != inner
        keep[inner] = abs(winding_number(inside, vertices[faces[others]])) < 0.5
    if not keep.all():
        warnings.warn(f"{name}: left out {np.count_nonzero(~keep)} sealed cavities", MeshRepairWarning, stacklevel=4)
    return faces[keep[piece]]


def pieces_of(faces: Indices, vertex_count: int) -> Indices:
    """Number (F,) of the connected piece of each face."""
    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(links)), links.T), (vertex_count, vertex_count))
    _, label = connected_components(graph, directed=False)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1]


def winding_number(point: Array, triangles: Array) -> float:
    """How often oriented triangles (F, 3, 3) go round a point: 1 inside a closed outward surface, 0 outside."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    over = np.einsum("fi,fi->f", a, np.cross(b, c))
    under = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(over, under).sum() / (2.0 * np.pi))


def check_contacts(vertices: Array, faces: Indices, size: float, name: str) -> None:
    """Raise InputError if a surface crosses itself or lies on itself."""
    scaled = (vertices - vertices.mean(axis=0)) / size
    held = warp_mesh(scaled, faces)
    other = wp.zeros(len(faces), dtype=int, device="cpu")
    kind = wp.zeros(len(faces), dtype=int, device="cpu")
    corners = [wp.array(scaled, dtype=wp.vec3d, device="cpu"), wp.array(faces.astype(np.int32), dtype=int, device="cpu")]
    inputs = [held.id, *corners, wp.float64(1e-6)]
    wp.launch(surface_queries.self_contacts, dim=len(faces), inputs=inputs, outputs=[other, kind], device="cpu")
    found = np.flatnonzero(kind.numpy())
    if not len(found):
        return
    f = int(found[0])
    verb = "crosses" if kind.numpy()[f] == 1 else "lies on"
    where = point_text(vertices[faces[f]].mean(axis=0))
    raise InputError(
        f"{name}: face {f} {verb} face {int(other.numpy()[f])} near {where} ({len(found)} such faces); "
        "must not pass through itself: join the parts with a boolean union, or share vertices along the line where sheets meet"
    )


def warp_mesh(vertices: Array, faces: Indices) -> wp.Mesh:
    """A mesh of about unit size for geometric queries, on the CPU."""
    points = wp.array(vertices.astype(np.float32), dtype=wp.vec3f, device="cpu")
    return wp.Mesh(points=points, indices=wp.array(faces.astype(np.int32).ravel(), dtype=int, device="cpu"))


def point_text(point: Array) -> str:
    """A point for a message."""
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
