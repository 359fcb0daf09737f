"""Thin closed slabs, such as a leaf given as a box with two parallel sides: the sheet half way between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed.remesh import PatchMesh, face_normals

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

THIN = 0.05  # of the width
SIDES = 0.8  # least part of the area that the two sides have
WALL = 0.25  # relative difference that the height of the wall between them may have from their mean distance


@dataclass(frozen=True)
class Slab:
    """vertices (V, 3) and faces (F, 3) of the middle sheet; thickness over width."""

    vertices: Array
    faces: Indices
    thinness: float


def middle_sheet(mesh: PatchMesh) -> Slab | None:
    """The middle sheet of a closed mesh that has two like patches, much wider than they are apart; None if it has not."""
    vertices = mesh.vertices
    normals = face_normals(vertices, mesh.faces)
    areas = np.bincount(mesh.patch, np.linalg.norm(normals, axis=1)) / 2.0
    if len(areas) < 3:
        return None
    other, side = np.argsort(areas)[-2:].tolist()
    if areas[other] < SIDES * areas[side] or areas[other] + areas[side] < SIDES * areas.sum():
        return None
    volume = np.einsum("fi,fi->", vertices[mesh.faces[:, 0]], normals) / 6.0
    thickness = 2.0 * volume / (areas[side] + areas[other])
    width = areas[side] / np.linalg.norm(np.ptp(vertices, axis=0))
    mine = mesh.patch == side
    wall = areas.sum() - areas[side] - areas[other]
    if not 0.0 < thickness < THIN * width or abs(wall / (thickness * border_length(vertices, mesh.faces[mine])) - 1.0) > WALL:
        return None
    outward = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(outward, mesh.faces[mine, corner], normals[mine])
    used = np.unique(mesh.faces[mine])
    outward = outward[used] / np.linalg.norm(outward[used], axis=1)[:, None]
    sheet = vertices[used] - 0.5 * thickness * outward
    return Slab(sheet, np.searchsorted(used, mesh.faces[mine]), float(thickness / width))


def border_length(vertices: Array, faces: Indices) -> float:
    """Length of the edges of one face."""
    halves = np.sort(np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    edges, counts = np.unique(halves, axis=0, return_counts=True)
    ends = vertices[edges[counts == 1]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())
