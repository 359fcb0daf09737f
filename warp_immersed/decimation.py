"""Fast thinning of meshes with far more faces than a solver needs."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warp_immersed.remesh import PatchMesh, collapse_short, face_normals, flip_edges, mesh_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

EQUILATERAL = np.sqrt(3.0) / 4.0
TURN = np.radians(22.0)  # of a sharply turning curve


def thinned(mesh: PatchMesh, wanted: int, report: Callable[[str, float], None]) -> PatchMesh:
    """A mesh of about `wanted` even faces on some of the vertices of a finer one, whose rims, creases and corners it keeps.

    Collapses short edges only, so that it takes seconds for 300,000 faces; report(label, fraction) is told how it stands.
    """
    area = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1).sum() / 2.0
    given = len(mesh.faces)
    length = np.sqrt(area / (EQUILATERAL * wanted))
    mesh = PatchMesh(mesh.vertices, mesh.faces, mesh.patch, mesh.fixed | turning_points(mesh))
    for turn in range(100):
        before = len(mesh.faces)
        report(f"thinning {given} faces", np.log(given / before) / np.log(given / wanted))
        mesh = collapse_short(mesh, np.full(len(mesh.vertices), length), None)
        if turn % 2:
            mesh = flip_edges(mesh)
        if len(mesh.faces) <= wanted or len(mesh.faces) > 0.99 * before:
            break
    return mesh


def turning_points(mesh: PatchMesh) -> NDArray[np.bool_]:
    """Vertices (V,) at which a rim, crease or patch border turns sharply."""
    edges = mesh_edges(mesh)
    ends = edges.ends[edges.feature]
    along = mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    total = np.zeros_like(mesh.vertices)  # of the directions away from each vertex: short where the curve runs straight on
    np.add.at(total, ends[:, 0], along)
    np.subtract.at(total, ends[:, 1], along)
    return np.linalg.norm(total, axis=1) > 2.0 * np.sin(TURN / 2.0)
